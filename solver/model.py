"""What every method's kernel shares: the scene as tuples, the gap, and the contacts' memory.

A kernel sees the body as (m, 1/m, J, 1/J, radius of the bounding sphere), with J in principal axes;
the hull as a (p, 4) array of points in those axes and their radii; the ground as (N, t1, t2, d, field);
and the motion as x, quat, v in world and w in principal axes.

The ground is the plane N·r = d with its tangents where `field` is None. Else it is a height field, and
the plane the lowest level one that nothing of it is above. Which of them is a matter of *type*, decided
when a kernel is compiled: a plane's has no trace of the other. It is decided in functions that have
`field` as an argument, as only there numba does not even look at the branch that is out.
"""

import numpy as np

from .algebra import axpy, cross, dot, jit, put, put_quat, to_body, to_world, vec, vec2
from .contact import normal_speed
from .field import bounds, foot, lent, times_symmetric
from .trace import traced

TOUCH = 1e-9
"""m: a hull point this close to the surface touches it. m/s: slower than this counts as still."""

# What a method remembers of each hull point from step to step: a state, then the contact's force along
# (N, t1, t2) in the last step, N, from which "impulse" starts its next guess.
MEMORY = 4
OPEN, CLOSED, LATE = 0.0, 1.0, 2.0

FLAT = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""A plane's H, 1/m."""

# Flags that kernels return.
OK, NOT_FINITE, PAINLEVE, STUCK, CROWDED = 0, 1, 2, 3, 4


@jit
def unpack(body, ground):
    """The kernels' tuples from the flat (m, J, bound), and from a flat (N, t1, t2, d) with a field."""
    J = vec(body, 1)
    plane, field = ground
    inv_J = (1.0 / J[0], 1.0 / J[1], 1.0 / J[2])
    return (
        (body[0], 1.0 / body[0], J, inv_J, body[4]),
        (vec(plane, 0), vec(plane, 3), vec(plane, 6), plane[9], lent(field)),
    )


@traced
def load(state):
    """(x, quat, v, w) from 13 entries."""
    return vec(state, 0), (state[3], state[4], state[5], state[6]), vec(state, 7), vec(state, 10)


@traced
def store(state, x, quat, v, w):
    """The inverse of `load`."""
    put(state, 0, x)
    put_quat(state, 3, quat)
    put(state, 7, v)
    put(state, 10, w)


@traced
def gap(hull, k, N_b, height):
    """φ of hull point k: signed distance from the surface, its radius subtracted (Eq. 4), m.

    Args:
        hull: (p, 4).
        k: which point.
        N_b: the normal in body axes.
        height: of the centre of mass above the plane, m.
    """
    return dot(N_b, vec2(hull, k, 0)) + height - hull[k, 3]


@traced
def height_over(plane, x):
    """Distance of the centre of mass above the plane, m."""
    return dot(plane[0], x) - plane[3]


@traced
def arm(hull, k, N_b):
    """(b, q): from x to the hull point and to its contact point r1, body axes, m."""
    b = vec2(hull, k, 0)
    return b, axpy(-hull[k, 3], N_b, b)


@traced
def seen(ground, R, x):
    """The ground from a pose: R, x, the plane's (N, t1, t2) in body axes, and the height of x over it."""
    frame = (to_body(R, ground[0]), to_body(R, ground[1]), to_body(R, ground[2]))
    return R, x, frame, height_over(ground, x)


@traced
def centre(hull, k, view):
    """Hull point k, not its contact point, in world axes, m."""
    return axpy(1.0, view[1], to_world(view[0], vec2(hull, k, 0)))


@jit
def meet(hull, k, field, view):
    """(φ, N, H) of hull point k: its gap, the normal in body axes, the Hessian of φ in world axes."""
    R, _x, frame, height = view
    if field is None:
        return gap(hull, k, frame[0], height), frame[0], FLAT
    phi, N, H = foot(field, centre(hull, k, view))
    return phi - hull[k, 3], to_body(R, N), H


@jit
def gap_of(hull, k, field, view):
    """φ of hull point k, m."""
    return meet(hull, k, field, view)[0]


@jit
def gap_if_below(hull, k, ground, field, view, limit):
    """φ of hull point k, m, or over a height field, if it is certain to be above `limit`, ∞.

    Nothing of the field is above the ground's plane. So φ is at least the height over that, and what its
    height over the field straight below allows, either of which costs less than its foot.
    """
    if field is None:
        return gap(hull, k, view[2][0], view[3])
    r = centre(hull, k, view)
    most = limit + hull[k, 3]
    if r[2] - ground[3] > most or bounds(field, r)[0] > most:
        return np.inf
    return foot(field, r)[0] - hull[k, 3]


@jit
def passes_over(hull, k, field, view, view1, sag):
    """Is hull point k certain to stay over the field between two poses, if it sags by `sag` at most, m?"""
    if field is None:
        return False
    low = min(bounds(field, centre(hull, k, view))[0], bounds(field, centre(hull, k, view1))[0])
    return low - hull[k, 3] > sag


@jit
def speed_of(hull, k, field, view, v, w):
    """Eq. 8's v of hull point k, m/s; v in world axes."""
    _phi, N, _H = meet(hull, k, field, view)
    _b, q = arm(hull, k, N)
    return normal_speed(N, q, to_body(view[0], v), w)


@traced
def upward(ground, field, R, N):
    """N in world axes."""
    if field is None:
        return ground[0]
    return to_world(R, N)


@traced
def bending(field, H, R, b, v, w):
    """ċᵀ H ċ of a hull point at b: how the ground bends away under it (Eq. 5's c), m/s². v in body axes."""
    if field is None:
        return 0.0
    u = to_world(R, axpy(1.0, v, cross(w, b)))
    return dot(u, times_symmetric(H, u))


@traced
def is_finite(x, quat, v, w):
    """False if any entry is NaN or infinite."""
    s = (x[0] + x[1] + x[2]) + (v[0] + v[1] + v[2]) + (w[0] + w[1] + w[2])
    return 0.0 * (s + (quat[0] + quat[1] + quat[2] + quat[3])) == 0.0
