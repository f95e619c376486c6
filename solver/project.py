"""Positions alone: which points have come down, and putting them back onto the surface."""

import numpy as np

from .algebra import apart, axpy, cross, dot, jit, matrix, put2, scale, stage, to_body, to_world, vec2
from .contact import inverse_mass, shift
from .field import bounds
from .flight import turn
from .model import CLOSED, OPEN, TOUCH, arm, centre, gap, gap_if_below, height_over, meet, seen
from .sweep import HELD, POINT, RHO, RISE, ROLL, B, stand
from .trace import filled, largest, least, most, no, some, sqrt, traced, where

MAX_JOIN = 8
MAX_PROJECT = 8
MAX_PUSH_OUT = 32
GAP_TOLERANCE = 1e-13
SHARED_TOLERANCE = 5e-9
"""m: several points, which disturb one another, need not be nearer."""


@jit
def certain(field, g, radius):
    """How far a hull point with gap g is from a height field at least, m."""
    return min(g, field[4] - radius)


@jit
def clearance(hull, ground, quat, x, contacts, enough):
    """Gap of the OPEN point that is deepest, or what is certain of it; inf if none is open.

    Over a height field less is said where that is more than `enough`, too: it costs less.
    """
    return clearance_over(hull, ground, ground[4], seen(ground, matrix(quat), x), contacts, enough)


@jit
def clearance_over(hull, ground, field, view, contacts, enough):
    """`clearance` from a view of the ground."""
    if field is not None:
        return clearance_on_field(hull, ground, view, contacts, enough)
    deepest = filled(view[3], np.inf)
    for k in range(hull.shape[0]):
        deepest = _deeper(hull, k, view[2][0], view[3], contacts, deepest)
    return deepest


@stage
def clearance_on_field(hull, ground, view, contacts, enough):
    """The same over a height field."""
    apart()
    low, limit = _between(hull, ground, view, contacts)
    if low > enough:
        return low
    deepest = np.inf
    for k in range(hull.shape[0]):
        if contacts[k, 0] == OPEN:
            g = gap_if_below(hull, k, ground, ground[4], view, min(limit, deepest))
            deepest = min(deepest, certain(ground[4], g, hull[k, 3]))
    return deepest


@jit
def _between(hull, ground, view, contacts):
    """(least, most) that the gap of the OPEN point can be that is deepest, m, over a height field."""
    low, high = np.inf, np.inf
    for k in range(hull.shape[0]):
        if contacts[k, 0] == OPEN:
            r = centre(hull, k, view)
            over = r[2] - ground[3] - hull[k, 3]
            if over < high:  # nothing of the field is above the ground's plane
                least_, most_ = bounds(ground[4], r)
                low, high = min(low, least_ - hull[k, 3]), min(high, most_ - hull[k, 3])
            else:
                low = min(low, over)
    return low, high


@traced
def _deeper(hull, k, N_b, height, contacts, deepest):
    """Point k's gap over a plane, if it is OPEN and that is less than `deepest`."""
    return where(contacts[k, 0] == OPEN, least(deepest, gap(hull, k, N_b, height)), deepest)


@jit
def lowest_open(hull, ground, quat, x, contacts):
    """Index and gap of the OPEN point that is deepest; (-1, inf) if none is open."""
    return lowest_open_over(hull, ground, ground[4], seen(ground, matrix(quat), x), contacts)


@jit
def lowest_open_over(hull, ground, field, view, contacts):
    """`lowest_open` from a view of the ground."""
    deepest, at = np.inf, -1
    limit = np.inf if field is None else _between(hull, ground, view, contacts)[1]
    for k in range(hull.shape[0]):
        if contacts[k, 0] == OPEN:
            g = gap_if_below(hull, k, ground, field, view, min(limit, deepest))
            if g < deepest:
                deepest, at = g, k
    return at, deepest


@traced
def joins(field):
    """The gap below which a point joins the correction of others, m."""
    if field is None:
        return 0.0
    return SHARED_TOLERANCE  # those that were just put right, one by one, stay in


@jit
def project(body, hull, ground, x, quat, w, contacts, rows, n, clear):
    """Positions alone, along M⁻¹Wᵀ: the first n rows' points onto the surface, or out of it.

    A CLOSED point goes onto the surface from either side, any other only out of it; one that the
    correction itself turns into the ground joins. The world's angular momentum stays, so w turns with
    the body.

    Returns:
        (x, quat, w, clear): the last as in `step`.
    """
    for c in range(n):
        rows[c, HELD] = 1.0 if contacts[int(rows[c, POINT]), 0] == CLOSED else 0.0
    for _ in range(MAX_JOIN):
        x, quat, w, moved = shove(body, hull, ground, ground[4], x, quat, w, rows, n)
        clear -= moved
        if moved == 0.0 or clear > TOUCH:
            break
        clear = clearance(hull, ground, quat, x, contacts, TOUCH)
        if clear >= -SHARED_TOLERANCE:
            break
        view = seen(ground, matrix(quat), x)
        n = 0
        for k in range(hull.shape[0]):
            held = contacts[k, 0] == CLOSED
            near = joins(ground[4])
            if held or gap_if_below(hull, k, ground, ground[4], view, near) < near:
                stand(rows, n, hull, k)
                rows[n, HELD] = 1.0 if held else 0.0
                n += 1
    return x, quat, w, clear


