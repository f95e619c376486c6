"""The ground: a plane, or a height field."""

import inspect

import numpy as np
from numpy.typing import ArrayLike

from .errors import finite, number, one_of
from .field import feet, heights

FADE = 3
"""Cells over which a field's slope fades beyond its grid."""

STEEPEST = np.sqrt(3.0)
"""Of a field's slopes: 60°."""


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
        self.field = None
        for array in (self.normal, self.point, self.parameters):
            array.setflags(write=False)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """φ (Eq. 4): signed distance of points (..., 3) above the plane, m."""
        return points @ self.normal - self.parameters[9]

    def feet(self, points: np.ndarray) -> np.ndarray:
        """φ, the normal and φ's Hessian, as `HeightField.feet` gives them, of points (..., 3): (..., 10)."""
        out = np.zeros((*np.shape(points)[:-1], 10))
        out[..., 0], out[..., 1:4] = self.distance(points), self.normal
        return out

    def heights(self, x: ArrayLike, y: ArrayLike) -> np.ndarray:
        """z of the plane over (x, y), m; infinite if it is vertical."""
        x, y = np.asarray(x, float), np.asarray(y, float)
        with np.errstate(divide="ignore"):
            return (self.parameters[9] - self.normal[0] * x - self.normal[1] * y) / self.normal[2]

    def __repr__(self):
        return f"Plane(normal={self.normal.tolist()}, point={self.point.tolist()})"


