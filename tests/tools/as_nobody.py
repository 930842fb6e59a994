"""The fast tests as a system user: nothing can be written but a temporary folder.

    python tests/tools/as_nobody.py [--all | PYTEST ARGUMENTS]

Neither the installation, nor the checkout, nor HOME can be written, as in containers. What is
compiled is then not kept, and each process compiles its own. Without arguments it runs `SHARE`,
files of all folders that compile little; with --all the whole fast tier in one process. Root only.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SHARE = (
    "tests/cli/test_mounting.py", "tests/closure/test_closed_descriptions.py",
    "tests/collisions/test_obstacles.py::test_what_no_obstacle_is",
    "tests/compiler/test_angles.py", "tests/description/test_urdf.py",
    "tests/equations/test_singular_values.py", "tests/export/test_robot_files.py",
    "tests/mechanics/test_momentum.py",
    "tests/mission/test_reactions.py::test_bad_input", "tests/model/test_configuration.py",
    "tests/model/test_mount.py", "tests/model/test_wheels.py", "tests/motion/test_motion.py",
    "tests/planning/test_guesses.py", "tests/plots/test_postures.py",
    "tests/polynomial/test_trig.py", "tests/servo/test_watching.py",
    "tests/singularities/test_rounding.py",
    "tests/sweeps/test_study.py",
    "tests/planning/test_retiming.py::test_what_makes_no_sense_is_refused", "tests/test_files.py",
    "tests/tools/test_robots.py", "tests/uncertainty/test_identification.py",
    "tests/viewer/test_show.py::test_motions_are_played",
    "tests/workspaces/test_design.py::test_shapes_grow_with_their_link",
)  # fmt: skip
"""Tests of every folder."""
READS_ALL = "+dac_read_search"
"""What lets a process read what is closed to it, as a Python below /root, and write no more."""


def become() -> list[str] | None:
    """Return words that run a command as nobody, None if that cannot be done here."""
    if sys.platform != "linux" or os.getuid() != 0 or shutil.which("setpriv") is None:
        return None
    nobody = ["setpriv", "--reuid=nobody", "--regid=nogroup", "--clear-groups"]
    reads = [*nobody, f"--inh-caps={READS_ALL}", f"--ambient-caps={READS_ALL}"]
    for words in (nobody, reads):
        tried = [*words, sys.executable, "-c", "import sys, llvmlite, pytest; print(sys.version)"]
        done = subprocess.run(tried, capture_output=True, text=True, check=False, cwd="/")
        if done.stdout.strip() == sys.version.strip():  # and not of another Python that is open
            return words
    return None


def run(words: list[str], tests: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run tests in one process of nobody's, with a HOME in a folder that only root can write."""
    home, room = folder / "home", folder / "room"
    home.mkdir(mode=0o555)
    room.mkdir()
    shutil.chown(room, "nobody", "nogroup")
    settings = {"PATH": os.environ["PATH"], "HOME": str(home), "TMPDIR": str(room)}
    settings |= {"MPLCONFIGDIR": str(room)}  # matplotlib says at length that it has none
    settings |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    pytest = [sys.executable, "-m", "pytest", "-n", "0", "-q", "-p", "no:cacheprovider"]
    return subprocess.run(
        [*words, *pytest, *tests],
        capture_output=True, text=True, env=settings, cwd=ROOT, check=False,
    )  # fmt: skip


def main(arguments: list[str]) -> int:
    """Run the tests and show what pytest says."""
    words = become()
    if words is None:
        sys.exit("run it on Linux as root, with setpriv (util-linux)")
    tests = [] if arguments == ["--all"] else arguments or list(SHARE)
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        done = run(words, tests, Path(folder))
    print(done.stdout + done.stderr)
    return done.returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
