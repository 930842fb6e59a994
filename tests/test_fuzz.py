"""Fuzzing in its short form (`fuzz.py` runs longer ones); what longer ones found is tested with the
module that it was in."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

FUZZ = Path(__file__).with_name("fuzz.py")


@pytest.mark.parametrize(
    ("target", "cases"),
    [("urdf", 150), ("commands", 30), ("studies", 100), ("trajectories", 60), ("messages", 15)],
)
def test_hostile_input_gives_a_result_or_one_error(target, cases):
    words = [sys.executable, str(FUZZ), target, str(cases)]
    run = subprocess.run(words, capture_output=True, text=True, check=False, timeout=600)
    assert run.returncode == 0, run.stdout + run.stderr
    assert f"{target}: {cases} cases, seed 0: " in run.stdout


FAULTS = {
    "open('/dev/full', 'w').close()": "wrote /dev/full",
    "__import__('socket').create_connection(('192.0.2.1', 9), 0.01)": "connected to",
    "__import__('subprocess').run('true')": "subprocess.Popen",
    "[0 for _ in iter(int, 1)]": "Hang: over 0.5 s",
    "1 / 0": "ZeroDivisionError",
    "warnings.warn('deprecated')": "UserWarning: deprecated",
}


def test_the_fence_sees_what_must_not_be():
    code = (
        "import sys; sys.path.insert(0, sys.argv.pop(1)); import fuzz\n"
        f"fuzz.LIMIT, faults = 0.5, iter({list(FAULTS)!r})\n"
        "fuzz.TARGETS['urdf'] = lambda rng, folder: eval(next(faults), vars(fuzz))\n"
        "sys.exit(fuzz.main())"
    )
    words = [sys.executable, "-c", code, str(FUZZ.parent), "urdf", str(len(FAULTS))]
    run = subprocess.run(words, capture_output=True, text=True, check=False, timeout=600)
    assert run.returncode == 1, run.stdout + run.stderr
    for number, what in enumerate(FAULTS.values()):
        said = re.findall(rf"^urdf case {number}, (.*?)(?=^urdf)", run.stdout, re.M | re.S)
        assert what in "".join(said)
