"""Robots: every robot file in some folders loaded and asked for a verdict, as a Markdown table.

    python tests/tools/robots.py FOLDER ... > docs/robots.md
    python tests/tools/robots.py --installed                    # those of installed packages
    python tests/tools/robots.py FOLDER --count FOLDER ...      # those of some folders counted only
    python tests/tools/robots.py --bus-mass 500 FOLDER          # arms alone get another bus

A folder is named by the first word of a SOURCE.txt in it, as OWNER/REPOSITORY, else by its own
name. The verdict is that of `spacearm query` at a posture three fifths of the way between the
limits, at 0.5 where there are none. If a message asks for an option, it is given, and the verdict
says so: arms without a spacecraft are mounted on a bus, the first of several tips is chosen,
check="warn" or density=2700 is added. Files that are parts of others are counted only. Above stand
the space robots among them, with the command that loads each, and what came of each folder.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from importlib.metadata import PackageNotFoundError, distribution
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

import spacearm as sa

SUFFIXES = (".urdf", ".xacro", ".xml", ".sdf")
NO_ROBOTS = ("package.xml", "manifest.xml", "plugin.xml", "scene_description.xml")
ASTROBEE = {"world": "iss", "top_aft": "perching_arm", "bot_aft": "empty", "bot_front": "empty"}
ARGUMENTS = {
    "Isurudb/astrobee:model.urdf.xacro": [{"prefix": "/", "ns": "honey", **ASTROBEE}],
    "danielpmorton/pyastrobee:astrobee.xacro": [{"prefix": "/", "ns": "honey", **ASTROBEE}],
    "UniversalRobots/Universal_Robots_ROS2_Description:ur.urdf.xacro": [
        {"name": kind, "ur_type": kind} for kind in ("ur3e", "ur5e", "ur10e", "ur16e", "ur20")
    ],
    "xArm-Developer/xarm_ros2:xarm_device.urdf.xacro": [{"dof": n} for n in (5, 6, 7)],
    "Kinovarobotics/ros2_kortex:kinova.urdf.xacro": [
        {"name": "gen3", "arm": "gen3", "dof": 7, "vision": False},
        {"name": "lite", "arm": "gen3_lite", "dof": 6, "vision": False},
    ],
}
"""Arguments of xacro sources that need some, by repository and file name."""
SPACE = {
    "Canadarm2 (SSRMS)": "TraceableRobotModels: SSRMS_Canadarm2/SSRMS_Canadarm2.urdf",
    "Canadarm2, Space ROS": "simulation: models/canadarm/urdf/SSRMS_Canadarm2.urdf",
    "Canadarm (SRMS)": "TraceableRobotModels: SRMS_Canadarm/SRMS_Canadarm.urdf",
    "ETS-VII": "TraceableRobotModels: ETS-VII/ETSVII.urdf",
    "ETS-VII, OnOrbitROS": "Simulation: ets_vii/urdf/ets_vii.xacro",
    "Astrobee (NASA)": "astrobee: description/description/urdf/model.urdf.xacro",
    "Astrobee, pyastrobee": "pyastrobee: pyastrobee/assets/urdf/astrobee/astrobee.urdf",
    "Astrobee, planar": "adaptive-space-robotics: SPART/urdf/astrobee_planar.urdf",
    "Cassiopeia (NTUA)": "space_robot: model/cassiopeia.urdf",
    "servicer (NTUA)": "space_robot: model/servicer.xml",
    "Cepheus (NTUA)": "cepheus_space_robot: model/cepheus.urdf",
    "chaser, 263 kg": "space_manipulator: chaser_description/urdf/chaser.urdf",
    "servicer with VISPA": "control/robot_pre.urdf",
    "the same, two arms": "URDF_models/robot_2vispas.urdf",
    "PULSAR": "URDF_models/pulsar_airbus_arm.urdf",
    "SPART's example": "SPART: URDF_models/SC_3DoF.urdf",
    "SpaceRobotEnv": "SpaceRobotEnv: SpaceRobotEnv/assets/spacerobot/spacerobot_state.xml",
    "SpaceOctopus": "SpaceOctopus: SpaceRobotEnv/assets/spacerobot/spacerobot_fourarm.xml",
    "Robonaut 2": "nasa-urdf-robots: r2_description/robots/r2b.urdf",
}
"""Robots for space, and how the names of their files end, but for arguments."""
INSTALLED = {
    "rtb-data": "rtbdata/xacro",
    "example-robot-data": "cmeel.prefix/share/example-robot-data/robots",
    "gymnasium": "gymnasium/envs/mujoco/assets",
}
"""Folders of robots in packages that install from the registry."""
TIPS = re.compile(r"links could be the tip: ([^,;]+)")
PARTS = (
    "part of an MJCF",
    "for other files to use",
    "not a robot file of a known format",
    "load the file that includes this one",
)
"""What is said of files that other files include."""
HEAD = """# Robots tried

