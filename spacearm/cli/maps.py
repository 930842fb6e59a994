"""`spacearm map`: the distance to the singular set over two joints."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from spacearm.cli.options import (
    AsJson,
    Picture,
    assignments,
    joint_values,
    on_a_model,
)
from spacearm.cli.output import check_picture, kept, out, picture_path, print_json, write_picture
from spacearm.files import write
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_name
from spacearm.singularities.map import SingularMap, singular_map


@on_a_model
def draw_singular_map(
    arm: SpaceArm,
    axes: Annotated[
        tuple[str, str] | None,
        typer.Option(
            help="The two joints, by name or as q1 q2; by default those along which sigma_min "
            "changes most.",
            metavar="A B",
        ),
    ] = None,
    fix: Annotated[
        list[str] | None,
        typer.Option(help="Position of another joint; may be repeated.", metavar="JOINT=VALUE"),
    ] = None,
    output: Picture = None,
    npz: Annotated[Path | None, typer.Option(help="Write the numbers to a NumPy archive.")] = None,
    points: Annotated[
        int, typer.Option(help="Grid points along each joint.", min=3, max=2001)
    ] = 181,
    deg: bool = False,
    as_json: AsJson = False,
) -> int:
    """Map the distance to the singular set over two joints, with the exact curves on top.

    Ctrl-C keeps what there is.
    """
    check_picture(output)
    fixed = assignments("--fix", fix)
    fixed = {joint_name(arm, name): value for name, value in fixed.items()}
    q = joint_values(arm, [fixed.get(name, 0.0) for name in arm.joint_names], deg)
    result, code = kept(
        "computing the map",
        lambda progress: singular_map(arm, axes, q, points, progress=progress),
    )
    if npz:
        _write_npz(npz, result)
    if output or not (as_json or npz):
        _write_picture(picture_path(output, arm.name, "map"), result, quiet=as_json)
    if as_json:
        print_json(result.to_dict())
    return code


def _write_picture(path: Path, result: SingularMap, quiet: bool) -> None:
    from spacearm.plots.maps import draw_map  # imports matplotlib

    write_picture(path, draw_map(result))
    if not quiet:
        number = "no exact curves" if result.curves is None else f"{len(result.curves)} curves"
        out.print(f"wrote {path}: {result.joints[0]} x {result.joints[1]}, {number}")


def _write_npz(path: Path, result: SingularMap) -> None:
    from io import BytesIO

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
    write(path, buffer.getvalue())
    out.print(f"wrote {path}")
