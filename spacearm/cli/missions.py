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
from spacearm.cli.output import Answer, err, out, save_phases, working
from spacearm.cli.questions import With, constraints_of, question, search_of, target_of
from spacearm.cli.wording import NUMBER, join_numbers
from spacearm.export.motion_files import read_measured
from spacearm.files import write
from spacearm.mission.attitudes import MARGIN
from spacearm.singularities.risk import NEAR
from spacearm.sweeps.toml import Table


@opt.answering("attitudes", "view")
def find_attitudes(
    arm: sa.SpaceArm,
    corner: list[str],
    q: opt.JointValues = None,
    attitude: opt.Attitude = None,
    margin: Annotated[float | None, typer.Option(min=0)] = None,
    samples: int | None = None,
    no_limits: opt.NoLimits = False,
    more: With = None,
    deg: bool = False,
) -> sa.FeasibleAttitudes:
    """Find the attitudes from which the tip can follow a path.

    Joint values, of a posture near the start of the path, choose one branch of postures; without
    them all branches are tried. --with gives what else sa.feasible_attitudes takes: start with its
    momentum, speed, refine, seed.

    Options:
        corner (X1 X2 ...): A corner of the path, its start first: task rows of the tip, from the
            system CM [m], turns as roll pitch yaw. Give two or more.
        margin: Least distance to the singular set [rad]; 1 degree by default.
        samples: Number of attitudes tried at first.
    """
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
    target: Path,
    q: opt.JointValues = None,
    window: str = "0,60",
    grapple: list[str] | None = None,
    fly: bool = False,
    attitude: opt.Attitude = None,
    save: opt.Save = None,
    more: With = None,
    deg: bool = False,
) -> Answer:
    """Find when and how the arm catches a tumbling target.

    At contact the tip has the target's velocity; then the joints brake arm and target.

    --with gives what else sa.catch takes: start, approach, closing, touching, bears, wanted,
    mode, constraints, search; and, by grapple=[{"left":"a"},{"right":"b"}], tips that grasp one
    after the other.

    Options:
        target (TOML): The target, with the names of sa.Target: body (a robot file, or mass, size,
            inertia, com), pose, twist, grapples, orbit, up_axes.
        window (FROM,TO): Earliest and latest contact [s].
        grapple (FRAME|TIP=FRAME): Grapple frame to grasp; any of them by default. With
            several tips that grasp at the same time, once for each tip.
        fly: Simulate the catch, from the approach to rest; --save gives each phase a file.
    """
    one = grapple[0] if grapple and grapple[1:] == [] and "=" not in grapple[0] else None
    form = "one frame, or TIP=FRAME once for each tip"
    by_tip = {} if one else opt.pairs("--grapple", grapple, form)
    if by_tip and set(arm.tips) != set(by_tip):
        arm = arm.replace(tip=list(by_tip))
    told = ("grapple", "approach", "closing", "touching", "bears", "wanted", "mode")
    asked = question(more, "start", "constraints", "search", *told, grapple=one or by_tip or None)
    start = opt.configuration(arm, q, attitude, deg, asked.inner("start"))
    early, late = opt.numbers("--window", window, 2).tolist()
    with working("trying contacts", searches=True) as progress:
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
    target: Path | None = None,
    grasp: list[str] | None = None,
    fixed: bool = False,
    attitude: opt.Attitude = None,
    mode: opt.Mode = "free-floating",
    more: With = None,
    save: opt.Written = None,
    deg: bool = False,
) -> Answer:
    """Find how tips hold a target, and what they can do.

    Joints and target move from a rough start until all grasps are closed. The answer says whether
    the closed chain is singular, what is lost, and which motion leads away.

    --with gives what else sa.hold takes: start, limits, seed. exact=false only estimates the
    distance, without a search for the nearest singular posture. regrasp.tip=left and
    regrasp.grasp=ring, or a table regrasp of what Held.regrasp takes, plan how that hand regrasps.
    --save then writes the posture after it.

    Options:
        target (TOML): What is held, and roughly where, with the names of sa.Target, as for
            spacearm catch; without it the fixed world is held, such as handrails of a station.
        grasp (TIP=FRAME|TIP=X,Y,Z[,R,P,Y]): What a tip holds: a grapple frame of the target, or a
            pose in the target's frame (for the fixed world in the inertial frame). Once for each
            tip. Not needed if the file closes a chain, or with --tip LINK=LINK.
        fixed: Keep the target where it is; if the fixed world is held, keep the spacecraft.
        save (TOML): Write the posture; commands take the file in place of joint values.
    """
    given = opt.pairs("--grasp", grasp, "TIP=FRAME or TIP=X,Y,Z[,R,P,Y], once for each tip")
    if given and set(arm.tips) != set(given):
        arm = arm.replace(tip=list(given))
    asked = question(more, "start", "limits", "seed", "exact", "regrasp")
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
        with working("planning", searches=True) as progress:
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
    with working("searching") as progress:
        report = held.report(mode=mode, progress=progress, **{"exact": True} | asked.some("exact"))
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
def identify_held(arm: sa.SpaceArm, motion: Path, noise: str | None = None) -> sa.Identified:
    """Identify what the hand holds from measured rates.

    Its mass, CM and inertia follow from the conservation of momentum. MODEL is the arm with its
    hand empty.

    Options:
        motion (CSV|NPZ): The measurements: a table (CSV) with the column names of sa.write_motion,
            't [s]', 'q JOINT [rad]' and 'base x [m]' to 'base qw [1]', and better also 'dq JOINT
            [rad/s]' and 'twist vx [m/s]' to 'twist wz [rad/s]'. Or a motion that --save wrote.
        noise (V,W,DQ): Standard deviations of the spacecraft's velocity [m/s] and angular velocity
            [rad/s], and of joint rates; found from the residuals by default.
    """
    dq, twist = None, None
    if motion.suffix == ".csv":
        measured, dq, twist = read_measured(motion, arm)
    else:
        measured = sa.Motion.load(motion, arm)
    sizes = None if noise is None else opt.numbers("--noise", noise, 3)
    return sa.identify(measured, arm, dq=dq, twist=twist, noise=sizes)


