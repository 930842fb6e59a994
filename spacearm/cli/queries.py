"""`spacearm query`: the singularity report of one configuration."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer
from rich.text import Text

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
    component,
    heading,
    joint_value,
    number,
    out,
    print_json,
    table,
    vector,
)
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.singularities.report import IN_WORDS, TOLERANCE, SingularityReport, singularity

ROUNDING = 1e-9
"""Tolerance of a joint limit [rad], for values entered in degrees."""
STYLE = {"regular": "bold green", "kinematic": "bold yellow", "dynamic": "bold red"}


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
    deg: bool = False,
    as_json: AsJson = False,
) -> None:
    """Report whether a configuration is singular, and which directions are lost."""
    cfg = arm.at(joint_values(arm, q or [], deg), base=spacecraft_pose(attitude, deg))
    within = TOLERANCE if tolerance is None else np.radians(tolerance) if deg else tolerance
    report = singularity(cfg, mode=mode.value, tolerance=float(within), exact=not first_order)
    if as_json:
        return print_json(report.to_dict())
    _print(report, deg)


def _radius(cfg: Configuration) -> float:
    return float(np.linalg.norm(cfg.tip.translation - cfg.com))


def _print(report: SingularityReport, deg: bool) -> None:
    cfg = report.configuration
    arm, task = cfg.arm, cfg.arm.task
    k = task.k
    lost = "" if report.rank == k else f", {k - report.rank} of {k} directions lost"
    out.print(
        Text.assemble(
            (arm.name, "bold"),
            f", {report.mode}: ",
            (report.verdict, STYLE[report.kind]),
            lost,
        )
    )
    if report.way_out:
        out.print(f"To get away, per degree: {report.way_out}")
    out.print(IN_WORDS, style="dim")

    heading("Posture")
    nearest = [] if report.nearest is None else ["nearest singular"]
    joints = table("joint", "q", *nearest, "dsigma_min/dq", "")
    inside = (arm.lower - ROUNDING <= cfg.q) & (cfg.q <= arm.upper + ROUNDING)
    for j, name in enumerate(arm.joint_names):
        postures = (cfg.q,) if report.nearest is None else (cfg.q, report.nearest)
        values = (joint_value(q[j], arm.tree.joints[name].kind, deg) for q in postures)
        slope, sound = number(report.gradient[j], 4), inside[j]
        joints.add_row(name, *values, slope, "" if sound else "outside its limits")
    out.print(joints)

    heading("Tip")
    facts = table("", "")
    facts.add_row("position, inertial frame", f"{vector(cfg.tip.translation)} m")
    facts.add_row("distance R from the system CM", f"{number(_radius(cfg))} m")
    if report.sigma_min <= report.error:
        facts.add_row("sigma_min may be zero", f"rounding errors are up to {number(report.error)}")
    facts.add_row("sigma_min", f"{number(report.sigma_min)} {arm.sigma_unit}")
    facts.add_row("condition", number(report.condition))
    facts.add_row("manipulability", number(report.manipulability))
    if report.determinant is not None:
        facts.add_row("determinant", number(report.determinant))
    if report.length is not None:
        facts.add_row("linear rows divided by", f"{number(report.length)} m")
    out.print(facts)

    inertial = np.allclose(report.axes, np.eye(3))
    axes = "inertial" if inertial else "task"
    heading(f"Directions, {axes} axes, singular values in {arm.sigma_unit}")
    directions = table("", "sigma", *task.rows)
    for i, direction in enumerate(np.hstack((report.available, report.lost)).T):
        label, style = ("available", "green") if i < report.rank else ("lost", "red")
        components = (component(x) for x in direction)
        directions.add_row(label, number(report.sigma[i], 4), *components, style=style)
    out.print(directions)
    if report.null_space.size:
        heading("Joint motions that leave the tip at rest")
        still = table(*arm.joint_names)
        for motion in report.null_space.T:
            still.add_row(*(component(x) for x in motion))
        out.print(still)
