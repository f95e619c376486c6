"""A smooth height field z = h(x, y): height, slope and curvature, and the foot of a point on it.

h is a bicubic B-spline on a square grid, so it has two continuous derivatives. A field is a tuple

    (c, x0, y0, 1/s, reach, bend, level)

of its coefficients, of which those of cell (i, j) are c[i:i+4, j:j+4]; the corner of cell (0, 0), m;
cells per metre; the least radius of curvature of its hollows, m: no nearer do two of its normals meet
above the ground; the largest curvature of its hollows and humps, 1/m; and the cosine of a slope that
is nowhere exceeded. c ends in three equal rows and columns on every side: beyond, h goes on as it is
there, and nothing is cut off.
"""

from .algebra import borrowed, entry, jit, put2, put6, stage, vec2
from .trace import sqrt, traced

MAX_NEWTON = 60
FOUND = 1e-8
"""Of a cell: Newton's steps shrink quadratically, so the next would change nothing."""

SIXTH = 1.0 / 6.0
FOCUS = 1e-9
"""Where the surface's normals meet, H is infinite: it is bounded as if it were so far from there."""


@jit
def lent(field):
    """The field without its array's reference count; None stays None."""
    if field is None:
        return field  # not the literal: the other kind of call returns a tuple, from here too
    return (borrowed(field[0]), field[1], field[2], field[3], field[4], field[5], field[6])


@jit
def _cell(x, cells):
    """Which of so many cells x is in, or is nearest to, and where in it, from 0 to 1."""
    u = x if x > 0.0 else 0.0  # or not a number: the caller's check finds it
    u = u if u < cells else float(cells)
    i = min(int(u), cells - 1)
    return i, u - i


@traced
def _weights(t):
    """The cubic B-spline's weights, and their first and second derivatives."""
    s = 1.0 - t
    return (
        (SIXTH * s * s * s, SIXTH * (4.0 + t * t * (3.0 * t - 6.0)),
         SIXTH * (4.0 + s * s * (3.0 * s - 6.0)), SIXTH * t * t * t),
        (-0.5 * s * s, t * (1.5 * t - 2.0), s * (2.0 - 1.5 * s), 0.5 * t * t),
        (s, 3.0 * t - 2.0, 3.0 * s - 2.0, t),
    )  # fmt: skip


@traced
def _sum4(w, a, b, c, d):
    """w · (a, b, c, d)."""
    return w[0] * a + w[1] * b + w[2] * c + w[3] * d


@jit
def _row(c, i, j, w):
    """Row i of a cell's coefficients, weighted: the value and two derivatives along it."""
    a0, a1, a2, a3 = c[i, j], c[i, j + 1], c[i, j + 2], c[i, j + 3]
    return _sum4(w[0], a0, a1, a2, a3), _sum4(w[1], a0, a1, a2, a3), _sum4(w[2], a0, a1, a2, a3)


@jit
def height(field, x, y):
    """h, its slopes and its second derivatives at (x, y).

    Returns:
        (h, h_x, h_y, h_xx, h_xy, h_yy), in m, 1 and 1/m.
    """
    c, x0, y0, per_m = field[0], field[1], field[2], field[3]
    i, s = _cell((x - x0) * per_m, c.shape[0] - 3)
    j, t = _cell((y - y0) * per_m, c.shape[1] - 3)
    u, w = _weights(s), _weights(t)
    a, a_y, a_yy = _row(c, i, j, w)
    b, b_y, b_yy = _row(c, i + 1, j, w)
    d, d_y, d_yy = _row(c, i + 2, j, w)
    e, e_y, e_yy = _row(c, i + 3, j, w)
    return (
        _sum4(u[0], a, b, d, e),
        _sum4(u[1], a, b, d, e) * per_m,
        _sum4(u[0], a_y, b_y, d_y, e_y) * per_m,
        _sum4(u[2], a, b, d, e) * (per_m * per_m),
        _sum4(u[1], a_y, b_y, d_y, e_y) * (per_m * per_m),
        _sum4(u[0], a_yy, b_yy, d_yy, e_yy) * (per_m * per_m),
    )


@jit
def bounds(field, r):
    """(least, most) that φ of a point can be, from its height over the field straight below: no foot, m.

    That far it is to the surface at most, and no less than if the field rose towards the point at its
    steepest; under the ground the other way round.
    """
    d = r[2] - height(field, r[0], r[1])[0]
    return (field[6] * d, d) if d > 0.0 else (d, field[6] * d)


