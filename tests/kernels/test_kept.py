"""Kernels kept on disk: where nothing can be written, files are damaged, or sources change."""

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
from spacearm.kernels.kept import SECONDS

PACKAGE = Path(sa.__file__).parent
MANY = """
import spacearm as sa
print(sa.evaluate(sa.load("planar2"), [[0.3, 0.9]] * 999, ["sigma_min"])["sigma_min"][0])
"""
"""Enough configurations for the kernels."""
SMALL = """
from spacearm.kernels.lanes import SETTINGS, compiler

@compiler(**SETTINGS, cache=True)
def kernel(x):
    return 2.0 * x
"""
NOWHERE = "from numba.core.caching import CompileResultCacheImpl as c; c._locator_classes = []\n"
"""Has numba find no folder for its files."""


def run(code, *options, **settings):
    """What a process prints and what it complains of."""
    settings["env"] = settings.get("env", dict(os.environ))
    words = [sys.executable, *options, "-c", code]
    done = subprocess.run(words, capture_output=True, text=True, check=False, **settings)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def test_only_one_module_calls_the_compiler():
    """So that there is one way in which kernels are kept."""
    callers = [p.name for p in PACKAGE.rglob("*.py") if "njit" in p.read_text(encoding="utf-8")]
    assert callers == ["lanes.py"]


@pytest.mark.parametrize("options", [(), ("-W", "error::ImportWarning")])
def test_no_folder_can_be_written(tmp_path, options):
    (tmp_path / "small.py").write_text(SMALL + SMALL.replace("kernel(", "other("))
    code = NOWHERE + "import small; print(small.kernel(2.0), small.kernel(3), small.other(1.0))"
    printed, complaint = run(code, *options, cwd=tmp_path)
    assert printed.split() == ["4.0", "6.0", "2.0"]
    assert complaint.count("compiled kernels cannot be kept") == 1
    assert complaint.count("set NUMBA_CACHE_DIR") == 1


@pytest.mark.slow
def test_what_somebody_else_compiled_is_used_where_nothing_can_be_written(tmp_path):
    (tmp_path / "small.py").write_text(SMALL)
    count = "sum(small.kernel.stats.cache_hits.values())"
    made = run(f"import small; print(small.kernel(2.0), {count})", cwd=tmp_path)
    used = run(f"{NOWHERE}import small; print(small.kernel(2.0), {count})", cwd=tmp_path)
    assert (made[0].split(), used[0].split()) == (["4.0", "0"], ["4.0", "1"])
    assert used[1] == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "damage"),
    [
        ("nbi", b""),
        ("nbi", b"no pickle"),
        ("nbi", None),
        ("nbc", b""),
        ("nbc", b"no pickle"),
        ("nbc", None),
    ],
)
def test_damaged_files_are_written_anew(tmp_path, kind, damage):
    (tmp_path / "small.py").write_text(SMALL)
    code = "import small; print(small.kernel(2.0), sum(small.kernel.stats.cache_hits.values()))"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    hits = []
    for time in range(3):
        printed, complaint = run(code, cwd=tmp_path, env=environment)
        value, hit = printed.split()
        assert value == "4.0"
        assert complaint == ("" if hit == "1" else f"spacearm: compiling once ({SECONDS})\n")
        hits.append(hit)
        if time == 0:
            (path,) = tmp_path.rglob(f"*.{kind}")
            half = path.read_bytes()[: path.stat().st_size // 2]
            path.write_bytes(half if damage is None else damage)
    assert hits == ["0", "0", "1"]


def test_a_full_disk_is_said_and_no_more(tmp_path):
    (tmp_path / "small.py").write_text(SMALL)
    full = (
        "import builtins, errno, numba.core.caching as c\n"
        "def full(*_): raise OSError(errno.ENOSPC, 'No space left on device')\n"
        "c.IndexDataCacheFile._open_for_write = full\n"
    )
    code = full + "import small; print(small.kernel(2.0))"
    printed, complaint = run(code, cwd=tmp_path)
    assert printed.strip() == "4.0"
    assert complaint.count("compiled kernels cannot be kept") == 1


def copy_of_the_package(folder):
    """The package as it is installed, with its models and nothing compiled."""
    none = shutil.ignore_patterns("__pycache__")
    house = shutil.copytree(PACKAGE, folder / "spacearm", ignore=none)
    if not (house / "models").is_dir():
        shutil.copytree(models_folder(), house / "models")
    return house


@pytest.mark.slow
def test_a_changed_step_is_compiled_anew(tmp_path):
    """A kernel has its steps inside; what was kept of it must not outlive a change of one."""
    house = copy_of_the_package(tmp_path / "site")
    there = {"PYTHONPATH": str(tmp_path / "site"), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    before = float(run(MANY, "-P", env=os.environ | there)[0])
    report = sa.singularity(sa.load("planar2").at([0.3, 0.9]))
    assert before == pytest.approx(report.sigma_min, abs=1e-12)
    step = house / "kernels" / "floating.py"
    text = step.read_text(encoding="utf-8")
    assert "w.r_E[x, l] = k.a" in text
    step.write_text(text.replace("w.r_E[x, l] = k.a", "w.r_E[x, l] = 2.0 * k.a"), encoding="utf-8")
    assert abs(float(run(MANY, "-P", env=os.environ | there)[0]) - before) > 1e-3


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux" or os.getuid() != 0, reason="only root can become another user"
)
def test_a_system_user_without_a_home(tmp_path):
    """As in a container: neither the installation nor HOME can be written."""
    copy_of_the_package(tmp_path)
    for folder in (tmp_path, *tmp_path.parents[:2]):
        folder.chmod(folder.stat().st_mode | 0o055)
    environment = {"PATH": os.environ["PATH"], "HOME": str(tmp_path), "PYTHONPATH": str(tmp_path)}
    nobody = {"user": "nobody", "group": "nogroup", "extra_groups": (), "cwd": "/"}
    try:
        subprocess.run([sys.executable, "-c", "import numba"], check=True, **nobody)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this Python is closed to other users")
    _, complaint = run(MANY, "-P", env=environment, **nobody)
    assert complaint.count("compiled kernels cannot be kept") == 1
    assert not [*tmp_path.rglob("__pycache__")]


@pytest.mark.slow
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
