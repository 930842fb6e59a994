"""`spacearm plan`, `detumble` and `follow`: joint motions that arrive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import spacearm as sa
from spacearm.arrays import Array
from spacearm.cli import options as opt
from spacearm.cli import questions
from spacearm.cli.output import TIME_LIMIT, Answer, err, working
from spacearm.cli.wording import INTERRUPTED, in_own_words
from spacearm.collisions.obstacles import obstacles_of
from spacearm.errors import listed
from spacearm.motion.goal import Goal, goal_of
from spacearm.sweeps.toml import Table

#: Keys of a question about a path besides its start.
FOLLOWED = ("origin", "mode", "speed", "at_rest", "limits")
#: Exit status where the tip cannot be led to the end.
STOPPED = 3
#: Arguments that are taken from a table as they are.
PLAIN = ("duration", "mode", "origin", "final_twist")
#: Keys of the question that a plan and a detumbling have in common.
KEYS = ("start", "goal", "final_attitude", "duration", "origin", "constraints", "search")


def _command(solve: Callable[..., sa.Plan], *more_keys: str) -> Callable[..., int]:
    """Return the command that asks `plan` or `detumble`, whose questions differ in a few keys."""

    @opt.answering("plan", "save", "view", without=() if "mode" in more_keys else ("mode",))
    def run(
        arm: sa.SpaceArm,
        q: opt.JointValues = None,
        goal: Annotated[
            list[str] | None,
            typer.Option(
                metavar="X1 X2 ...",
                help="Task components of the tip [m], rotations as roll pitch yaw. With several "
                "tips NAME=X1,X2,... for each.",
            ),
        ] = None,
        obstacle: Annotated[
            list[str] | None,
            typer.Option(
                metavar="KIND:PLACE:WHAT",
                help="box:X,Y,Z:SIZE (or LX,LY,LZ), sphere:X,Y,Z:RADIUS, "
                "cylinder:X,Y,Z:RADIUS,LENGTH, mesh:X,Y,Z:FILE or robot:X,Y,Z:MODEL [m]; then "
                ":R,P,Y and @MARGIN; may be repeated. Tables of --with constraints.obstacles "
                "accept more.",
            ),
        ] = None,
        attitude: opt.Attitude = None,
        mode: opt.MaybeMode = None,
        fastest: Annotated[
            bool,
            typer.Option(
                "--fastest",
                help="Retime the motion to be as fast as effort and velocity limits allow; needs "
                "toppra.",
            ),
        ] = False,
        more: questions.With = None,
        save: Annotated[
            Path | None,
            typer.Option(
                metavar="NPZ",
                help="Write the plan; if none is found, the best attempt.",
                callback=opt.motion_to_write,
            ),
        ] = None,
        deg: bool = False,
    ) -> Answer:
        """Plan a motion and answer with it."""
        asked = questions.question(more, *KEYS, *more_keys, mode=mode)
        start = opt.configuration(arm, q, attitude, deg, asked.inner("start"))
        target = _goal(arm, goal, asked, deg)
        constraints = questions.constraints_of(asked.inner("constraints"))
        around = tuple(questions.obstacle_of(text, deg) for text in obstacle or ())
        kept = obstacles_of(constraints.obstacles, start)
        constraints = replace(constraints, obstacles=(*kept, *around))
        try:
            with working("planning", form=TIME_LIMIT) as progress:
                found = solve(
                    start,
                    target,
                    constraints=constraints,
                    search=questions.search_of(arm, asked.inner("search"), progress),
                    **_options(arm, asked),
                )
            if fastest:
                from spacearm.planning.retiming import time_optimal

                held = found.mode == "attitude-controlled"
                found = time_optimal(found, wheels=constraints.wheels if held else None)
        except (sa.NoSolutionError, sa.StoppedError) as error:
            if save and isinstance(error.best, sa.Plan):
                error.best.save(save)
                err.print(f"spacearm: wrote {save}: the best attempt, which does not arrive")
            if isinstance(error, sa.NoSolutionError):
                raise
            err.print(f"spacearm: stopped: {in_own_words(str(error))}")
            raise typer.Exit(INTERRUPTED) from None

        def drawn() -> dict[str, Any]:
            point = not isinstance(target, dict | sa.Joints)
            return {
                "target": opt.mark_of(found[-1], target) if point else None,
                "workspace": _shells(arm),
            }

        return Answer(found, drawn=drawn)

    return run


def _goal(
    arm: sa.SpaceArm, texts: list[str] | None, asked: Table, deg: bool
) -> Goal | sa.Joints | dict[str, Goal]:
    """Return the goal of the option, one for each tip as NAME=X1,X2,..., or that of the table."""
    if not texts:
        if "goal" not in asked.values:
            raise sa.ConfigurationError("there is no goal; give --goal X1 X2 ..., or one in a file")
        return questions.goal_in(arm, asked, "goal")
    if len(texts) == 1 and "=" not in texts[0]:
        return opt.goal_from(arm, "--goal", texts[0], deg)
    form = f"one goal, or NAME=X1,X2,... for each of the tips {listed(arm.tips)} (--tip NAME,NAME)"
    goals = opt.pairs("--goal", texts, form)
    if other := [name for name in goals if name not in arm.tips]:
        raise sa.ConfigurationError(f"--goal {other[0]!r}: give {form}")
    return {name: opt.goal_from(arm, f"--goal {name}", text, deg) for name, text in goals.items()}


def _options(arm: sa.SpaceArm, asked: Table) -> dict[str, Any]:
    """Return the rest of the question."""
    options = asked.some(*PLAIN)
    if "final_attitude" in asked.values:
        options["final_attitude"] = sa.pose(rpy=asked.values["final_attitude"])
    if "via" in asked.values:
        options["via"] = [
            questions.goal_in(arm, Table("--with", {"via": one}), "via")
            for one in asked.take("via", list)
        ]
    return options


def _shells(arm: sa.SpaceArm) -> sa.Workspace | None:
    """Compute the workspace of a planar arm, if it has shells."""
    if arm.tree.plane_normal() is None:
        return None
    try:
        return sa.workspace(arm)
    except sa.UnsupportedError:
        return None


plan_motion = _command(sa.plan, "via", "mode", "final_twist")
detumble_motion = _command(sa.detumble)


@opt.answering("follow", "save", "view")
def follow_path(
    arm: sa.SpaceArm,
    q: opt.JointValues = None,
    path: Annotated[
        Path | None, typer.Option(metavar="CSV", help="Path of the tip, one line for each corner.")
    ] = None,
    attitude: opt.Attitude = None,
    mode: opt.MaybeMode = None,
    more: questions.With = None,
    deg: bool = False,
) -> Answer:
    """Follow a path of the tip."""
    if path is None:
        raise sa.ConfigurationError("there is no path; give --path FILE, a CSV file")
    asked = questions.question(more, "start", *FOLLOWED, mode=mode)
    start = opt.configuration(arm, q, attitude, deg, asked.inner("start"))
    times, corners = _corners(arm, path, deg)
    with working("following") as progress:
        found = sa.follow(start, corners, times=times, progress=progress, **asked.some(*FOLLOWED))
    return Answer(found, 0 if found.arrived else STOPPED)


def _corners(arm: sa.SpaceArm, path: Path, deg: bool) -> tuple[Array | None, list[Goal]]:
    """Return the times (m,) [s] of a CSV file, None if it has none, and the corners."""
    (_, table), k = opt.table_of(path, f"--path {path}"), len(arm.task.rows)
    if table.shape[1] not in (k, k + 1):
        raise sa.ConfigurationError(
            f"--path {path} has {table.shape[1]} numbers in a row; give {k}, the task's rows "
            f"{' '.join(arm.task.rows)}, or {k + 1}, the time first"
        )
    values = table[:, -k:]
    turns = np.array(arm.task.indices[:k]) > 2
    values[:, turns] = np.radians(values[:, turns]) if deg else values[:, turns]
    corners = [goal_of(arm, row, f"--path {path}") for row in values]
    return (table[:, 0] if table.shape[1] > k else None), corners
