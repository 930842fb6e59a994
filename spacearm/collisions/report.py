"""Report of a collision check: whether bodies meet on a motion, and how near they come."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from spacearm.arrays import Array
from spacearm.collisions.obstacles import Obstacle, obstacles_of
from spacearm.collisions.separation import Collisions, Contact
from spacearm.collisions.swept_motion import Floating, Recorded, SweptMotion
from spacearm.errors import UnsupportedError
from spacearm.model.arm import Configuration
from spacearm.motion.motion import Motion
from spacearm.results import Cell, Description, Measure, Result, Table


@dataclass(frozen=True, eq=False, repr=False)
class CollisionReport(Result):
    """Whether the bodies of an arm meet each other or obstacles, from `sa.collision_check`.

    Attributes:
        apart: Whether none do, which is proven for the whole motion.
        contact: The first contact that was found, None if there is none.
        t: (m,) times of the samples [s].
        distance: (m,) least distance there, less the margins of obstacles [m]; negative where they
            are not kept.
        nearest: The two bodies that come nearest at a sample.
        checked: What the check covers and what it does not, in one sentence.
    """

    apart: bool
    contact: Contact | None
    t: Array
    distance: Array
    nearest: tuple[str, str]
    checked: str

    @property
    def story(self) -> str:
        """The verdict in one sentence."""
        if self.contact is not None:
            return str(self.contact)
        a, b = self.nearest
        return (
            f"no bodies meet, proven; {a!r} comes nearest, to {self.distance.min():.4g} m of {b!r}"
        )

    def describe(self) -> Description:
        """Describe the verdict, the bodies that come nearest and what was checked."""
        nearest: dict[str, Cell] = {
            "nearest bodies": f"{self.nearest[0]}, {self.nearest[1]}",
            "least distance, less margins": Measure(float(self.distance.min()), "m"),
        }
        return Description(
            title="collisions",
            verdict=self.story,
            tone="good" if self.apart else "bad",
            notes=[self.checked],
            tables=[Table.facts(nearest)],
        )


def collision_check(
    thing: Configuration | Motion,
    obstacles: Obstacle | Sequence[Obstacle | Configuration | Motion] = (),
    *,
    progress: Callable[[float, float], object] | None = None,
) -> CollisionReport:
    """Check whether the bodies of an arm meet each other or obstacles.

    Args:
        thing: A configuration; or a motion, which is checked between its samples as `Motion.at` has
            it: distances are no samples but bounds.
        obstacles: What must not be met besides; see `plan`.
        progress: Called after every sample as progress(done, samples).

    Returns:
        Whether they stay apart, where not, and the distances at the samples.

    Raises:
        ConfigurationError: An argument is of the wrong kind.
        ModelError: Collision geometry of a link is faulty.
        UnsupportedError: No two bodies have shapes that could meet.

    Example:
        >>> import numpy as np, pinocchio as pin, spacearm as sa
        >>> box = sa.Obstacle.box(0.2, pin.SE3(np.eye(3), np.array([1.2, 0.4, 0.0])))
        >>> sa.collision_check(sa.load("planar2").at([0.3, 0.2]), box).apart
        False
    """
    motion: SweptMotion
    if isinstance(thing, Configuration):
        motion = Floating([thing], np.zeros(1))
    else:
        motion = Recorded(Motion.of(thing))
    bodies = Collisions(motion.arm, obstacles_of(obstacles, motion.arm))
    if not bodies:
        raise UnsupportedError(f"{motion.arm.name}: {bodies.account}; there is nothing to check")
    least = []
    for i in range(len(motion)):
        least.append(bodies.margins(motion, float(i)))
        if progress:
            progress(i + 1, len(motion))
    rows = np.array(least)
    contact = bodies.contact(motion)
    return CollisionReport(
        apart=contact is None,
        contact=contact,
        t=np.array(motion.t, dtype=np.float64),
        distance=rows.min(axis=1),
        nearest=bodies.links(int(rows.min(axis=0).argmin())),
        checked=bodies.account,
    )
