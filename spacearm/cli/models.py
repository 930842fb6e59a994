"""`spacearm models` and `spacearm info`: the catalogue, and the facts of one model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.text import Text

from spacearm.cli.options import (
    AsJson,
    on_a_model,
)
from spacearm.cli.output import heading, joint_value, number, out, print_json, table, vector
from spacearm.description.model_catalogue import ModelInfo, arms, catalogue
from spacearm.model.arm import SpaceArm
from spacearm.model.loading import load
from spacearm.model.task import Task


def list_models(as_json: AsJson = False) -> None:
    """List the models of the catalogue, and the arms that can be mounted on a bus."""
    if as_json:
        return print_json([_entry(info) for info in catalogue()])
    rows = table("name", "n", "tip", "task", "spacecraft", "arm", "what it is", "source")
    for info in catalogue():
        spacecraft, arm = (f"{number(mass)} kg" for mass in _masses(info.name).values())
        facts = (info.name, str(info.n), info.tip, info.task, spacecraft, arm)
        rows.add_row(*facts, info.summary, info.source)
    out.print(rows)
    heading("Arms for sa.mount")
    rows = table("name", "tip", "what it is", "source")
    for arm_info in arms():
        rows.add_row(arm_info.name, arm_info.tip, arm_info.summary, arm_info.source)
    out.print(rows)


def _entry(info: ModelInfo) -> dict[str, Any]:
    """Return an entry of the catalogue, its tip and task named and given as those of an arm."""
    data = info.to_dict()
    tip, task = data.pop("tip"), data.pop("task")
    told = {"tip_link": tip, "task": {"rows": list(Task(task).rows)}}
    return {**data, **told, **_masses(info.name)}


def _masses(name: str) -> dict[str, float]:
    """Return the masses of the spacecraft with all that is fixed to it, and of the rest [kg]."""
    arm = load(name)
    spacecraft = float(arm.model.inertias[1].mass)
    return {"spacecraft_mass": spacecraft, "arm_mass": arm.mass - spacecraft}


@on_a_model
def describe_model(
    arm: SpaceArm,
    deg: bool = False,
    as_json: AsJson = False,
) -> None:
    """Show bodies, masses, joints, limits, tip, task and centre of mass of a model."""
    if as_json:
        return print_json(arm.to_dict())
    scaling = f", linear rows divided by {arm.task.length:.6g} m" if arm.task.mixed else ""
    title = f"  {arm.n} joints, {number(arm.mass)} kg  "
    out.print(Text.assemble((arm.name, "bold"), title, (str(arm.path), "dim")))
    out.print(f"tip {arm.tip} ({arm.tip_reason}); another one: --tip LINK")
    out.print(f"task {arm.task.names}{scaling}")
    out.print(f"system CM at q = 0, spacecraft frame: {vector(_system_cm(arm))} m")
    for note in arm.notes:
        out.print(f"note: {note}")
    heading("Bodies")
    bodies = table("body", "mass [kg]", "CM in its frame [m]", "principal moments [kg m²]")
    for name, body in arm.bodies.items():
        moments = np.linalg.eigvalsh(body.inertia)
        bodies.add_row(name, number(body.mass), vector(body.lever), vector(moments))
    out.print(bodies)
    heading("Joints")
    joints = table("joint", "type", "moves", "lower", "upper", "rate", "effort", "follows")
    for joint in arm.tree.depth_first():
        if joint.movable:
            lower, upper, rate = (
                joint_value(value, joint.kind, deg)
                for value in (joint.lower, joint.upper, joint.velocity)
            )
            joints.add_row(
                joint.name,
                joint.kind,
                joint.child,
                lower,
                upper,
                rate if rate == "none" else f"{rate}/s",
                "none" if np.isinf(joint.effort) else f"{number(joint.effort)} {joint.effort_unit}",
                joint.mimic.leader if joint.mimic else "",
            )
    out.print(joints)
    if arm.held:
        heading("Held joints (to make them count: --joints all, or their names)")
        held = table("joint", "type", "moves", "at")
        for name, value in arm.held.items():
            joint = arm.whole.joints[name]
            held.add_row(name, joint.kind, joint.child, joint_value(value, joint.kind, deg))
        out.print(held)


@on_a_model
def write_model(
    arm: SpaceArm,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The URDF to write.", metavar="FILE")
    ],
) -> None:
    """Mount an arm on a bus (--bus-mass) and write both as one URDF, which every command loads."""
    path = arm.to_urdf(output)
    out.print(f"{path}: {arm.name}, {arm.n} joints, {number(arm.mass)} kg, tip {arm.tip}")


@on_a_model
def convert_model(
    arm: SpaceArm,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The URDF to write.", metavar="FILE")
    ],
) -> None:
    """Write a robot of any format (xacro, MJCF, SDF) as a URDF; what was left out is printed."""
    path = arm.to_urdf(output)
    for note in arm.notes:
        out.print(f"note: {note}")
    out.print(f"{path}: {arm.name}, {arm.n} joints, {number(arm.mass)} kg, tip {arm.tip}")


def _system_cm(arm: SpaceArm) -> Any:
    return arm.at(np.zeros(arm.n)).com
