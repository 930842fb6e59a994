"""Questions of missions: attitudes, catches, what is held, reactions, wheels, and the report."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import pinocchio as pin
import typer

import spacearm as sa
from spacearm.cli import options as opt
from spacearm.cli.output import (
    STEP_LIMIT,
    TIME_LIMIT,
    Answer,
    err,
    out,
    save_phases,
    working,
)
from spacearm.cli.questions import With, constraints_of, question, search_of, target_of
from spacearm.cli.wording import NUMBER, join_numbers
from spacearm.export.motion_files import read_measured
from spacearm.files import write
from spacearm.mission.attitudes import MARGIN
from spacearm.singularities.risk import NEAR
from spacearm.sweeps.toml import Table

#: Number of postures that wheels are sized for, if it is not given.
POSTURES = 2000


@opt.answering("attitudes", "view")
def find_attitudes(
    arm: sa.SpaceArm,
    corner: Annotated[
        list[str],
        typer.Option(
            metavar="X1 X2 ...",
            help="A corner of the path, its start first: task components of the tip relative "
            "to the system CM [m], rotations as roll pitch yaw. Give two or more.",
        ),
    ],
    q: opt.JointValues = None,
    attitude: opt.Attitude = None,
    margin: Annotated[
        float | None,
        typer.Option(help="Least distance to the singular set [rad]. Default: 1 degree.", min=0),
    ] = None,
    samples: Annotated[
        int | None, typer.Option(help="Number of attitudes in the first pass.")
    ] = None,
    no_limits: opt.NoLimits = False,
    more: With = None,
    deg: bool = False,
) -> sa.FeasibleAttitudes:
    """Find feasible attitudes for a path of the tip."""
    told = ("speed", "refine", "seed", "length")
    asked = question(more, "start", *told)
    anywhere = not q and "q" not in asked.inner("start").values
    start = opt.configuration(
        arm, [0.0] * arm.n if anywhere else q, attitude, deg, asked.inner("start")
    )
    with working("trying attitudes") as progress:
        return sa.feasible_attitudes(
            start,
            [opt.goal_from(arm, "--corner", text, deg) for text in corner],
            all_branches=anywhere,
            margin=opt.radians(margin, deg, MARGIN),
            limits=not no_limits,
            samples=samples,
            progress=progress,
            **asked.some(*told),
        )


@opt.answering("catch", "save", "view")
def find_catch(
    arm: sa.SpaceArm,
    target: Annotated[
        Path,
        typer.Option(
            metavar="TOML",
            help="The target, with the names of sa.Target: body (a robot file, or mass, size, "
            "inertia, com), pose, twist, grapples, orbit, up_axes.",
        ),
    ],
    q: opt.JointValues = None,
    window: Annotated[
        str, typer.Option(metavar="FROM,TO", help="Earliest and latest time of contact [s].")
    ] = "0,60",
    grapple: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FRAME|TIP=FRAME",
            help="Grapple frame to grasp. Default: any of them. If several tips grasp at the "
            "same time, give TIP=FRAME once for each tip.",
        ),
    ] = None,
    mode: opt.MaybeMode = None,
    fly: Annotated[
        bool,
        typer.Option(
            "--fly",
            help="Simulate the capture, from the approach to rest; --save then writes one file "
            "for each phase.",
        ),
    ] = False,
    attitude: opt.Attitude = None,
    save: opt.Save = None,
    more: With = None,
    deg: bool = False,
) -> Answer:
    """Plan a capture."""
    one = grapple[0] if grapple and grapple[1:] == [] and "=" not in grapple[0] else None
    form = "one frame, or TIP=FRAME once for each tip"
    by_tip = {} if one else opt.pairs("--grapple", grapple, form)
    if by_tip and set(arm.tips) != set(by_tip):
        arm = arm.replace(tip=list(by_tip))
    told = ("grapple", "approach", "closing", "touching", "bears", "wanted", "mode")
    asked = question(
        more, "start", "constraints", "search", *told, grapple=one or by_tip or None, mode=mode
    )
    start = opt.configuration(arm, q, attitude, deg, asked.inner("start"))
    early, late = opt.numbers("--window", window, 2).tolist()
    with working("trying contacts", form=TIME_LIMIT) as progress:
        found = sa.catch(
            start,
            target_of(target),
            window=(early, late),
            constraints=constraints_of(asked.inner("constraints")),
            search=search_of(arm, asked.inner("search"), progress),
            **asked.some(*told),
        )
    if not fly:
        return Answer(found)
    with working("simulating") as progress:
        flight = found.fly(progress=progress)
    return Answer(flight, written=save_phases(flight, save))


@opt.answering("held", "view")
def hold_target(
    arm: sa.SpaceArm,
    q: opt.JointValues = None,
    target: Annotated[
        Path | None,
        typer.Option(
            metavar="TOML",
            help="The grasped target and its rough pose, with the names of sa.Target, as for "
            "spacearm catch. Without it the tips hold a fixed structure, such as the "
            "handrails of a station.",
        ),
    ] = None,
    grasp: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TIP=FRAME|TIP=X,Y,Z[,R,P,Y]",
            help="What a tip grasps: a grapple frame of the target, or a pose in the target's "
            "frame (for a fixed structure in the inertial frame). Give it once for each "
            "tip. Not needed if the robot's file closes a chain, or with --tip LINK=LINK.",
        ),
    ] = None,
    fixed: Annotated[
        bool,
        typer.Option(
            "--fixed",
            help="Keep the target where it is; for a fixed structure, keep the spacecraft "
            "where it is.",
        ),
    ] = False,
    attitude: opt.Attitude = None,
    mode: opt.MaybeMode = None,
    more: With = None,
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="TOML",
            help="Write the posture; other commands read the file in place of joint values.",
            callback=opt.to_write,
        ),
    ] = None,
    deg: bool = False,
) -> Answer:
    """Close a chain and report its singularities."""
    given = opt.pairs("--grasp", grasp, "TIP=FRAME or TIP=X,Y,Z[,R,P,Y], once for each tip")
    if given and set(arm.tips) != set(given):
        arm = arm.replace(tip=list(given))
    asked = question(more, "start", "limits", "seed", "exact", "regrasp")
    if "regrasp" in asked.values:
        reported = {"--mode": mode, "--with exact": "exact" in asked.values}
        opt.refuse_unused(reported, "without regrasp, which gives no report of singularities")
    start = opt.configuration(arm, q, attitude, deg, asked.inner("start"))
    held = sa.hold(
        start,
        None if target is None else target_of(target),
        {tip: _grasp(tip, frame, deg) for tip, frame in given.items()} or None,
        fixed=fixed,
        **asked.some("limits", "seed"),
    )
    if held.tries > 1:
        err.print("spacearm: note: the start leads to no closed posture; a random one did")
    way = None
    if "regrasp" in asked.values:
        with working("planning", form=TIME_LIMIT) as progress:
            way = _regrasp(held, asked.inner("regrasp"), progress)
        held = held.after(way)
    written = list[Path]()
    if save:
        base = held.configuration.base
        xyz, rpy = base.translation.tolist(), pin.rpy.matrixToRpy(base.rotation).tolist()
        place = f"base = {{xyz = {xyz}, rpy = {rpy}}}"
        written.append(write(save, f"[start]\nq = {held.q.tolist()}\n{place}\n".encode()))
    if way is not None:
        return Answer(way, written=written)
    with working("searching", form=STEP_LIMIT) as progress:
        report = held.report(
            mode=mode or "free-floating",
            progress=progress,
            **{"exact": True} | asked.some("exact"),
        )
    return Answer(report, told={"grasps": held.to_dict()["grasps"]}, written=written)


def _regrasp(held: sa.Held, given: Table, progress: Callable[[float, float], object]) -> sa.Regrasp:
    """Plan how a hand regrasps; `grasp` is a frame, or a pose in numbers: [x, y, z, r, p, y]."""
    given.knows("tip", "grasp", "approach", "closing", "constraints", "search")
    grasp, tip = given.values.get("grasp"), given.take("tip", str)
    text = grasp if isinstance(grasp, str) else ",".join(map(str, given.numbers("grasp")))
    return held.regrasp(
        tip,
        _grasp(tip, text, deg=False),
        constraints=constraints_of(given.inner("constraints")),
        search=search_of(held.arm, given.inner("search"), progress),
        **given.some("approach", "closing"),
    )


def _grasp(tip: str, text: str, deg: bool) -> str | pin.SE3:
    """Return the name of a frame, or the pose that numbers mean."""
    if not NUMBER.fullmatch(text.partition(",")[0].strip()):
        return text
    option, count = f"--grasp {tip}=...", 3 if text.count(",") < 3 else 6
    values = opt.numbers(option, text, count)
    turn = values[3:] if count == 6 else np.zeros(3)
    return sa.pose(values[:3], np.radians(turn) if deg else turn)


@opt.answering("identified")
def identify_held(
    arm: sa.SpaceArm,
    motion: Annotated[
        Path,
        typer.Option(
            metavar="CSV|NPZ",
            help="The measurements: a table (CSV) with the column names of sa.write_motion, 't "
            "[s]', 'q JOINT [rad]' and 'base x [m]' to 'base qw [1]', and better also 'dq "
            "JOINT [rad/s]' and 'twist vx [m/s]' to 'twist wz [rad/s]'. Or a motion "
            "written by --save.",
        ),
    ],
    noise: Annotated[
        str | None,
        typer.Option(
            metavar="V,W,DQ",
            help="Standard deviations of the spacecraft's velocity [m/s] and angular velocity "
            "[rad/s], and of the joint rates. Default: estimated from the residuals.",
        ),
    ] = None,
) -> sa.Identified:
    """Identify the payload."""
    dq, twist = None, None
    if motion.suffix.lower() == ".csv":
        measured, dq, twist = read_measured(motion, arm)
    else:
        measured = sa.Motion.load(motion, arm)
    sizes = None if noise is None else opt.numbers("--noise", noise, 3)
    return sa.identify(measured, arm, dq=dq, twist=twist, noise=sizes)


@opt.answering("reaction")
def report_reaction(
    arm: sa.SpaceArm,
    motion: Annotated[
        Path, typer.Option(metavar="NPZ", help="A motion written by --save of plan or simulate.")
    ],
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z", help="Line of sight of a camera, expressed in the spacecraft frame."
        ),
    ] = None,
) -> sa.Reaction:
    """Report the effect of a motion on the spacecraft."""
    sight = None if camera is None else opt.numbers("--camera", camera, 3)
    with working("computing reactions") as progress:
        return sa.reaction(sa.Motion.load(motion, arm), camera=sight, progress=progress)


@opt.answering("wheels")
def size_wheels_of(
    arm: sa.SpaceArm,
    tip_speed: Annotated[
        float | None,
        typer.Option(help="Speed of the tip [m/s], in any direction and at any posture."),
    ] = None,
    motion: Annotated[
        list[Path] | None,
        typer.Option(metavar="NPZ", help="A motion in place of --tip-speed; may be repeated."),
    ] = None,
    samples: Annotated[
        int | None, typer.Option(help=f"Number of postures. Default: {POSTURES:,}.", min=1)
    ] = None,
    near: Annotated[
        float | None,
        typer.Option(
            help="Leave out postures that are nearer to a singular posture than this [rad], "
            "with --deg in degrees. Default: 5 degrees."
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the postures. Default: 0.", min=0)
    ] = None,
    deg: bool = False,
) -> sa.WheelSizing:
    """Compute the momentum that wheels need."""
    if motion:
        drawn = {"--samples": samples, "--near": near, "--seed": seed}
        opt.refuse_unused(drawn, "without --motion, whose postures are given")
    with working("sizing wheels") as progress:
        return sa.size_wheels(
            arm,
            [sa.Motion.load(path, arm) for path in motion] if motion else None,
            tip_speed=tip_speed,
            samples=samples or POSTURES,
            near=opt.radians(near, deg, NEAR),
            seed=seed or 0,
            progress=progress,
        )


@opt.on_a_model
def write_report(
    arm: sa.SpaceArm,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="HTML", help="The page to write.", callback=opt.to_write
        ),
    ],
    q: opt.JointValues = None,
    deg: bool = False,
) -> None:
    """Write a design report."""
    from spacearm.plots.report_page import design_report  # imports matplotlib

    start = opt.joint_values(arm, q, deg) if q else None
    words = _describing(sys.argv[2:])

    def announce(title: str, seconds: float | None) -> None:
        how = "begun" if seconds is None else f"done in {seconds:.1f} s"
        err.print(f"spacearm: report: {title}: {how}")

    with working("writing the report") as progress:
        path = design_report(
            arm, output, q0=start, words=words, on_section=announce, progress=progress
        )
    out.print(f"wrote {path}")


def _describing(words: Sequence[str]) -> list[str]:
    """Return the words of a command line that describe the arm; commands of the report: radians."""
    told: list[str] = []
    skipping = False
    for word in join_numbers(words):
        if not (skipping or word in ("-o", "--output", "--deg") or NUMBER.fullmatch(word)):
            told.append(word)
        skipping = word in ("-o", "--output")
    return [word for word in told if not word.startswith("--output=")]
