"""Installs: the wheel in fresh environments of several Pythons, with a few test files run on it.

    python tests/tools/installs.py python3.10 python3.13   # the newest dependencies
    python tests/tools/installs.py --lowest python3.10 python3.11   # each at its lower bound

Some dependencies (zarr, distributed) are for Python 3.11 on: on 3.10 their bounds are not tried.

Run on demand: it fetches packages with pip, and takes minutes.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

from packaging.metadata import Metadata
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
FILES = (
    "mechanics/test_momentum", "mechanics/test_jacobian", "mechanics/test_barycentric_formulation",
    "mechanics/test_dynamics", "mechanics/test_batch", "description/test_urdf", "model/test_mount",
    "collisions/test_separation", "singularities/test_map", "singularities/test_sets",
    "cli/test_simulations", "viewer/test_viewer", "motion/test_simulation", "sweeps/test_runner",
    "sweeps/test_dask",
)  # fmt: skip
"""They use every dependency of the package."""
EXTRAS = ("cluster", "test")
"""Those whose packages the tests here use."""


def main(words: list[str]) -> int:
    """Tries every Python named; 0 if all are well."""
    lowest = "--lowest" in words
    pythons = [word for word in words if word != "--lowest"] or [sys.executable]
    with tempfile.TemporaryDirectory() as folder:
        run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=ROOT)
        (wheel,) = Path(folder).glob("*.whl")
        failed = [p for p in pythons if not works(p, wheel, lowest)]
    return 1 if failed else 0


def needed(wheel: Path, python: str) -> list[Requirement]:
    """What the package and its extras require on a Python."""
    code = "import platform; print(platform.python_version())"
    version = run(python, "-c", code).strip()
    there = {"python_version": ".".join(version.split(".")[:2]), "python_full_version": version}
    with zipfile.ZipFile(wheel) as file:
        (name,) = (name for name in file.namelist() if name.endswith(".dist-info/METADATA"))
        found = Metadata.from_email(file.read(name)).requires_dist or []
    return [
        r
        for r in found
        if not r.marker or any(r.marker.evaluate({**there, "extra": e}) for e in EXTRAS)
    ]


def lower_bounds(requirements: list[Requirement]) -> list[str]:
    """name==version at the lower bound of every requirement that has one."""
    return [
        f"{requirement.name}=={bound.version}"
        for requirement in requirements
        for bound in requirement.specifier
        if bound.operator in (">=", "==")
    ]


def works(python: str, wheel: Path, lowest: bool) -> bool:
    """Installs the wheel for one Python and runs the tests on it."""
    begun, requirements = time.monotonic(), needed(wheel, python)
    with tempfile.TemporaryDirectory() as folder:
        run(python, "-m", "venv", folder)
        own = str(Path(folder, "bin", "python"))
        constraints = Path(folder, "constraints.txt")
        bounds = lower_bounds(requirements) if lowest else []
        constraints.write_text("\n".join(bounds), encoding="utf-8")
        options = ("--quiet", "--only-binary", ":all:", "--constraint", constraints)
        run(own, "-m", "pip", "install", *options, f"{wheel}[{','.join(EXTRAS)}]")
        version = run(own, "--version").strip()
        frozen = run(own, "-m", "pip", "list", "--format=freeze").split()
        files = [str(ROOT / "tests" / f"{name}.py") for name in FILES]
        how = ("-q", "--tb=short", "-p", "no:cacheprovider", "-m", "")  # slow tests too
        words = (own, "-m", "pytest", *how, *files)
        tests = subprocess.run(
            words, cwd=folder, env=own_environment(), capture_output=True, text=True, check=False
        )
    wanted = {requirement.name.lower() for requirement in requirements}
    print(f"{version}: {tests.stdout.strip().splitlines()[-1]}, {time.monotonic() - begun:.0f} s")
    print("  " + ", ".join(line for line in frozen if line.partition("==")[0].lower() in wanted))
    if tests.returncode != 0:
        print(tests.stdout[-20_000:])
    return tests.returncode == 0


def run(*words: object, **options: object) -> str:
    """What a command prints; its complaint if it fails."""
    command = [str(word) for word in words]
    done = subprocess.run(
        command, env=own_environment(), capture_output=True, text=True, check=False, **options
    )
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)}\n{done.stdout}{done.stderr}")
    return done.stdout


def own_environment() -> dict[str, str]:
    """The environment without what leads Python elsewhere."""
    return {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
