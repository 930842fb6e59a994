"""Plausibility: numbers that a rigid body can have and no spacecraft has, as from wrong units.

Inertias in kg mm^2, lengths in millimetres and masses in grams load without a fault. What betrays
them is the radius of gyration of a body, sqrt(I / m), which is no longer than the robot itself, and
the size and density of a bus.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from spacearm.arrays import Array
from spacearm.description.bodies import Inertial
from spacearm.description.tree import Tree

FAR = 10.0
"""How many times as long as the robot a radius of gyration may be."""
LEAST_SIZE = 1.0
"""Length [m] that a robot is taken to have at least, where its joints are close together."""
LONGEST = 200.0
"""Length [m] of a link or edge of a bus from which it is implausible: the longest spacecraft so far
measures 109 m."""
DENSITIES = (0.1, 25_000.0)
"""Densities of a bus [kg/m^3] that are plausible: from a tent to more than osmium."""


def implausible(tree: Tree, bodies: Mapping[str, Inertial]) -> list[str]:
    """Return what no spacecraft has, a sentence each.

    Args:
        tree: Links and joints.
        bodies: The rigid bodies, by the link nearest to the root.
    """
    lengths = {
        joint.name: float(np.linalg.norm(joint.origin.translation))
        for joint in tree.joints.values()
    }
    found = [
        f"joint {name!r} is {length:.4g} m from the one before it, as if in millimetres"
        for name, length in lengths.items()
        if length > LONGEST
    ]
    levers = [float(np.linalg.norm(body.origin.translation)) for body in bodies.values()]
    size = max(LEAST_SIZE, sum(lengths.values()), *levers)
    for link, body in bodies.items():
        if body.mass > 0.0:
            largest = float(np.linalg.eigvalsh(body.inertia)[-1])
            radius = float(np.sqrt(max(largest, 0.0) / body.mass))
            if radius > FAR * size:
                found.append(
                    f"body {link!r} of {body.mass:.4g} kg has an inertia of {largest:.4g} kg m^2, "
                    f"as if its mass were {radius:.4g} m from its CM; the robot is {size:.3g} m "
                    "long (SI units: kg m^2)"
                )
    return found


def implausible_box(mass: float, edges: Array) -> list[str]:
    """Return what is implausible about a bus of a mass [kg] that is a box with edges (3,) [m]."""
    if edges.max() > LONGEST:
        return [f"the bus is {edges.max():.4g} m long, as if in millimetres"]
    density = mass / float(np.prod(edges))
    least, most = DENSITIES
    if least <= density <= most:
        return []
    return [f"the bus of {mass:.4g} kg has a density of {density:.3g} kg/m^3"]
