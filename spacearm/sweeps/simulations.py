"""Simulations as a quantity of studies: many runs of every design from dispersed starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_args

import numpy as np
import pinocchio as pin

from spacearm.arrays import LARGEST, Array
from spacearm.errors import unknown
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.motion.controllers import (
    Controller,
    DampedLeastSquares,
    JointPD,
    Reactionless,
    ResolvedRate,
    TransposedJacobian,
)
from spacearm.motion.goal import goal_of
from spacearm.motion.plant import Plant
from spacearm.motion.simulation import FAILURES, Integration, simulate_many
from spacearm.sweeps.quantity import Quantity, Variable
from spacearm.sweeps.tiles import Box
from spacearm.sweeps.toml import Table

LAWS: dict[str, Any] = {
    "transposed": TransposedJacobian,
    "resolved": ResolvedRate,
    "damped": DampedLeastSquares,
    "reactionless": Reactionless,
    "joints": JointPD,
}
"""The laws by the names that studies give them."""
STIFF = ("transposed", "joints")
"""Those whose gains are kp and kd; the others have one, gain."""
RUNS = 256
"""Runs of a chunk at most: some seconds of work."""
VARIABLES = {
    "success": Variable({"units": "1", "about": "whether the target was reached"}),
    "time_to_target": Variable({"units": "s", "about": "NaN if it was not reached"}),
    "first_singularity": Variable({"units": "s", "about": "NaN if none was met"}),
    "least_distance": Variable({"units": "rad", "about": "least distance to the singular set"}),
    "turn": Variable({"units": "rad", "about": "largest turn of the spacecraft from its start"}),
    "failed": Variable({"units": "1", "about": "whether the law or the integrator failed"}),
}


class Simulations(Quantity):
    """Runs of `simulate_many` from starts that are normally distributed about one."""

    dims = ("run",)

    def __init__(self, table: Table, chunk: int, arms: Sequence[SpaceArm]) -> None:
        table.knows("law", "target", "gains", "start", "spread", "attitude", "duration", "runs",
                    "mode", "limits", "reach", "rtol")  # fmt: skip
        self.law = table.take("law", str, "transposed")
        if self.law not in LAWS:
            raise table.fail("law", unknown("law", self.law, LAWS))
        modes: dict[str, BaseMode] = {mode: mode for mode in get_args(BaseMode)}
        if (wanted := table.take("mode", str, "free-floating")) not in modes:
            raise table.fail("mode", unknown("mode", wanted, modes))
        self.mode = modes[wanted]
        self.limits = table.take("limits", bool, False)
        gains = Table(f"{table.where}: gains", table.values.get("gains", {}))
        names = ("kp", "kd") if self.law in STIFF else ("gain",)
        gains.knows(*names)
        self.gains = {name: _numbers(gains, name) for name in names}
        self.target, self.start = _numbers(table, "target"), _numbers(table, "start")
        self.spread = _numbers(table, "spread", [0.0])
        self.attitude = _numbers(table, "attitude", [0.0, 0.0, 0.0])
        if len(self.attitude) != 3:
            raise table.fail("attitude", "give roll, pitch and yaw [rad]")
        if (self.spread < 0.0).any():
            raise table.fail("spread", "give standard deviations from 0 on")
        self.duration = table.positive("duration", float, 60.0)
        self.reach = table.positive("reach", float, 1e-3)
        self.rtol = table.positive("rtol", float, 1e-6)
        for arm in arms:
            if len(self.start) != arm.n:
                raise table.fail("start", f"give {arm.n} joint positions of {arm.name}")
            if len(self.spread) not in (1, arm.n):
                raise table.fail("spread", f"give one number, or {arm.n} for {arm.name}")
            arm.require_one_tip()
            self.controller(arm)
        self.shape = (table.positive("runs", int, 1),)
        self.tile = (min(RUNS, chunk, *self.shape),)
        self.variables, self.coords = VARIABLES, {}

    def controller(self, arm: SpaceArm) -> Controller:
        """Return the law for an arm."""
        gains = {
            name: values if len(values) > 1 else values[0] for name, values in self.gains.items()
        }
        if self.law == "joints":
            return JointPD(target=self.target, **gains)
        law: Controller = LAWS[self.law](
            target=goal_of(arm, self.target, "target"), mode=self.mode, **gains
        )
        return law

    def compute(self, arm: SpaceArm, box: Box, seed: Sequence[int]) -> Mapping[str, Any]:
        """Simulate the runs of a box; in each the system CM is the origin at the start."""
        first, last = box[0].start, box[0].stop
        rng = np.random.default_rng((*seed, first))
        Q0 = self.start + self.spread * rng.normal(size=(last - first, arm.n))
        turned = pin.SE3(pin.rpy.rpyToMatrix(self.attitude), np.zeros(3))
        found = simulate_many(
            [arm.at(q, base=turned).centred(np.zeros(3)) for q in Q0],
            self.controller(arm),
            self.duration,
            mode=self.mode,
            plant=Plant(limits=self.limits),
            distance=True,
            integration=Integration(rtol=self.rtol, atol=1e-2 * self.rtol, reach=self.reach),
            threads=1,
        )
        failed = np.isin(found["ended"], FAILURES)
        kept = {name: found[name].values for name in VARIABLES if name in found}
        return kept | {"least_distance": found["distance"].values, "failed": failed}


def _numbers(table: Table, key: str, default: list[float] | None = None) -> Array:
    """Return a number or a list of them, as an array (m,)."""
    value = table.values.get(key, default)
    listed = value if isinstance(value, list) else [value]
    if not listed or any(type(number) not in (int, float) for number in listed):
        raise table.fail(key, "give a number, or a list of numbers")
    numbers = np.array(listed, dtype=np.float64)
    if not (np.abs(numbers) <= LARGEST).all():
        raise table.fail(key, f"give numbers up to {LARGEST:g}")
    return numbers