@stage
def foot(field, r):
    """φ of a point over the field, the normal at its foot, and the Hessian of φ (Eqs. 4 and 5).

    The foot is where |r − (X, Y, h)|² is least: Newton's method from the point straight below r, held
    to go down. φ is the distance to the nearest point of the surface where that is below `reach`; beyond,
    perhaps to another, but no nearer than `reach`. The sign is that of z − h, always.

    Args:
        field: as above.
        r: (3,) m, world.

    Returns:
        (phi, N, H): m; (3,) unit, out of the ground; and (xx, xy, xz, yy, yz, zz) of the symmetric
        matrix H in world axes, 1/m. H N = 0: along N the distance is straight.
    """
    x, y, z = r
    found = FOUND / field[3]
    X, Y = x, y
    X0, Y0, dX, dY = x, y, 0.0, 0.0
    least = -1.0
    h, h_x, h_y, h_xx, h_xy, h_yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(MAX_NEWTON):
        h, h_x, h_y, h_xx, h_xy, h_yy = height(field, X, Y)
        u, v, w = x - X, y - Y, z - h
        far = u * u + v * v + w * w
        if least >= 0.0 and far > least and dX * dX + dY * dY > found * found:
            dX, dY = 0.25 * dX, 0.25 * dY
        else:
            least, X0, Y0 = far, X, Y
            a, b, d = 1.0 + h_x * h_x - w * h_xx, h_x * h_y - w * h_xy, 1.0 + h_y * h_y - w * h_yy
            det = a * d - b * b
            if not (a > 0.0 and det > 0.0):  # not a hollow of |r − (X, Y, h)|²: as if the ground were flat
                a, b, d = 1.0 + h_x * h_x, h_x * h_y, 1.0 + h_y * h_y
                det = a * d - b * b
            down_x, down_y = u + w * h_x, v + w * h_y
            dX, dY = (d * down_x - b * down_y) * (1.0 / det), (a * down_y - b * down_x) * (1.0 / det)
            if not dX * dX + dY * dY > found * found:
                break
        X, Y = X0 + dX, Y0 + dY

    # the last step, too short to need another look at the field
    w = z - (h + dX * (h_x + 0.5 * (h_xx * dX + h_xy * dY)) + dY * (h_y + 0.5 * (h_xy * dX + h_yy * dY)))
    h_x, h_y = h_x + h_xx * dX + h_xy * dY, h_y + h_xy * dX + h_yy * dY
    n = 1.0 / sqrt(1.0 + h_x * h_x + h_y * h_y)
    N = (-h_x * n, -h_y * n, n)
    phi = N[0] * (x - X0 - dX) + N[1] * (y - Y0 - dY) + N[2] * w

    # S = −P h″ P n, the surface's own curvature, with P = I − N Nᵀ; its trace and its determinant in P
    s_x, s_y = -n * (h_xx * N[0] + h_xy * N[1]), -n * (h_xy * N[0] + h_yy * N[1])
    s_n = s_x * N[0] + s_y * N[1]
    trace = -n * (h_xx + h_yy) - s_n
    det = n * n * n * n * (h_xx * h_yy - h_xy * h_xy)
    # H = S (I + φ S)⁻¹ = (S + φ det P) / (1 + φ trace + φ² det)
    g = phi * det
    scale = 1.0 / max(FOCUS, 1.0 + phi * (trace + g))
    s_n -= g
    H = (
        scale * (-n * h_xx - 2.0 * N[0] * s_x + N[0] * N[0] * s_n + g),
        scale * (-n * h_xy - N[0] * s_y - N[1] * s_x + N[0] * N[1] * s_n),
        scale * (-N[2] * s_x + N[0] * N[2] * s_n),
        scale * (-n * h_yy - 2.0 * N[1] * s_y + N[1] * N[1] * s_n + g),
        scale * (-N[2] * s_y + N[1] * N[2] * s_n),
        scale * (N[2] * N[2] * s_n + g),
    )
    return phi, N, H


@traced
def tangents(N):
    """t1 and t2 of a field's normal: t1 is the x-axis, tilted. They turn without a jump as N does."""
    s = 1.0 / sqrt(N[0] * N[0] + N[2] * N[2])
    t1 = (N[2] * s, 0.0, -N[0] * s)
    return t1, (N[1] * t1[2], N[2] * t1[0] - N[0] * t1[2], -N[1] * t1[0])


@traced
def times_symmetric(H, a):
    """H a, of the symmetric H (xx, xy, xz, yy, yz, zz)."""
    return (
        H[0] * a[0] + H[1] * a[1] + H[2] * a[2],
        H[1] * a[0] + H[3] * a[1] + H[4] * a[2],
        H[2] * a[0] + H[4] * a[1] + H[5] * a[2],
    )


@entry
def feet(field, points, out):
    """`foot` of points (n, 3); out (n, 10) is filled with φ, N and H of each."""
    field_ = lent(field)
    for k in range(points.shape[0]):
        phi, N, H = foot(field_, vec2(points, k, 0))
        out[k, 0] = phi
        put2(out, k, 1, N)
        put6(out, k, 4, H)


@entry
def heights(field, x, y, out):
    """h at (x, y), all (n,), into out."""
    field_ = lent(field)
    for k in range(out.shape[0]):
        out[k] = height(field_, x[k], y[k])[0]
