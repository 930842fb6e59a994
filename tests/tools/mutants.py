"""Mutants: every formula that matters broken in turn; the tests must notice each.

    python tests/tools/mutants.py             # all of them
    python tests/tools/mutants.py jacobian    # those whose formula or file has this in it

Each mutant is one replacement of text (a sign, an index, a transpose), made in a copy of the
package, and faces the few test files that concern it. A text that is gone is an error; the tests
that noticed mutants are run once more on the sound package, where they must pass.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from formulas import MUTANTS, Mutant

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 600
"""Seconds after which the tests of one mutant are given up."""


def main(words: list[str]) -> int:
    """Runs the mutants that the words pick; 0 if every one was noticed."""
    known = [m for m in MUTANTS if all(word in f"{m.file} {m.formula}" for word in words)]
    if not known:
        print(f"no mutant has {' and '.join(words)} in its formula or file")
        return 2
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for part in ("spacearm", "models", "tests", "benchmarks"):
            skip = shutil.ignore_patterns("__pycache__", ".*")
            shutil.copytree(ROOT / part, copy / part, ignore=skip)
        shutil.copy(ROOT / "pyproject.toml", copy)
        by = [noticed(copy, mutant) for mutant in known]
        tests = sorted({test for test in by if test})
        code, said = outcome(copy, *tests) if tests else (0, "")
    if code != 0:
        print(f"tests that noticed mutants fail without any:\n{said}")
        return 2
    missed = by.count(None)
    print(
        f"{len(known) - missed} of {len(known)} mutants noticed; without them all these tests pass"
    )
    return 1 if missed else 0


def noticed(copy: Path, mutant: Mutant) -> str | None:
    """The test that fails once the formula is broken, None if none does."""
    path, begun = copy / "spacearm" / mutant.file, time.monotonic()
    sound = path.read_text(encoding="utf-8")
    path.write_text(broken(sound, mutant), encoding="utf-8")
    code, said = outcome(copy, *(f"tests/{name}.py" for name in mutant.tests.split()))
    path.write_text(sound, encoding="utf-8")
    if code not in (0, 1):
        raise SystemExit(f"{mutant.formula}: the tests could not be run\n{said}")
    failed = re.search(r"^(?:FAILED|ERROR) (\S*::\w+)", said, re.MULTILINE)
    by = f"noticed by {failed[1].rpartition('::')[2]}" if failed else "NOT NOTICED"
    print(f"{mutant.formula:44} {time.monotonic() - begun:5.0f} s  {by}", flush=True)
    return failed[1] if failed else None


def broken(sound: str, mutant: Mutant) -> str:
    """The module with the formula broken."""
    if sound.count(mutant.text) != 1:
        raise SystemExit(
            f"{mutant.formula}: {mutant.file} has {mutant.text!r} {sound.count(mutant.text)} "
            "times; say anew which text the formula is"
        )
    return sound.replace(mutant.text, mutant.broken)


def outcome(copy: Path, *tests: str) -> tuple[int, str]:
    """Exit status and output of tests in the copy."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--tb=no", "-p", "no:cacheprovider"]
    command += ["-n", "0", "-m", ""]  # slow tests too, one after the other
    with tempfile.TemporaryDirectory() as kernels:  # those compiled before are of other formulas
        env = os.environ | {"PYTHONPATH": str(copy), "SPACEARM_CACHE": kernels}
        env["PYTHONDONTWRITEBYTECODE"] = "1"  # two edits in one second look the same to Python
        run = subprocess.run(
            [*command, *tests], cwd=copy, env=env, capture_output=True, text=True, check=False,
            timeout=LIMIT,
        )  # fmt: skip
    return run.returncode, run.stdout + run.stderr


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