class HeightField:
    """Smooth ground z = h(x, y) over the world's x-y plane, through the heights of a square grid.

    h is the natural bicubic spline: it goes through every height given, has two continuous derivatives,
    and is as straight as can be at the grid's border. Beyond, its slope fades within 3 cells, and from
    there on the ground is level across the border and goes on for ever.

    Distances are to the nearest point of the surface, as far as no two of its normals meet: up to
    1/`valley` above it and 1/`bump` below. `Scene` refuses a hull radius too near that.

    Args:
        grid: (a, b) heights, m; grid[i, j] stands at origin + (i spacing, j spacing, grid[i, j]).
        spacing: m, 1e-6 to 1e6.
        origin: (3,) m.

    Attributes:
        valley: the largest curvature of its hollows, 1/m.
        bump: the largest curvature of its humps, 1/m.

    Raises:
        ValueError: wrong shape, not finite, spacing out of range, or a slope beyond 60°.
    """

    def __init__(self, grid, spacing, origin=(0, 0, 0)):
        grid = finite("grid", grid)
        if grid.ndim != 2 or min(grid.shape) < 2:
            raise ValueError(f"grid must have shape (a, b) with both >= 2, got {grid.shape}")
        self.spacing = number("spacing", spacing, low=1e-6, high=1e6)
        self.origin = finite("origin", origin, (3,))
        self.grid = grid
        with np.errstate(all="ignore"):  # what overflows is no slope up to 60°
            c = _continued(_coefficients(_continued(_coefficients(grid)).T)).T + self.origin[2]
            slope, self.valley, self.bump = _extremes(c, self.spacing)
        if not slope <= STEEPEST:
            got = np.degrees(np.arctan(slope))
            raise ValueError(
                f"grid must not be steeper than 60°, nor go on so beyond its border, got {got:.3g}°"
            )
        # The level plane through the highest coefficient: the surface is nowhere above it.
        self.parameters = np.array([0, 0, 1, 1, 0, 0, 0, 1, 0, c.max()], dtype=np.float64)
        corner = self.origin[:2] - FADE * self.spacing
        with np.errstate(divide="ignore"):
            reach = float(1.0 / np.float64(self.valley))
        self.field = (
            np.ascontiguousarray(c), float(corner[0]), float(corner[1]), 1.0 / self.spacing,
            reach, max(self.valley, self.bump), _level(c, self.spacing),
        )  # fmt: skip
        for array in (self.origin, self.grid, self.parameters, self.field[0]):
            array.setflags(write=False)

    def __reduce__(self):
        """A copy is made anew: numba would compile once more for arrays that can be written to."""
        return HeightField, (self.grid, self.spacing, self.origin)

    @classmethod
    def named(cls, name: str, **parameters) -> "HeightField":
        """One of the grounds that have a name; lengths in m.

        - "bumpy": random humps and hollows up to `height` high, `spacing` apart, within `size` by `size`
          around the origin, by the numbers of `seed`; level outside
        - "ditch": a trench along y, z = −`depth` exp(−(2x/`width`)²)
        - "ramp": from level ground up to `height`, over `length` from x = 0; level behind

        Raises:
            ValueError: no such name or parameter, or what `HeightField` refuses.
        """
        one_of("name", name, _NAMED)
        known = inspect.signature(_NAMED[name]).parameters
        for parameter in parameters:
            if parameter not in known:
                allowed = ", ".join(map(repr, known))
                raise ValueError(f"parameters of {name!r} are {allowed}; got {parameter!r}")
        return cls(*_NAMED[name](**parameters))

    def feet(self, points: np.ndarray) -> np.ndarray:
        """φ, the normal and φ's Hessian (xx, xy, xz, yy, yz, zz) of points (..., 3): (..., 10)."""
        points = np.asarray(points, dtype=np.float64)
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        out = np.empty((len(flat), 10))
        feet(self.field, flat, out)
        return out.reshape(*points.shape[:-1], 10)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """φ (Eq. 4): signed distance of points (..., 3) above the surface, m."""
        return self.feet(points)[..., 0]

    def heights(self, x: ArrayLike, y: ArrayLike) -> np.ndarray:
        """h(x, y) of arrays of one shape, m."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        out = np.empty(x.size)
        heights(self.field, np.ascontiguousarray(x).ravel(), np.ascontiguousarray(y).ravel(), out)
        return out.reshape(x.shape)

    def __repr__(self):
        size = " x ".join(map(str, self.grid.shape))
        return f"HeightField({size} heights, spacing={self.spacing:g}, origin={self.origin.tolist()})"


def _coefficients(grid: np.ndarray) -> np.ndarray:
    """Cubic B-spline coefficients (a + 2, b) along the first axis, of a curve that ends unbent.

    (c[i−1] + 4 c[i] + c[i+1]) / 6 = grid[i], without second derivative at either end: tridiagonal.
    """
    a = len(grid)
    c = np.pad(grid, ((1, 1), (0, 0)))
    pivot = np.full(a, np.inf)  # the ends are known: they are the grid's
    for i in range(1, a - 1):
        pivot[i] = 4.0 - 1.0 / pivot[i - 1]
        c[i + 1] = (6.0 * c[i + 1] - c[i]) / pivot[i]
    for i in range(a - 2, 0, -1):
        c[i + 1] -= c[i + 2] / pivot[i]
    c[0] = 2.0 * c[1] - c[2]
    c[-1] = 2.0 * c[-2] - c[-3]
    return c


def _continued(c: np.ndarray) -> np.ndarray:
    """FADE more coefficients at either end of the first axis: slope fades, and the last three are equal."""
    fading = np.maximum(0.0, 1.0 - np.arange(1, FADE + 1) / (FADE - 1.0))
    rise = np.cumsum(fading)[:, None]
    before, after = c[0] + rise * (c[0] - c[1]), c[-1] + rise * (c[-1] - c[-2])
    return np.concatenate([before[::-1], c, after])


def _extremes(c: np.ndarray, spacing: float) -> tuple[float, float, float]:
    """The steepest slope, and the largest curvatures of hollows and humps, 1/m: at knots and between."""
    # at a knot and in the middle of a cell: value, first and second derivative
    knot = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [6, -12, 6, 0]]) / 6
    middle = np.array([[1, 23, 23, 1], [-6, -30, 30, 6], [24, -24, -24, 24]]) / 48
    slope = valley = bump = 0.0
    rows = np.lib.stride_tricks.sliding_window_view(c, (4, 4))
    for u in (knot, middle):
        for w in (knot, middle):
            d = np.einsum("ak,bl,ijkl->abij", u, w, rows, optimize=True)
            x, y = d[1, 0] / spacing, d[0, 1] / spacing
            xx, xy, yy = d[2, 0] / spacing**2, d[1, 1] / spacing**2, d[0, 2] / spacing**2
            n2 = 1 + x * x + y * y
            mean = ((1 + y * y) * xx - 2 * x * y * xy + (1 + x * x) * yy) / (2 * n2**1.5)
            spread = np.sqrt(np.maximum(0.0, mean**2 - (xx * yy - xy * xy) / n2**2))
            slope = np.maximum(slope, np.sqrt(n2 - 1).max())
            valley = np.maximum(valley, (mean + spread).max())
            bump = np.maximum(bump, (spread - mean).max())
    return float(slope), float(valley), float(bump)


def _level(c: np.ndarray, spacing: float) -> float:
    """Cosine of a slope that is nowhere exceeded.

    A spline's slopes are means of the differences between its coefficients, with positive weights.
    """
    steep = np.hypot(np.abs(np.diff(c, axis=0)).max(), np.abs(np.diff(c, axis=1)).max()) / spacing
    return float(1.0 / np.hypot(1.0, steep))


def _bumpy(height=0.05, spacing=1.0, size=40.0, seed=0):
    height, spacing = number("height", height), number("spacing", spacing, above=0.0)
    n = int(number("size", size, low=2 * spacing, high=1e3 * spacing) / spacing)
    rng = np.random.default_rng(int(number("seed", seed, low=0)))
    heights = height * rng.uniform(-1, 1, (n + 1, n + 1))
    return np.pad(heights[1:-1, 1:-1], 1), spacing, (-n * spacing / 2, -n * spacing / 2, 0)


def _ditch(depth=0.5, width=3.0):
    depth, width = number("depth", depth), number("width", width, above=0.0)
    x = np.linspace(-2, 2, 241)
    section = -depth * np.exp(-4 * x**2)
    spacing = width * (x[1] - x[0])
    return np.tile(section[:, None], 2), spacing, (-2 * width, 0, 0)


def _ramp(height=1.0, length=4.0):
    height, length = number("height", height), number("length", length, above=0.0)
    t = np.clip(np.linspace(-0.1, 1.1, 49), 0, 1)
    section = height * t**3 * (10 - 15 * t + 6 * t**2)
    return np.tile(section[:, None], 2), 1.2 * length / 48, (-0.1 * length, 0, 0)


_NAMED = {"bumpy": _bumpy, "ditch": _ditch, "ramp": _ramp}