Each file below comes from a public repository or a package on PyPI. It was loaded, and one
posture was queried as by `spacearm query`: each joint at three fifths of its range, or at 0.5
rad or m if it has no limits. If a message asked for an option, the option was given, and the
last column names it. The options are a bus for an arm without a spacecraft, the first of several
possible tips, `check="warn"` for inertias that no rigid body can have, and `density=` for links
without mass. The mass is that of the robot without such a bus.

The tables were printed by `python tests/tools/robots.py FOLDER ... --installed --count FOLDER
...`. Files of the folders after `--count` are counted in the second table, but not listed in the
third. PyBullet's files were counted without the thousand bodies of its `random_urdfs`.
"""


CATALOGUE = """
The catalogue needs no file. From published data it has Canadarm2 (`spacearm info ssrms`),
ETS-VII (`ets7`), a servicer of 1.6 t (`chaser7`), MDA's arm on a servicer of 786 kg (`mda6`),
TECSAS (`tecsas`) and VISPA on a CubeSat (`vispa_cubesat`). `spacearm models` names the sources."""

OUTCOMES = """\
*Answered*: the file loaded, and its verdict stands in the next table. *Part of another file*: a
file includes it. *Refused*: an error says why, as the next table quotes.
"""


class Row(NamedTuple):
    """One file tried: what came of it, and how it is counted."""

    robot: str
    format: str
    n: str
    tip: str
    mass: str
    verdict: str
    outcome: str
    file: str = ""
    options: str = ""


def files(folder: Path) -> Iterator[Path]:
    """The files below a folder that may be robots."""
    for path in sorted(folder.rglob("*")):
        if path.suffix in SUFFIXES and path.name not in NO_ROBOTS and path.is_file():
            yield path


def name_of(folder: Path) -> str:
    """The repository or package that a folder is of, else its name."""
    for package, within in INSTALLED.items():
        if folder.as_posix().endswith(within):
            return package
    source = folder / "SOURCE.txt"
    return source.read_text(encoding="utf-8").split()[0] if source.is_file() else folder.name


def tried(folder: Path, bus: sa.Bus) -> Iterator[Row]:
    """A row for every file of a folder, and each set of arguments that it takes."""
    repository = name_of(folder)
    packages = [folder] if folder.is_dir() else []
    for path in files(folder):
        file = f"{repository}: {path.relative_to(folder)}"
        for arguments in ARGUMENTS.get(f"{repository}:{path.name}", [{}]):
            said = " ".join(f"{key}:={value}" for key, value in arguments.items())
            options = {"xacro_args": arguments, "packages": packages}
            yield row(path, f"{file} {said}".strip(), bus, options)._replace(file=file)


def row(path: Path, robot: str, bus: sa.Bus, options: dict) -> Row:
    """Load one file, mounted on a bus if it is an arm alone, and ask for its verdict."""
    kind = format_of(path)
    given: dict[str, object] = {}
    mounted = False
    while True:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                how = {**options, **given}
                arm = sa.mount(path, bus, **how) if mounted else sa.load(path, **how)
                report = sa.singularity(arm.at(posture(arm)))
            break
        except sa.SpaceArmError as error:
            more = asked(str(error))
            if "sa.mount(" in str(error) and not mounted:
                mounted = True
            elif more and not more.keys() & given.keys():
                given |= more
            else:
                return refused(path, robot, kind, str(error))
    mass = f"{arm.mass - (bus.mass if mounted else 0.0):.5g}"
    said = [f"on a bus of {bus.mass:g} kg"] if mounted else []
    said += [f"{name}={value!r}" for name, value in given.items()]
    verdict = f"{report.kind}, σ_min {report.sigma_min:.2g} {arm.sigma_unit}"
    verdict += f" ({', '.join(said)})" if said else ""
    outcome = "answered with an option" if given else "answered"
    words = [f"--arg {name}:={value}" for name, value in options["xacro_args"].items()]
    words += [f"--bus {bus.mass:g}:1,1,1"] if mounted else []
    words += [f"--{name} {value}" for name, value in given.items()]
    return Row(
        robot,
        kind,
        str(arm.n),
        ", ".join(arm.tips),
        mass,
        verdict,
        outcome,
        options=" ".join(words),
    )


def format_of(path: Path) -> str:
    """The format of a file, by its suffix; an .xml may be a URDF."""
    if path.suffix == ".xml" and "<robot" in path.read_text(encoding="utf-8", errors="replace"):
        return "URDF"
    return {".sdf": "SDF", ".xacro": "xacro", ".urdf": "URDF", ".xml": "MJCF"}[path.suffix]


def asked(message: str) -> dict[str, object]:
    """The option that a message asks for."""
    if found := TIPS.search(message):
        return {"tip": found[1]}
    if 'check="warn"' in message:
        return {"check": "warn"}
    return {"density": 2700.0} if "density=2700" in message else {}


def refused(path: Path, robot: str, kind: str, message: str) -> Row:
    """A row for a file that does not load, with what its message says."""
    said = message.replace(f"{path}: ", "").replace(str(path), path.name)
    for parent in path.parents[:-1]:  # the last is the root of all
        said = said.replace(f"{parent}/", "")
    said = said.replace("|", "/")
    if any(words in said for words in PARTS):
        outcome = "part of another file"
    elif "no joint" in said:
        outcome = "no movable joint"
    else:
        outcome = "refused"
    return Row(robot, kind, "", "", "", f"{outcome}: {said[:240]}", outcome)


def posture(arm: sa.SpaceArm) -> np.ndarray:
    """A posture away from the middle, which is often singular by design."""
    bounded = np.isfinite(arm.lower) & np.isfinite(arm.upper)
    lower, upper = (np.where(bounded, ends, 0.0) for ends in (arm.lower, arm.upper))
    return np.where(bounded, lower + 0.6 * (upper - lower), 0.5)


def installed() -> Iterator[Path]:
    """The folders of robots that installed packages bring."""
    for name, folder in INSTALLED.items():
        try:
            yield Path(str(distribution(name).locate_file(folder)))
        except PackageNotFoundError:
            print(f"{name}: not installed", file=sys.stderr)


def table(rows: list[Row], counted: list[Row]) -> Iterator[str]:
    """The lines of the tables, and how many files came to what."""
    found = Counter(row.outcome for row in [*rows, *counted])
    outcomes = [outcome for outcome, _ in found.most_common()]
    yield HEAD
    yield "## Space robots that work\n"
    yield "| robot | file | n | tip | mass [kg] | command |"
    yield "|---|---|---|---|---|---|"
    for name, end in SPACE.items():
        for one in rows:
            if one.n and one.file.endswith(end):
                given = f"{Path(one.file.partition(': ')[2]).name} {one.options}".rstrip()
                cells = (name, one.file, one.n, one.tip, one.mass, f"`spacearm info {given}`")
                yield f"| {' | '.join(cells)} |"
    yield CATALOGUE
    yield "\n## Results by source\n"
    yield OUTCOMES
    yield "| source | files | " + " | ".join(outcomes) + " |"
    yield "|---|" + "---|" * (1 + len(outcomes))
    groups = groupby([*rows, *counted], lambda row: row.robot.partition(": ")[0])
    for source, group in [*((name, list(of)) for name, of in groups), ("all", [*rows, *counted])]:
        counts = Counter(row.outcome for row in group)
        numbers = [counts.total(), *(counts[outcome] for outcome in outcomes)]
        yield f"| {source} | " + " | ".join(map(str, numbers)) + " |"
    yield "\n## Results by file\n"
    yield "| robot | format | n | tip | mass [kg] | verdict |"
    yield "|---|---|---|---|---|---|"
    for one in rows:
        if one.outcome != "part of another file":
            yield "| " + " | ".join(one[:6]) + " |"


def main(words: list[str]) -> int:
    """Print the tables; the time it takes goes to the error stream."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--installed", action="store_true")
    parser.add_argument("--count", nargs="*", type=Path, default=[])
    parser.add_argument("--bus-mass", type=float, default=200.0)
    given = parser.parse_args(words)
    bus = sa.Bus(given.bus_mass, size=(1.0, 1.0, 1.0))

    def all_of(folders: Iterable[Path]) -> list[Row]:
        rows: list[Row] = []
        for folder in folders:
            start = time.perf_counter()
            rows += (found := list(tried(folder, bus)))
            took = time.perf_counter() - start
            print(f"{name_of(folder)}: {len(found)}, {took:.1f} s", file=sys.stderr)
        return rows

    rows = all_of([*given.folders, *(installed() if given.installed else ())])
    print("\n".join(table(rows, all_of(given.count))))
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
