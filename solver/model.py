"""What every method's kernel shares: the scene as tuples, the gap, and the contacts' memory.

A kernel sees the body as (m, 1/m, J, 1/J, radius of the bounding sphere), with J in principal axes;
the hull as a (p, 4) array of points in those axes and their radii; the ground as (N, t1, t2, d), a
plane N·r = d with its tangents; and the motion as x, quat, v in world and w in principal axes.
"""

from .algebra import axpy, dot, jit, put, put_quat, to_body, vec, vec2
from .contact import normal_speed

TOUCH = 1e-9
"""m: a hull point this close to the surface touches it. m/s: slower than this counts as still."""

# What a method remembers of each hull point from step to step: a state, then the contact's force along
# (N, t1, t2) in the last step, N, from which "impulse" starts its next guess.
MEMORY = 4
OPEN, CLOSED, LATE = 0.0, 1.0, 2.0

# Flags that kernels return.
OK, NOT_FINITE, PAINLEVE, STUCK = 0, 1, 2, 3


@jit
def unpack(body, plane):
    """The kernels' tuples from flat arrays (m, J, bound) and (N, t1, t2, d)."""
    J = vec(body, 1)
    inv_J = (1.0 / J[0], 1.0 / J[1], 1.0 / J[2])
    return (
        (body[0], 1.0 / body[0], J, inv_J, body[4]),
        (vec(plane, 0), vec(plane, 3), vec(plane, 6), plane[9]),
    )


@jit
def load(state):
    """(x, quat, v, w) from 13 entries."""
    return vec(state, 0), (state[3], state[4], state[5], state[6]), vec(state, 7), vec(state, 10)


@jit
def store(state, x, quat, v, w):
    """The inverse of `load`."""
    put(state, 0, x)
    put_quat(state, 3, quat)
    put(state, 7, v)
    put(state, 10, w)


@jit
def gap(hull, k, N_b, height):
    """φ of hull point k: signed distance from the surface, its radius subtracted (Eq. 4), m.

    Args:
        hull: (p, 4).
        k: which point.
        N_b: the normal in body axes.
        height: of the centre of mass above the plane, m.
    """
    return dot(N_b, vec2(hull, k, 0)) + height - hull[k, 3]


@jit
def height_over(plane, x):
    """Distance of the centre of mass above the plane, m."""
    return dot(plane[0], x) - plane[3]


@jit
def arm(hull, k, N_b):
    """(b, q): from x to the hull point and to its contact point r1, body axes, m."""
    b = vec2(hull, k, 0)
    return b, axpy(-hull[k, 3], N_b, b)


@jit
def closing_speed(hull, k, plane, R, v, w):
    """Eq. 8's v of hull point k, m/s."""
    N_b = to_body(R, plane[0])
    _b, q = arm(hull, k, N_b)
    return normal_speed(N_b, q, to_body(R, v), w)


@jit
def is_finite(x, quat, v, w):
    """False if any entry is NaN or infinite."""
    s = (x[0] + x[1] + x[2]) + (v[0] + v[1] + v[2]) + (w[0] + w[1] + w[2])
    return 0.0 * (s + (quat[0] + quat[1] + quat[2] + quat[3])) == 0.0