@opt.answering("reaction")
def report_reaction(arm: sa.SpaceArm, motion: Path, camera: str | None = None) -> sa.Reaction:
    """Report what a motion does to the spacecraft and its wheels.

    The loads of the wheels are those of holding the attitude.

    Options:
        motion (NPZ): A motion written by --save of plan or simulate.
        camera (X,Y,Z): Line of sight of a camera, spacecraft axes.
    """
    sight = None if camera is None else opt.numbers("--camera", camera, 3)
    with working("computing reactions") as progress:
        return sa.reaction(sa.Motion.load(motion, arm), camera=sight, progress=progress)


@opt.answering("wheels")
def size_wheels_of(
    arm: sa.SpaceArm,
    tip_speed: float | None = None,
    motion: list[Path] | None = None,
    samples: Annotated[int, typer.Option(min=1)] = 2000,
    near: float | None = None,
    seed: int = 0,
    deg: bool = False,
) -> sa.WheelSizing:
    """Compute how much momentum wheels need to hold the attitude.

    The arm moves meanwhile: along given motions, or so that the tip has a given speed.

    Options:
        tip_speed: Speed of the tip [m/s], in any direction and any posture.
        motion (NPZ): A motion in place of --tip-speed; may be repeated.
        samples: Number of postures.
        near: Leave out postures nearer to a singular one than this [rad], with --deg in
            degrees; 5 degrees by default.
        seed: Seed of the postures.
    """
    with working("sizing wheels") as progress:
        return sa.size_wheels(
            arm,
            [sa.Motion.load(path, arm) for path in motion] if motion else None,
            tip_speed=tip_speed,
            samples=samples,
            near=opt.radians(near, deg, NEAR),
            seed=seed,
            progress=progress,
        )


@opt.on_a_model
def write_report(
    arm: sa.SpaceArm,
    output: Annotated[Path, typer.Option("--output", "-o", callback=opt.to_write)],
    q: opt.JointValues = None,
    deg: bool = False,
) -> None:
    """Write a design report, one page.

    It shows the arm, its singular sets, workspaces and reactions.

    Joint values give the working posture; by default it is one far from singularities.

    Options:
        output (HTML): The page to write.
    """
    from spacearm.plots.report_page import design_report  # imports matplotlib

    start = opt.joint_values(arm, q, deg) if q else None
    with working("writing the report") as progress:
        path = design_report(
            arm, output, q0=start, words=_describing(sys.argv[2:]), progress=progress
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
