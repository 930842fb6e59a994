"""`spacearm capture`: the velocities just after the grasp of a moving target."""

from __future__ import annotations

from enum import Enum
from typing import Annotated

import numpy as np
import typer

from spacearm.cli.options import AsJson, Attitude, joint_values, on_a_model, spacecraft_pose
from spacearm.cli.output import err, print_result
from spacearm.mechanics.dynamics import capture
from spacearm.model.arm import SpaceArm

Three = tuple[float, float, float]


class Brakes(str, Enum):
    """What the joints do in the impact."""

    FREE = "free"
    BRAKED = "braked"


@on_a_model
def compute_capture(
    arm: SpaceArm,
    mass: Annotated[float, typer.Option(help="Mass of the target [kg].")],
    q: Annotated[
        list[str] | None, typer.Argument(metavar="Q1 Q2 ...", help="Joint values [rad] or [m].")
    ] = None,
    velocity: Annotated[
        Three, typer.Option(help="Velocity of its CM [m/s], inertial axes.", metavar="X Y Z")
    ] = (0.0, 0.0, 0.0),
    spin: Annotated[
        Three,
        typer.Option(
            help="Its angular velocity [rad/s], with --deg in degrees/s, inertial axes.",
            metavar="X Y Z",
        ),
    ] = (0.0, 0.0, 0.0),
    inertia: Annotated[
        Three | None,
        typer.Option(
            help="Its moments of inertia about its CM along the tip's axes [kg m^2]; a point mass "
            "if left out.",
            metavar="X Y Z",
        ),
    ] = None,
    com: Annotated[Three, typer.Option(help="Its CM in the tip frame [m].", metavar="X Y Z")] = (
        0.0,
        0.0,
        0.0,
    ),
    brakes: Annotated[
        Brakes, typer.Option("--joints-are", help="Whether brakes hold the joints.")
    ] = Brakes.FREE,
    attitude: Attitude = (0.0, 0.0, 0.0),
    deg: bool = False,
    as_json: AsJson = False,
) -> None:
    """Compute the velocities just after the tip, at rest, has grasped a moving, spinning body."""
    cfg = arm.at(joint_values(arm, q or [], deg), base=spacecraft_pose(attitude, deg))
    if inertia is None and any(spin):
        err.print("spacearm: note: a point mass does not spin; --inertia gives the target moments")
    turning = np.radians(spin) if deg else np.array(spin)
    found = capture(
        cfg, np.concatenate((velocity, turning)), mass,
        None if inertia is None else np.diag(inertia), com, joints=brakes.value,
    )  # fmt: skip
    print_result(found, deg=deg, as_json=as_json)
