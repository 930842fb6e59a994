"""`spacearm query`, `nearest`, `path`, `map`, `capture`: postures, paths, what a grasp does."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import spacearm as sa
from spacearm.arrays import Array
from spacearm.cli import options as opt
from spacearm.cli.output import (
    STEP_LIMIT,
    Answer,
    err,
    kept,
    print_description,
    print_json,
    working,
)
from spacearm.errors import listed
from spacearm.files import write
from spacearm.mechanics.dynamics import JointState
from spacearm.model.arguments import BaseMode
from spacearm.model.joints import joint_name, outside_limits
from spacearm.results import Description, Table, joint_measures
from spacearm.singularities.abstract_set import control_points, part_of, path_rows, prove_clear
from spacearm.singularities.immaterial_masses import any_payload, payload_note
from spacearm.singularities.map import MOST_POINTS
from spacearm.singularities.nearest import angle, distances_found
from spacearm.singularities.report import TOLERANCE
from spacearm.singularities.sets import prove_regular

#: Exit code of --fail-on-singular.
SINGULAR = 3
Fail = Annotated[
    bool,
    typer.Option(
        "--fail-on-singular",
        help=f"Exit with code {SINGULAR} if it is singular, or not proven regular.",
    ),
]


@opt.answering()
def report_singularity(
    arm: sa.SpaceArm,
    q: opt.JointValues = None,
    attitude: opt.Attitude = None,
    mode: opt.Mode = "free-floating",
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Distance to the singular set up to which a posture is singular [rad], with "
            f"--deg in degrees. Default: {TOLERANCE:g} rad."
        ),
    ] = None,
    first_order: Annotated[
        bool,
        typer.Option(
            "--first-order",
            help="Give the first-order estimate of the distance; do not search for the nearest "
            "singular posture.",
        ),
    ] = False,
    fail_on_singular: Fail = False,
    deg: bool = False,
) -> Answer:
    """Report whether a posture is singular."""
    cfg = opt.configuration(arm, q, attitude, deg)
    with working("searching", form=STEP_LIMIT) as told:
        report = sa.singularity(
            cfg,
            mode=mode,
            tolerance=opt.radians(tolerance, deg, TOLERANCE),
            exact=not first_order,
            progress=told,
        )
    return Answer(report, SINGULAR if fail_on_singular and report.kind != "regular" else 0)


@opt.answering()
def find_nearest(
    arm: sa.SpaceArm,
    q: opt.JointValues = None,
    mode: opt.Mode = "free-floating",
    limits: Annotated[
        bool, typer.Option("--limits", help="Search only within the joint limits.")
    ] = False,
    deg: bool = False,
) -> Any:
    """Find the singular posture that is nearest to a posture."""
    start = opt.joint_values(arm, q or [], deg)
    with working("searching", form=STEP_LIMIT) as progress:
        return sa.singular_set(arm, mode=mode).nearest(start, limits=limits, progress=progress)


@opt.on_a_model
def check_path(
    arm: sa.SpaceArm,
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Text file with the joint values of one posture in each line, or a saved "
            "motion (.npz).",
        ),
    ],
    mode: opt.Mode = "free-floating",
    clearance: Annotated[
        float,
        typer.Option(
            help="Also certify that every singular posture is farther from the path than this "
            "[rad], with --deg in degrees."
        ),
    ] = 0.0,
    fail_on_singular: Fail = False,
    deg: bool = False,
    as_json: opt.AsJson = False,
) -> int:
    """Certify a joint path."""
    given = (
        sa.Motion.load(file, arm) if file.suffix.lower() == ".npz" else _postures(arm, file, deg)
    )
    Q, way = path_rows(arm, given), control_points(arm, given)
    with working("proving") as progress:
        wanted = opt.radians(clearance, deg, 0.0)
        twice = bool(wanted) or way.shape[1] > 2  # a plan is flown between its rows
        parts = 3 if twice else 2
        proof = prove_regular(arm, Q, mode=mode, progress=part_of(progress, 0, parts))
        if proof is None:
            raise sa.UnsupportedError(
                f"{arm.name}: J* has no minors of a size that a proof could use, and the proof "
                "without them is for floating arms with one tip and no sliding joints; "
                "spacearm query looks at single postures"
            )
        if proof and twice:
            clear = prove_clear(arm, mode, way, wanted, progress=part_of(progress, 1, parts))
            proof = replace(clear, margin=proof.margin)
        last = part_of(progress, parts - 1, parts)
        distance = distances_found(arm, mode, Q, progress=last)
    ends = outside_limits(arm, Q.min(axis=0)) + outside_limits(arm, Q.max(axis=0))
    outside = sorted(set(ends))
    if as_json:
        facts = {"arm": arm, "certificate": proof, "outside_limits": outside}
        whom = {"any_payload": any_payload(arm, mode)}
        print_json(facts | {"distance": distance, "mode": mode} | whom)
    else:
        print_description(_described(arm, mode, Q, proof, distance, outside), deg)
    return SINGULAR if fail_on_singular and not proof.free else 0


def _described(
    arm: sa.SpaceArm,
    mode: BaseMode,
    Q: Array,
    proof: sa.Certificate,
    distance: Array,
    outside: list[str],
) -> Description:
    """Return what the proof of a path says."""
    said, notes, tables = proof.describe(), [payload_note(arm, mode)], []
    verdict = said.verdict
    if proof.clearance:
        within = f"no singular posture within {angle(proof.clearance, down=True)}: proven"
        verdict = f"{within}; {verdict}" if proof.verdict == "near" else within
    if proof.at is not None:
        first = 1 + (proof.segment or 0)
        about = "singular, near" if proof.verdict == "near" else "near" if proof.clearance else "on"
        way = f"{about} the way from posture {first} to {first + 1}"
        at = joint_measures(proof.at, arm.slides)
        tables.append(Table.by_columns({"joint": arm.joint_names, way: at}))
    worst = int(np.argmin(distance))
    if np.isfinite(distance[worst]):
        near = f"a singular posture found {angle(float(distance[worst]))} away"
        notes.append(f"nearest of the postures given: number {worst + 1}, {near}")
    limits = f"; outside their limits: {', '.join(outside)}" if outside else ""
    title = f"{arm.name}, {len(Q)} postures"
    return replace(said, title=title, verdict=f"{verdict}{limits}", notes=notes, tables=tables)


def _postures(arm: sa.SpaceArm, file: Path, deg: bool) -> Array:
    """Read the joint positions (m, n) of a path."""
    names, Q = opt.table_of(file, str(file))
    sought = {*arm.joint_names, *(f"q{j}" for j in range(1, arm.n + 1))}
    joints = [joint_name(arm, name) for name in names if name in sought]
    if Q.shape[1:] != (arm.n,) or len(Q) < 2 or (names and joints != list(arm.joint_names)):
        head = f" named {listed(names)}" if names else ""
        raise sa.ConfigurationError(
            f"{file} holds {Q.shape[0]} lines of {Q.shape[1]} numbers{head}; give two lines or "
            f"more, each with {arm.n} joint values: {listed(arm.joint_names)}; along a path of the "
            "tip goes spacearm follow"
        )
    return np.where(arm.slides, Q, np.radians(Q)) if deg else Q


@opt.answering("map")
def draw_singular_map(
    arm: sa.SpaceArm,
    axes: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="A B",
            help="The two joints, by name or as q1 q2. Default: those along which sigma_min "
            "changes most.",
        ),
    ] = None,
    fix: Annotated[
        list[str] | None,
        typer.Option(metavar="JOINT=VALUE", help="Position of another joint; may be repeated."),
    ] = None,
    npz: Annotated[
        Path | None,
        typer.Option(
            metavar="NPZ", help="Write the numbers to a NumPy archive.", callback=opt.to_write
        ),
    ] = None,
    points: Annotated[
        int, typer.Option(help="Grid points along each joint.", min=3, max=MOST_POINTS)
    ] = 181,
    deg: bool = False,
) -> Answer:
    """Map the distance to the singular set."""
    fixed = {joint_name(arm, name): value for name, value in opt.assignments("--fix", fix).items()}
    mapped = [joint_name(arm, name) for name in axes or ()]
    both = {f"--fix {name}": value for name, value in fixed.items() if name in mapped}
    opt.refuse_unused(both, "with joints other than those of --axes")
    q = opt.joint_values(arm, [fixed.get(name, 0.0) for name in arm.joint_names], deg)
    result, code = kept(
        "computing the map",
        lambda progress: sa.singular_map(arm, axes, q, points, progress=progress),
    )
    written = [_write_npz(npz, result)] if npz else []
    return Answer(result, code, drawing=not npz, written=written)


def _write_npz(path: Path, result: sa.SingularMap) -> Path:
    buffer = BytesIO()
    arrays: dict[str, Any] = {
        "joints": np.array(result.joints),
        "held_joints": np.array(list(result.held)),
        "held": np.array(list(result.held.values())),
        "angles": result.angles,
        "distance": result.distance,
        "sigma_min": result.sigma_min,
        "joint_limits": result.joint_limits,
    }
    arrays |= {f"curve_{i}": curve for i, curve in enumerate(result.curves or [])}
    np.savez(buffer, **arrays)
    return write(path, buffer.getvalue())


@opt.answering()
def compute_capture(
    arm: sa.SpaceArm,
    mass: Annotated[float, typer.Option(help="Mass of the body [kg].")],
    q: opt.JointValues = None,
    velocity: Annotated[
        opt.Three,
        typer.Option(
            metavar="X Y Z",
            help="Velocity of the CM of the body [m/s], expressed in the inertial frame.",
        ),
    ] = (0.0, 0.0, 0.0),
    spin: Annotated[
        opt.Three,
        typer.Option(
            metavar="X Y Z",
            help="Angular velocity of the body [rad/s], with --deg in degrees/s, expressed in "
            "the inertial frame.",
        ),
    ] = (0.0, 0.0, 0.0),
    inertia: Annotated[
        opt.Three | None,
        typer.Option(
            metavar="X Y Z",
            help="Moments of inertia of the body about its CM [kg m^2], expressed in the tip "
            "frame. Default: a point mass.",
        ),
    ] = None,
    com: Annotated[
        opt.Three, typer.Option(metavar="X Y Z", help="CM of the body in the tip frame [m].")
    ] = (0.0, 0.0, 0.0),
    brakes: Annotated[
        JointState,
        typer.Option(
            "--joints-are", help="Whether the joints move freely at the grasp or are braked."
        ),
    ] = "free",
    attitude: opt.Attitude = None,
    deg: bool = False,
) -> sa.Capture:
    """Compute the velocities just after a grasp."""
    cfg = opt.configuration(arm, q, attitude, deg)
    if inertia is None and any(spin):
        err.print("spacearm: note: a point mass does not spin; --inertia gives the target moments")
    turning = np.radians(spin) if deg else np.array(spin)
    return sa.capture(
        cfg, np.concatenate((velocity, turning)), mass,
        None if inertia is None else np.diag(inertia), com, joints=brakes,
    )  # fmt: skip
