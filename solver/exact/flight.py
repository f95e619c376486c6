"""Free flight, in closed form, and the first time that a hull point touches the ground: certified.

A hull point's gap z obeys z'' = a·N + N·(ẇ × b + w × (w × b)). The motion's largest w·w is known, and
|ẇ| <= w·w/√3 for any real body, so z'' and z''' have bounds that hold for the whole flight. From z and
z' they give a step in which no root can lie. Such steps, until the gap is closed, miss nothing at any
speed; near the root they are Newton's, from above.
"""

from math import inf, sqrt

from ..algebra import add, axpy, cross, dot, jit, matrix, stage, to_body, vec2
from ..contact import centripetal, gyroscopic
from ..model import TOUCH, bending, height_over, meet
from .attitude import at

CLOSED = 1e-13
"""m: a gap this small is zero. A point that passes higher than this, however little, passes."""

BEND = 1.0 + 3.0**-0.5
"""The rotation's part of z'' is at most BEND |w|² |b|."""

JERK = 1.0 + 4.0 * 3.0**-0.5 + (2.0 / 3.0) ** 0.5
"""The third derivative of z is at most JERK |w|³ |b|: four terms hold |w| |ẇ|, one J's ẅ <= √2 |w| |ẇ|."""

HOVER = 1e-10
"""m: how deep a point may come that hovers: z' within TOUCH of 0, z'' within 1e-12 of its bound; and one that
leaves curved ground."""


@jit
def fly(body, anchor, a, x, v, t):
    """The free motion t seconds after its start: a parabola, and the attitude in closed form.

    Args:
        body: (m, 1/m, J, 1/J, bound).
        anchor: of `attitude.anchor`, at the start.
        a: acceleration of the centre of mass, m/s².
        x: centre of mass at the start, m.
        v: its velocity at the start, m/s.
        t: s.

    Returns:
        (x, quat, v, w); w in body axes.
    """
    quat, w = at(anchor, t)
    return axpy(t, axpy(0.5 * t, a, v), x), quat, axpy(t, a, v), w


@jit
def hollow(field, speed):
    """The most by which a hollow of curved ground lets a point's gap bend down, (ċᵀHċ of Eq. 5), m/s².

    As far as half the least radius of curvature above it, where H is at most twice the curvature.
    """
    if field is None:
        return 0.0
    return 2.0 * field[5] * speed * speed


@jit
def within(field, z, radius):
    """A gap z, or as much of it as `hollow` holds for, m."""
    if field is None:
        return z
    return min(z, 0.5 * field[4] - radius)


@stage
def first_touch(body, hull, ground, anchor, a, x, v, t_min, near, t_max):
    """The first time in [t_min, t_max] at which a hull point's gap comes down through zero, and which.

    At t = 0 a point nearer than `near` to the surface, or below it, counts if it closes: faster
    than TOUCH (m/s), or, slower than that either way, with z'' < 0. One that leaves, or is at rest and
    accelerates away, does not: it is found when it comes back. Later, a point counts from a gap of
    CLOSED (1e-13 m) on under the same rule: the returned time is never late, and the point stands
    within CLOSED, or the rounding of x if that is more. So a point that grazes the surface is a touch
    only if it comes as near as CLOSED and is not slower than TOUCH there.

    Args:
        body: (m, 1/m, J, 1/J, bound).
        hull: (p, 4) points in principal axes and their radii, m.
        ground: (N, t1, t2, d, field).
        anchor: of `attitude.anchor`, at the start.
        a: acceleration of the centre of mass, m/s².
        x: centre of mass at the start, m.
        v: its velocity at the start, m/s.
        t_min: s; 0, or a later time up to which nothing touches.
        near: m.
        t_max: s, finite.

    Returns:
        (t, k): s, and the row of the hull; of several points the lowest. (t_max, -1) if none touches,
        or if something is not a number.
    """
    t, k, _evaluations = march(body, hull, ground, anchor, a, x, v, t_min, near, t_max)
    return t, k


@jit
def horizon(field, pull, speed, size):
    """For how long, s, and up to which speed bounds of what follows hold; for ever on a ground."""
    if field is None or pull == 0.0:
        return inf, speed
    speed = max(speed, sqrt(pull * size))
    return speed / pull, 2.0 * speed


@jit
def most(field, aN, pull):
    """The most that a centre of mass can be accelerated towards the ground, m/s²."""
    if field is None:
        return -aN
    return pull


