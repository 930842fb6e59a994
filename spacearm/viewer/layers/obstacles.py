"""Obstacles in the scene: drawn as the solids that are checked, moved with the time."""

from __future__ import annotations

from collections.abc import Sequence

import meshcat
import meshcat.geometry as g
import numpy as np
from scipy.spatial import ConvexHull

from spacearm.arrays import Array
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
            triangles = faces(corners(part.solid))
            numbers = np.arange(3 * len(triangles)).reshape(-1, 3)  # corners of their own: flat
            mesh = g.TriangularMeshGeometry(triangles.reshape(-1, 3), numbers)
            node[str(i)].set_object(mesh, g.MeshPhongMaterial(color=SLATE, opacity=0.6))
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


def faces(points: Array) -> Array:
    """Return the triangles (m, 3, 3) of the convex hull of points, counterclockwise from outside.

    Args:
        points: (k, 3) points [m].
    """
    hull = ConvexHull(points)
    triangles = points[hull.simplices]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inward = np.einsum("mi,mi->m", normals, hull.equations[:, :3]) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    return triangles
