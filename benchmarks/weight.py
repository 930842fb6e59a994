"""Weight: packages and megabytes of `pip install .` in a fresh environment, the heaviest by name.

    python benchmarks/weight.py            # the plain install
    python benchmarks/weight.py sweep      # with extras

It fetches packages with pip, takes minutes, and leaves nothing behind.
"""

from __future__ import annotations

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
        listed = subprocess.run([python, "-c", LIST], check=True, capture_output=True, text=True)
    sizes = {name: int(size) for name, size in map(str.split, listed.stdout.splitlines())}
    for name in TOOLS:
        sizes.pop(name, None)
    print(f"{len(sizes)} packages, {sum(sizes.values()) / 1e6:,.0f} MB; the heaviest:")
    for name in sorted(sizes, key=sizes.__getitem__, reverse=True)[:SHOWN]:
        print(f"{sizes[name] / 1e6:8,.0f} MB  {name}")


if __name__ == "__main__":
    main(sys.argv[1:])
