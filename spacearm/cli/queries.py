"""`spacearm query`, `nearest` and `path`: a posture, the singular one next to it, ways."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from spacearm.arrays import Array
from spacearm.cli.options import (
    AsJson,
    Attitude,
    Spacecraft,
    SpacecraftMode,
    joint_values,
    on_a_model,
    spacecraft_pose,
)
from spacearm.cli.output import (
    joint_value,
    out,
    print_json,
    print_result,
    table,
    working,
)
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.files import read
from spacearm.mechanics.batch import evaluate
from spacearm.model.arm import SpaceArm
from spacearm.motion.motion import Motion
from spacearm.polynomial.certificate import Certificate
from spacearm.singularities.nearest import GLOBAL_DIMENSION
from spacearm.singularities.report import TOLERANCE, angle, singularity
from spacearm.singularities.sets import prove_regular, singular_set

SINGULAR = 3
"""Exit code of --fail-on-singular."""


@on_a_model
def report_singularity(
    arm: SpaceArm,
    q: Annotated[
        list[str] | None, typer.Argument(metavar="Q1 Q2 ...", help="Joint values [rad] or [m].")
    ] = None,
    attitude: Attitude = (0.0, 0.0, 0.0),
    mode: SpacecraftMode = Spacecraft.FREE,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Distance to the singular set up to which a posture is singular [rad], with --deg "
            f"in degrees; {TOLERANCE:g} rad if not given.",
            show_default=False,
        ),
    ] = None,
    first_order: Annotated[
        bool,
        typer.Option(
            "--first-order", help="Estimate the distance only: do not find the nearest posture."
        ),
    ] = False,
    fail_on_singular: Annotated[
        bool,
        typer.Option(
            "--fail-on-singular", help=f"Exit with code {SINGULAR} if the posture is singular."
        ),
    ] = False,
    deg: bool = False,
    as_json: AsJson = False,
) -> int:
    """Report whether a configuration is singular, and which directions are lost."""
    cfg = arm.at(joint_values(arm, q or [], deg), base=spacecraft_pose(attitude, deg))
    within = TOLERANCE if tolerance is None else np.radians(tolerance) if deg else tolerance
    with working("searching") as told:
        report = singularity(
            cfg, mode=mode.value, tolerance=float(within), exact=not first_order, progress=told
        )
    print_result(report, deg=deg, as_json=as_json)
    return SINGULAR if fail_on_singular and report.kind != "regular" else 0


@on_a_model
def find_nearest(
    arm: SpaceArm,
    q: Annotated[
        list[str] | None, typer.Argument(metavar="Q1 Q2 ...", help="Joint values [rad] or [m].")
    ] = None,
    mode: SpacecraftMode = Spacecraft.FREE,
    limits: Annotated[
        bool, typer.Option("--limits", help="Only postures within the joint limits.")
    ] = False,
    deg: bool = False,
    as_json: AsJson = False,
) -> None:
    """Find the singular posture nearest to a posture, in joint space."""
    start = joint_values(arm, q or [], deg)
    with working("searching") as progress:
        found = singular_set(arm, mode=mode.value)
        nearest, distance = found.nearest(start, limits=limits, progress=progress)
    square = found.complete and found.codimension == 1 and not arm.slides.any()
    proven = square and not limits and 0 < len(found.relevant) <= GLOBAL_DIMENSION
    if as_json:
        return print_json(
            {
                "arm": arm.name,
                "mode": mode.value,
                "joints": list(arm.joint_names),
                "q": start.tolist(),
                "nearest": nearest.tolist(),
                "distance": distance,
                "proven": proven,
                "limits": limits,
            }
        )
    most = "" if proven else "at most "
    out.print(f"{arm.name}, {mode.value}: {most}{joint_value(distance, 'revolute', True)} away")
    rows = table("joint", "q", "nearest singular", "turn")
    for name, here, there in zip(arm.joint_names, start, nearest, strict=True):
        kind = arm.tree.joints[name].kind
        rows.add_row(name, *(joint_value(x, kind, deg) for x in (here, there, there - here)))
    out.print(rows)
    how = "proven: no singular posture is nearer" if proven else "found by a search"
    out.print(f"{how}; joint limits {'count' if limits else 'do not count'}")


@on_a_model
def check_path(
    arm: SpaceArm,
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Text with the joint values of a posture in each line, or a saved motion (.npz).",
        ),
    ],
    mode: SpacecraftMode = Spacecraft.FREE,
    fail_on_singular: Annotated[
        bool,
        typer.Option(
            "--fail-on-singular", help=f"Exit with code {SINGULAR} unless it is proven regular."
        ),
    ] = False,
    deg: bool = False,
    as_json: AsJson = False,
) -> int:
    """Prove that straight joint motions from posture to posture meet no singularity."""
    Q = _postures(arm, file, deg)
    with working("proving") as progress:
        proof = prove_regular(arm, Q, mode=mode.value, progress=progress)
        if proof is None:
            raise UnsupportedError(
                f"{arm.name}: J* of this arm has no minors that a proof could use, as with joints "
                "that mimic others; spacearm query looks at single postures"
            )
        distance = evaluate(arm, Q, ("distance",))["distance"] if mode == "free-floating" else None
    outside = sorted({name for q in Q for name in arm.at(q).outside_limits})
    if as_json:
        print_json(
            {
                "arm": arm.name,
                "certificate": proof.to_dict(),
                "outside_limits": outside,
                "distance": distance,
                "mode": mode.value,
            }
        )
    else:
        _print_proof(arm, Q, proof, distance, outside, deg)
    return SINGULAR if fail_on_singular and not proof.free else 0


def _print_proof(
    arm: SpaceArm,
    Q: Array,
    proof: Certificate,
    distance: Array | None,
    outside: list[str],
    deg: bool,
) -> None:
    words = {
        "free": "meets no singularity: proven",
        "singular": "meets a singularity",
        "undecided": "comes too near to a singularity for a proof",
    }
    limits = f"; outside their limits: {', '.join(outside)}" if outside else ""
    out.print(f"{arm.name}, {len(Q)} postures: {words[proof.verdict]}{limits}")
    if proof.at is not None:
        first = 1 + (proof.segment or 0)
        rows = table("joint", f"on the way from posture {first} to {first + 1}")
        for name, q in zip(arm.joint_names, proof.at, strict=True):
            rows.add_row(name, joint_value(q, arm.tree.joints[name].kind, deg))
        out.print(rows)
    if distance is not None:
        worst = int(np.argmin(distance))
        near = f"about {angle(float(distance[worst]))} from a singular posture"
        out.print(f"nearest of the postures given: number {worst + 1}, {near}, to first order")
    out.print("not checked: collisions, rates, the way of the tip")


def _postures(arm: SpaceArm, file: Path, deg: bool) -> Array:
    """Read the joint positions (m, n) of a path."""
    if file.suffix == ".npz":
        return Motion.load(file, arm).q
    try:
        lines = read(file).decode().replace(",", " ").splitlines()
        Q = np.loadtxt(lines, ndmin=2)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{file}: {error}") from None
    if Q.shape[1:] != (arm.n,) or len(Q) < 2 or not np.isfinite(Q).all():
        raise ConfigurationError(
            f"{file} holds {Q.shape[0]} lines of {Q.shape[1]} numbers; give two lines or more, "
            f"each with {arm.n} finite joint values: {', '.join(arm.joint_names)}"
        )
    return np.where(arm.slides, Q, np.radians(Q)) if deg else Q