@jit
def shove(body, hull, ground, field, x, quat, w, rows, n):
    """One correction for the first n rows' points, to first order in itself: it is small.

    Returns:
        (x, quat, w, moved): the last is more than any hull point has moved, m; 0 if nothing was off.
    """
    if field is not None:
        return shove_on_field(body, hull, ground, x, quat, w, rows, n)
    return shove_on_plane(body, ground, x, quat, w, rows, n)


@traced
def _off(rows, c, on, N_b, height, worst):
    """How far off the surface row c's point is, if that is more than `worst`."""
    g = gap_in(rows, c, N_b, height)
    return where(on, most(worst, where(rows[c, HELD] > 0.0, abs(g), -g)), worst)


@traced
def gap_in(rows, c, N_b, height):
    """φ of row c's hull point, m."""
    return dot(N_b, vec2(rows, c, B)) + height - rows[c, RHO]


@traced
def round_at(rows):
    """Is the first row's point round?"""
    return rows[0, RHO] > 0.0


@traced
def _levered(rows, c, inv_m, inv_J, N_b):
    """Row c gets what a metre of its gap asks for: rise and roll."""
    q = axpy(-rows[c, RHO], N_b, vec2(rows, c, B))
    rise, roll = shift(inv_m, inv_J, N_b, q, inverse_mass(inv_m, inv_J, N_b, q), 1.0)
    rows[c, RISE] = rise
    put2(rows, c, ROLL, roll)


@traced
def _righted(rows, c, on, N_b, up, height, lift, e, worst):
    """Row c's point put right, to first order, where it is off."""
    g = gap_in(rows, c, up, height + lift)
    on = on & ((g < 0.0) | (rows[c, HELD] > 0.0))
    worst = where(on, most(worst, abs(g)), worst)
    e1 = axpy(0.5 * g, vec2(rows, c, ROLL), e)
    up1 = axpy(2.0, cross(N_b, e1), N_b)
    return where(on, (up1, lift + g * rows[c, RISE], e1), (up, lift, e)), worst


@traced
def _shoved(J, inv_J, bound, N, x, quat, w, lift, e, off, round_one, g):
    """The pose after a correction, where one was needed."""
    quat1, w1 = turn(J, inv_J, quat, w, e)
    moved = abs(lift) + 2.0 * bound * sqrt(dot(e, e))
    x1, quat1, w1, moved = where(
        round_one, (axpy(-g, N, x), quat, w, abs(g)), (axpy(lift, N, x), quat1, w1, moved)
    )
    return where(off, (x1, quat1, w1, moved), (x, quat, w, 0.0))


@jit
def shove_on_plane(body, ground, x, quat, w, rows, n):
    """`shove` over a plane."""
    _m, inv_m, J, inv_J, bound = body
    N = ground[0]
    N_b = to_body(matrix(quat), N)
    height = height_over(ground, x)
    tolerance = where(n == 1, GAP_TOLERANCE, SHARED_TOLERANCE)
    worst = filled(height, 0.0)
    for c in range(int(largest(n))):
        worst = _off(rows, c, c < n, N_b, height, worst)
    off = worst > tolerance
    if not some(off):
        return x, quat, w, filled(height, 0.0)
    # A round point, alone: lifting keeps w, so Jellett's integral L·q, too. Along M⁻¹Wᵀ a sharp
    # one gains less energy.
    round_one = (n == 1) & round_at(rows)
    up = N_b
    lift = filled(height, 0.0)
    e = (lift, lift, lift)
    live = off & no(round_one)
    if some(live):
        for c in range(int(largest(n))):
            _levered(rows, c, inv_m, inv_J, N_b)
    for _ in range(MAX_PROJECT):
        worst = filled(height, 0.0)
        for c in range(int(largest(n))):
            (up, lift, e), worst = _righted(rows, c, live & (c < n), N_b, up, height, lift, e, worst)
        live = live & (worst > tolerance)
        if not some(live):
            break
    g = gap_in(rows, 0, N_b, height)
    return _shoved(J, inv_J, bound, N, x, quat, w, lift, e, off, round_one, g)


@stage
def shove_on_field(body, hull, ground, x, quat, w, rows, n):
    """The same where every point has its own normal, which turns as the body is moved: one by one.

    Four points or more cannot all lie on curved ground. Where that shows, they are only kept out of it.
    """
    apart()
    _m, inv_m, J, inv_J, bound = body
    tolerance = GAP_TOLERANCE if n == 1 else SHARED_TOLERANCE
    moved = 0.0
    for sweep in range(MAX_PROJECT + MAX_PUSH_OUT):
        settled = True
        for c in range(n):
            k = int(rows[c, POINT])
            R = matrix(quat)
            g, N, _H = meet(hull, k, ground[4], seen(ground, R, x))
            down = rows[c, HELD] > 0.0 and sweep < MAX_PROJECT
            if abs(g) <= tolerance or (g > 0.0 and not down):
                continue
            settled = False
            lift, e = -g, (0.0, 0.0, 0.0)
            if n > 1 or hull[k, 3] == 0.0:
                _b, q = arm(hull, k, N)
                lift, e = shift(inv_m, inv_J, N, q, inverse_mass(inv_m, inv_J, N, q), g)
                e = scale(0.5, e)
                quat, w = turn(J, inv_J, quat, w, e)
            x = axpy(lift, to_world(R, N), x)
            moved += abs(lift) + 2.0 * bound * sqrt(dot(e, e))
        if settled:
            break
    return x, quat, w, moved
