"""Obstacles in the scene: drawn as the solids that are checked, moved with the time."""

from __future__ import annotations

from collections.abc import Sequence

import meshcat
import meshcat.geometry as g
from scipy.spatial import ConvexHull

from spacearm.collisions.obstacles import Obstacle
from spacearm.collisions.solids import corners

SLATE = 0x5F6B7A


class ObstacleLayer:
    """The obstacles of a motion, drawn under one node.

    Args:
        node: The node.
        obstacles: The obstacles.
    """

    def __init__(self, node: meshcat.Visualizer, obstacles: Sequence[Obstacle]) -> None:
        self._node, self._obstacles = node, tuple(obstacles)
        for i, part in enumerate(part for o in obstacles for part in o.parts):
            points = corners(part.solid)
            mesh = g.TriangularMeshGeometry(points, ConvexHull(points).simplices)
            material = g.MeshPhongMaterial(color=SLATE, opacity=0.6, side="DoubleSide")
            node[str(i)].set_object(mesh, material)
        self._place(0.0, self._obstacles)

    def draw(self, t: float) -> None:
        """Move those that move to where they are at a time [s]."""
        self._place(t, [obstacle for obstacle in self._obstacles if obstacle.moves])

    def _place(self, t: float, some: Sequence[Obstacle]) -> None:
        first = 0
        for obstacle in self._obstacles:
            if obstacle in some:
                for i, pose in enumerate(obstacle.poses(t), first):
                    self._node[str(i)].set_transform(pose.homogeneous)
            first += len(obstacle.parts)
