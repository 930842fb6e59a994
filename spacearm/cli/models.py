"""`spacearm models` and `spacearm info`: the catalogue, and the facts of one model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

import spacearm as sa
from spacearm.cli import options as opt
from spacearm.cli.output import print_description, print_json
from spacearm.errors import listed, require_known
from spacearm.results import Cell, Column, Description, Table


def list_models(as_json: opt.AsJson = False) -> None:
    """List the models of the catalogue, and arms to mount on a bus."""
    if as_json:
        return print_json([_entry(info) for info in sa.catalogue()])
    models: list[tuple[Cell, ...]] = [
        (
            info.name,
            info.n,
            info.tip,
            info.task,
            *_masses(info.name).values(),
            info.summary,
            info.source,
        )
        for info in sa.catalogue()
    ]
    mounted = [(info.name, info.tip, info.summary, info.source) for info in sa.arms()]
    columns: list[Column | str] = ["name", "n", "tip", "task", Column("spacecraft", "kg", ".6g")]
    columns += [Column("arm", "kg", ".6g"), "what it is", "source"]
    tables = (
        Table(columns, models),
        Table(("name", "tip", "what it is", "source"), mounted, "Arms for sa.mount"),
    )
    print_description(Description(title="models", tables=tables))


def _entry(info: sa.ModelInfo) -> dict[str, Any]:
    """Return an entry of the catalogue, its tip and task named and given as those of an arm."""
    data = info.to_dict()
    tip, task = data.pop("tip"), data.pop("task")
    told = {"tip_link": tip, "task": {"rows": list(sa.Task(task).rows)}}
    return {**data, **told, **_masses(info.name)}


def _masses(name: str) -> dict[str, float | None]:
    """Return the masses of the spacecraft with all that is fixed to it, and of the rest [kg].

    They are None where the files of the arm are not installed.
    """
    try:
        arm = sa.load(name)
    except sa.ModelError:
        return {"spacecraft_mass": None, "arm_mass": None}
    spacecraft = float(arm.model.inertias[1].mass)
    return {"spacecraft_mass": spacecraft, "arm_mass": arm.mass - spacecraft}


@opt.answering()
def describe_model(arm: sa.SpaceArm) -> sa.SpaceArm:
    """Show bodies, masses, joints, limits, tip and task of a robot."""
    return arm


def _write_urdf(
    arm: sa.SpaceArm,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="URDF", help="The URDF to write.", callback=opt.to_write
        ),
    ],
    home: Annotated[
        list[str] | None,
        typer.Option(
            metavar="JOINT=VALUE",
            help="Home position of a joint: where it is locked if it is not active, where the "
            "viewer begins, and what home means in place of joint values; may be repeated.",
        ),
    ] = None,
    deg: bool = False,
) -> None:
    """Write the arm as a URDF."""
    known = arm.whole.joints
    positions = opt.assignments("--home", home).items()
    arm = arm.with_home({name: opt.si(known.get(name), q, deg) for name, q in positions})
    path = arm.to_urdf(output)
    tips, joints = ", ".join(arm.tips), listed(arm.joint_names)
    said = f"{path}: {arm.name}, {arm.mass:.6g} kg, tip {tips}, "
    said += f"{arm.n} joint{'s' * (arm.n > 1)}: {joints}"
    print_description(Description(title=said, notes=[f"note: {note}" for note in arm.notes]))


#: The commands mount and convert: with --bus the arm is mounted.
write_urdf = opt.on_a_model(_write_urdf, named=True)


#: What writes a robot to a file, by the suffix of the file.
ROBOT_WRITERS: dict[str, Callable[[sa.SpaceArm, Path], Path]] = {
    ".urdf": lambda arm, path: arm.to_urdf(path),
    ".xml": sa.to_mjcf,
    ".sdf": sa.to_sdf,
}


@opt.on_a_model
def export_to_file(
    arm: sa.SpaceArm,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="URDF|XML|SDF|CSV|MAT|JSON|MCAP|NC|ZARR",
            help="File to write. The robot: .urdf, .xml (MJCF) or .sdf; a motion: the others.",
            callback=opt.to_write,
        ),
    ] = None,
    c_code: Annotated[
        Path | None, typer.Option("--c-code", metavar="FOLDER", help="Folder for C99 code.")
    ] = None,
    motion: Annotated[
        Path | None,
        typer.Option(metavar="NPZ", help="Export this motion, saved by --save, not the robot."),
    ] = None,
    mode: opt.MaybeMode = None,
    servo: Annotated[bool, typer.Option("--servo", help="Add the servo to the C code.")] = False,
) -> None:
    """Write a robot or a motion for other programs."""
    written: Sequence[Path]
    if c_code is not None and output is not None:
        raise sa.ConfigurationError("--output and --c-code are given; leave one of them out")
    if c_code is not None and motion is not None:
        raise sa.ConfigurationError("--c-code is code of the robot; leave out --motion")
    if c_code is None:
        opt.refuse_unused({"--mode": mode, "--servo": servo}, "with --c-code FOLDER")
    if c_code is not None:
        try:
            c_code.mkdir(exist_ok=True)
        except OSError as error:
            raise sa.SpaceArmError(f"--c-code {c_code}: no folder can be made: {error}") from None
        written = sa.to_c(arm, c_code, mode=mode or "free-floating", servo=servo)
    elif output is not None and motion is not None:
        written = [sa.write_motion(sa.Motion.load(motion, arm), output)]
    elif output is not None:
        suffix = output.suffix.lower()
        require_known("suffix of a robot's file", suffix, ROBOT_WRITERS, f"--output {output}: ")
        written = [ROBOT_WRITERS[suffix](arm, output)]
    else:
        raise sa.ConfigurationError("no file is named; give --output or --c-code")
    print_description(Description(title=f"wrote {listed([str(path) for path in written])}"))
