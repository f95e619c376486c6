"""How a scene's body and ground become another engine's shapes, for all of them the same.

Everything is given in the body's principal axes, where J is diagonal: so mass, inertia and the centre of
mass as the frame's origin are exact in every engine, whatever its shapes would weigh.
"""

from typing import NamedTuple, cast

import numpy as np

from solver.body import Body
from solver.scene import Scene
from solver.surface import Plane

POINT_RADIUS = 1e-6
"""Of the body's bounding radius: what a hull point without a radius gets as a sphere, engines having no
points. The ground is lowered by as much, so that every gap stays what it is; only the contact's arm is that
much longer."""


class Box(NamedTuple):
    """A cuboid: half edges (3,) m, centre (3,) m and axes (3, 3), a column each, in principal axes."""

    half: np.ndarray
    centre: np.ndarray
    axes: np.ndarray


class Shapes(NamedTuple):
    """What can touch: a box, or else spheres (p, 4) (centre in principal axes, radius), m; and a half-space.

    The half-space has a frame (3, 3) whose third column is its normal, and a point (3,) m of its face.
    """

    box: Box | None
    spheres: np.ndarray
    frame: np.ndarray
    point: np.ndarray


def shapes(scene: Scene, boxes: bool = True) -> Shapes:
    """The shapes of a scene's body and ground.

    Args:
        scene: on a plane; any other was refused before.
        boxes: take a box where the hull is one; otherwise spheres at its corners.
    """
    body, plane = scene.body, cast(Plane, scene.surface)
    # a plane's parameters: N, then its two tangents
    frame = plane.parameters[[3, 6, 0, 4, 7, 1, 5, 8, 2]].reshape(3, 3)
    box = box_of(body) if boxes else None
    if box is not None:
        return Shapes(box, np.zeros((0, 4)), frame, plane.point)
    extra = POINT_RADIUS * body.bounding_radius if (body.radius == 0.0).any() else 0.0
    spheres = np.column_stack([body.hull @ body.principal_axes, body.radius + extra])
    return Shapes(None, spheres, frame, plane.point - extra * plane.normal)


def box_of(body: Body) -> Box | None:
    """The box whose 8 corners, without radius, are the body's hull; its edges lie along the body's axes."""
    low, high = body.hull.min(0), body.hull.max(0)
    corners = {tuple(np.where(bits, high, low)) for bits in np.ndindex(2, 2, 2)}
    if body.radius.any() or len(body.hull) != 8 or len(corners) != 8 or {*map(tuple, body.hull)} != corners:
        return None
    return Box((high - low) / 2, (high + low) / 2 @ body.principal_axes, body.principal_axes.T)