@jit
def ascent(field, z, speed, bend, bound, jerk, still):
    """How long a point stays above the ground that leaves, or is at rest and accelerates away, s."""
    s = falls(z, speed, -bound)
    if field is None:
        return max(s, rises(max(speed, 0.0), bend, jerk, still and bend >= -1e-12 * abs(bound)))
    return falls(z + HOVER, max(speed, 0.0), -bound)


@jit
def flown(hull, k, field, view, a_b, v_b, w, w_dot):
    """(z, z', z'') of hull point k's gap in flight; vectors in body axes, `view` as of `model.seen`."""
    b = vec2(hull, k, 0)
    z, N_b, H = meet(hull, k, field, view)
    speed = dot(N_b, add(v_b, cross(w, b)))
    bend = dot(N_b, add(a_b, centripetal(w, w_dot, b, b))) + bending(field, H, view[0], b, v_b, w)
    return z, speed, bend


@stage
def march(body, hull, ground, anchor, a, x, v, t_min, near, t_max):
    """`first_touch`, and the number of poses that it took."""
    N, field = ground[0], ground[4]
    aN, vN, height = dot(a, N), dot(v, N), height_over(ground, x)
    pull = sqrt(dot(a, a))
    spin2 = anchor[4][2] * (1.0 + 1e-6)  # for the slack in J1 + J2 >= J3, and rounding
    spin = sqrt(spin2)
    t, evaluations = t_min, 0
    while True:
        h, h_dot = height + t * (vN + 0.5 * t * aN), vN + t * aN
        free = 0.0
        if h > body[4] + TOUCH:  # nothing can touch while the bounding sphere does not
            free = falls(h - body[4], h_dot, aN)
        if free <= 1e-6 * t_max:
            if t > 0.0:
                near = CLOSED
            v1 = axpy(t, a, v)
            quat, w = at(anchor, t)
            evaluations += 1
            R = matrix(quat)
            N_b, v_b, a_b = to_body(R, N), to_body(R, v1), to_body(R, a)
            view = R, axpy(t, axpy(0.5 * t, a, v), x), (N_b, N_b, N_b), h
            w_dot = gyroscopic(body[2], body[3], w)
            lowest, touched = inf, -1
            span, fast = horizon(field, pull, sqrt(dot(v1, v1)) + spin * body[4], body[4])
            for k in range(hull.shape[0]):
                b = vec2(hull, k, 0)
                z, speed, bend = flown(hull, k, field, view, a_b, v_b, w, w_dot)
                reach = sqrt(dot(b, b))
                bound = BEND * spin2 * reach + most(field, aN, pull) + hollow(field, fast)
                if not abs(z) + abs(speed) + abs(bend) < inf:
                    return t_max, -1, evaluations
                still = abs(speed) <= TOUCH
                closes = bend < -1e-12 * abs(bound) if still else speed < 0.0
                if z <= near and closes:
                    if z < lowest:
                        lowest, touched = z, k
                    continue
                z = within(field, z, hull[k, 3])
                s = falls(max(z, 0.0), speed, -bound)
                if still or speed > 0.0:
                    s = ascent(field, max(z, 0.0), speed, bend, bound, JERK * spin2 * spin * reach, still)
                span = min(span, s)
                if t + s == t and z < lowest:  # closer in time than rounding
                    lowest, touched = z, k
            if touched >= 0:
                return t, touched, evaluations
            free = max(free, span)
        t += free
        if not t <= t_max:  # or not a number
            return t_max, -1, evaluations


@jit
def falls(z, speed, bend):
    """The smallest s > 0 with z + z' s + z'' s²/2 = 0, for z >= 0; infinite if there is none."""
    square = speed * speed - 2.0 * bend * z
    if square < 0.0:
        return inf
    root = sqrt(square)
    if speed < 0.0:
        return 2.0 * z / (root - speed)
    return (speed + root) / -bend if bend < 0.0 else inf


@jit
def rises(speed, bend, jerk, hovers):
    """How long z' s + z'' s²/2 − jerk s³/6 stays above zero, for z' >= 0; if z hovers, above −HOVER."""
    if jerk == 0.0:
        return inf if bend >= 0.0 else -2.0 * speed / bend
    s = 1.5 * (bend + sqrt(bend * bend + (8.0 / 3.0) * jerk * speed)) / jerk
    return max(s, (6.0 * HOVER / jerk) ** (1.0 / 3.0)) if hovers else s
