"""Weight: packages and megabytes of `pip install .` in a fresh environment, the heaviest by name.

    python benchmarks/weight.py            # the plain install
    python benchmarks/weight.py sweep      # with extras

At the end it takes away what docs/start.md says one may, and counts again. It fetches packages with
pip, takes minutes, and leaves nothing behind.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIST = """
from importlib.metadata import distributions
for d in distributions():
    size = sum(f.locate().stat().st_size for f in d.files or () if f.locate().is_file())
    print(d.name, size)
"""
SHOWN = 12
REMOVAL = re.compile(r"^```sh\n(python -m pip uninstall.*?)^```", re.MULTILINE | re.DOTALL)
"""What may be taken away, in docs/start.md."""
TOOLS = ("pip", "setuptools")
"""What every environment has."""


def main(extras: list[str]) -> None:
    """Installs, counts, and takes the environment away again."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        python = str(Path(folder, "bin", "python"))
        wanted = f"{ROOT}[{','.join(extras)}]" if extras else str(ROOT)
        quiet = ("--quiet", "--no-compile", "--disable-pip-version-check")
        subprocess.run([python, "-m", "pip", "install", *quiet, wanted], check=True)
        sizes = weighed(python)
        print(f"{len(sizes)} packages, {sum(sizes.values()):,.0f} MB; the heaviest:")
        for name in sorted(sizes, key=sizes.__getitem__, reverse=True)[:SHOWN]:
            print(f"{sizes[name]:8,.0f} MB  {name}")
        path = os.pathsep.join((str(Path(folder, "bin")), os.environ["PATH"]))
        for block in REMOVAL.findall((ROOT / "docs" / "start.md").read_text(encoding="utf-8")):
            words = ["sh", "-ec", block]
            subprocess.run(words, check=True, capture_output=True, env=os.environ | {"PATH": path})
            print(f"{sum(weighed(python).values()):8,.0f} MB  after {block.splitlines()[0]}")


def weighed(python: str) -> dict[str, float]:
    """Return the size of each package in an environment [MB], by name."""
    told = subprocess.run([python, "-c", LIST], check=True, capture_output=True, text=True).stdout
    sizes = {name: int(size) / 1e6 for name, size in map(str.split, told.splitlines())}
    return {name: size for name, size in sizes.items() if name not in TOOLS}


if __name__ == "__main__":
    main(sys.argv[1:])
