"""Arms with wheels, as descriptions."""

import numpy as np

from helpers.arms import joint, link, random_chain

FREE = '<limit effort="1" velocity="600"/>'
WHEELS = ("wheel_0", "wheel_1", "wheel_2")


def with_wheels(seed: int) -> str:
    """A random chain with two wheels on the bus and one on the arm, each of two rigid parts."""
    rng = np.random.default_rng(seed)
    parts = []
    for i, parent in enumerate(("bus", "bus", "link_2")):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        a = np.outer(axis, axis)
        rotor, rim = (0.05 * a + 0.03 * (np.eye(3) - a)), (0.4 * a + 0.2 * (np.eye(3) - a))
        parts += [
            link(f"rotor_{i}", 2.0, 0.1 * axis, rotor),
            link(f"rim_{i}", 5.0, (0, 0, 0), rim),
            joint(f"rim_joint_{i}", f"rotor_{i}", f"rim_{i}", "fixed", xyz=0.2 * axis),
            joint(
                WHEELS[i], parent, f"rotor_{i}", "continuous", xyz=rng.normal(size=3),
                rpy=rng.uniform(-3, 3, 3), axis=axis, inside=FREE,
            ),
        ]  # fmt: skip
    text = random_chain(seed, 3, ("revolute",))
    return text.replace("</robot>", "\n".join(parts) + "</robot>")
