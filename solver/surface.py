"""The ground."""

import numpy as np

from .errors import finite


class Plane:
    """A plane at any tilt.

    Args:
        normal: (3,) out of the ground; normalised here.
        point: (3,) any point of it, m.

    Raises:
        ValueError: wrong shape, not finite, or a normal of length 0.
    """

    def __init__(self, normal=(0, 0, 1), point=(0, 0, 0)):
        normal = finite("normal", normal, (3,))
        length = np.linalg.norm(normal)
        if length == 0.0:
            raise ValueError(f"normal must not be zero, got {normal.tolist()}")
        self.normal = normal / length
        self.point = finite("point", point, (3,))
        # Tangents: for a level plane x and y, and the nearest to them otherwise.
        t1 = np.array([1.0, 0.0, 0.0])
        if abs(self.normal[0]) > 0.9:
            t1 = np.array([0.0, 1.0, 0.0])
        t1 = t1 - (t1 @ self.normal) * self.normal
        t1 /= np.linalg.norm(t1)
        t2 = np.cross(self.normal, t1)
        self.parameters = np.concatenate([self.normal, t1, t2, [self.normal @ self.point]])
        for array in (self.normal, self.point, self.parameters):
            array.setflags(write=False)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """φ (Eq. 4): signed distance of points (..., 3) above the plane, m."""
        return points @ self.normal - self.parameters[9]

    def __repr__(self):
        return f"Plane(normal={self.normal.tolist()}, point={self.point.tolist()})"
