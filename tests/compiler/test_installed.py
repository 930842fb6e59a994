"""Compiled code of an installed package: where equations change, and where nothing is written."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import as_nobody
import pytest

import spacearm as sa
from spacearm.description.model_catalogue import models_folder

PACKAGE = Path(sa.__file__).parent
MANY = """
import spacearm as sa
print(sa.evaluate(sa.load("planar2"), [[0.3, 0.9]] * 999, ["sigma_min"])["sigma_min"][0])
"""
"""Enough configurations to be compiled for."""

pytestmark = pytest.mark.slow


def run(code, *options, **settings):
    """What a process prints and what it complains of."""
    words = [sys.executable, *options, "-c", code]
    done = subprocess.run(words, capture_output=True, text=True, check=False, **settings)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def copy_of_the_package(folder):
    """The package as it is installed, with its models and nothing compiled."""
    none = shutil.ignore_patterns("__pycache__")
    house = shutil.copytree(PACKAGE, folder / "spacearm", ignore=none)
    if not (house / "models").is_dir():
        shutil.copytree(models_folder(), house / "models")
    return house


def test_a_changed_equation_is_compiled_anew(tmp_path):
    """What was kept of it must not outlive the change."""
    house = copy_of_the_package(tmp_path / "site")
    there = {"PYTHONPATH": str(tmp_path / "site"), "SPACEARM_CACHE": str(tmp_path / "cache")}
    before = float(run(MANY, "-P", env=os.environ | there)[0])
    report = sa.singularity(sa.load("planar2").at([0.3, 0.9]))
    assert before == pytest.approx(report.sigma_min, abs=1e-12)
    equation = house / "equations" / "kinematics.py"
    text = equation.read_text(encoding="utf-8")
    assert "linear = reaches * v" in text
    changed = text.replace("linear = reaches * v", "linear = 2.0 * reaches * v")
    equation.write_text(changed, encoding="utf-8")
    assert abs(float(run(MANY, "-P", env=os.environ | there)[0]) - before) > 1e-3


@pytest.mark.skipif(
    sys.platform != "linux" or os.getuid() != 0, reason="only root can become another user"
)
def test_a_system_user_without_a_home():
    """As in a container: neither the installation nor HOME can be written."""
    nobody = {"user": "nobody", "group": "nogroup", "extra_groups": (), "cwd": "/"}
    try:
        subprocess.run([sys.executable, "-c", "import llvmlite"], check=True, **nobody)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this Python is closed to other users")
    with tempfile.TemporaryDirectory() as folder:  # pytest's own are closed to others
        place = Path(folder)
        place.chmod(0o755)
        copy_of_the_package(place)
        environment = {"PATH": os.environ["PATH"], "HOME": folder, "PYTHONPATH": folder}
        printed, complaint = run(MANY, "-P", env=environment, **nobody)
        assert float(printed) > 0.0
        assert complaint == ""
        assert not [*place.rglob("__pycache__")]


def test_a_share_of_the_fast_tests_as_nobody():
    """Files of all folders; `python tests/tools/as_nobody.py --all` runs the whole fast tier."""
    words = as_nobody.become()
    if words is None:
        pytest.skip("only root can become another user, on Linux with setpriv")
    folders = {path.parent.name for path in as_nobody.ROOT.glob("tests/*/test_*.py")} - {"against"}
    assert {Path(name).parts[1] for name in as_nobody.SHARE} >= folders
    with tempfile.TemporaryDirectory() as folder:  # pytest's own are closed to others
        place = Path(folder)
        place.chmod(0o755)
        run = as_nobody.run(words, list(as_nobody.SHARE), place)
        assert run.returncode == 0, run.stdout + run.stderr
        assert list((place / "home").iterdir()) == []
