"""The rigid body: mass, inertia and the hull points that can touch the ground."""

import numpy as np

from .errors import finite, number

SYMMETRY = 1e-9
"""Relative; how far J may be from symmetric, and J1 + J2 below J3, for rounding's sake."""


class Body:
    """A rigid body that touches the ground with points, each of which may have a radius.

    The body frame's origin is the centre of mass.

    Args:
        m: mass, kg.
        J: moment of inertia about the centre of mass, kg m²: (3,) principal, or (3, 3).
        hull: (p, 3) points, body frame, m.
        radius: of the hull points, m; a scalar or (p,).

    Attributes:
        m: float, kg.
        J: (3, 3) kg m², body frame.
        hull: (p, 3) m.
        radius: (p,) m.

    Raises:
        ValueError: wrong shape, not finite, m <= 0, J not symmetric positive or not that of any
            mass distribution (J1 + J2 < J3), negative radius.
    """

    def __init__(self, m, J, hull, radius=0.0):
        self.m = number("m", m, above=0.0)
        J = finite("J", J)
        if J.shape == (3,):
            J = np.diag(J)
        elif J.shape != (3, 3):
            raise ValueError(f"J must have shape (3,) or (3, 3), got {J.shape}")
        if np.abs(J - J.T).max() > SYMMETRY * np.abs(J).max():
            raise ValueError(f"J must be symmetric, got {J.tolist()}")
        self.J = J
        self.hull = finite("hull", hull)
        if self.hull.ndim != 2 or self.hull.shape[1] != 3 or len(self.hull) == 0:
            raise ValueError(f"hull must have shape (p, 3) with p >= 1, got {self.hull.shape}")
        radius = finite("radius", radius)
        if radius.shape not in ((), (len(self.hull),)):
            raise ValueError(f"radius must be a scalar or have shape ({len(self.hull)},), got {radius.shape}")
        if (radius < 0).any():
            raise ValueError(f"radius must be >= 0, got {radius.min():g}")
        self.radius = np.array(np.broadcast_to(radius, len(self.hull)))

        # The kernels work in principal axes. A diagonal J keeps the body's own, bit for bit.
        if (J == np.diag(np.diag(J))).all():
            self.principal_J, self.principal_axes = np.diag(J).copy(), np.eye(3)
        else:
            self.principal_J, axes = np.linalg.eigh(J)
            self.principal_axes = axes * np.sign(np.linalg.det(axes))
        least, middle, largest = np.sort(self.principal_J)
        if least <= 0.0:
            raise ValueError(f"J must be positive definite, got principal moments {self.principal_J}")
        if least + middle < largest * (1.0 - SYMMETRY):
            raise ValueError(f"J must satisfy J1 + J2 >= J3 as any real body does, got {self.principal_J}")
        self.bounding_radius = float((np.linalg.norm(self.hull, axis=1) + self.radius).max())
        for array in (self.J, self.hull, self.radius, self.principal_J, self.principal_axes):
            array.setflags(write=False)

    @classmethod
    def box(cls, m, size, radius=0.0) -> "Body":
        """A solid box with 8 corners; with a radius the corners are rounded and `size` stays.

        Args:
            m: kg.
            size: (3,) full edge lengths, m.
            radius: of the corners, m.
        """
        m = number("m", m, above=0.0)
        size = finite("size", size, (3,))
        radius = number("radius", radius, low=0.0)
        if (size <= 2.0 * radius).any():
            raise ValueError(f"size must be > 2 radius = {2 * radius:g}, got {size.tolist()}")
        a, b, c = size**2
        corners = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        return cls(m, m / 12.0 * np.array([b + c, a + c, a + b]), corners * (size / 2 - radius), radius)

    @classmethod
    def sphere(cls, m, radius) -> "Body":
        """A solid sphere: one hull point at the centre, with a radius (m)."""
        m = number("m", m, above=0.0)
        radius = number("radius", radius, above=0.0)
        return cls(m, np.full(3, 0.4 * m * radius**2), np.zeros((1, 3)), radius)

    @classmethod
    def rod(cls, m, length) -> "Body":
        """A thin rod along x with its two end points; J about x is a millionth of that across."""
        m = number("m", m, above=0.0)
        length = number("length", length, above=0.0)
        J = m * length**2 / 12.0 * np.array([1e-6, 1.0, 1.0])
        return cls(m, J, [(-length / 2, 0, 0), (length / 2, 0, 0)])

    def __repr__(self):
        return f"Body(m={self.m:g}, J={self.J.tolist()}, {len(self.hull)} hull points)"
