"""Positions alone: which points have come down, and putting them back onto the surface."""

from math import sqrt

import numpy as np

from .algebra import axpy, cross, dot, jit, matrix, put2, scale, stage, to_body, to_world, vec2
from .contact import inverse_mass, shift
from .flight import turn
from .model import CLOSED, OPEN, TOUCH, arm, gap, gap_of, height_over, meet, seen
from .sweep import POINT, RISE, ROLL

MAX_JOIN = 8
MAX_PROJECT = 8
MAX_PUSH_OUT = 32
GAP_TOLERANCE = 1e-13
SHARED_TOLERANCE = 5e-9
"""m: several points, which disturb one another, need not be nearer."""


@jit
def certain(field, g, radius):
    """How far a hull point with gap g is from the ground at least, m."""
    if field is None:
        return g
    return min(g, field[4] - radius)


@jit
def clearance(hull, ground, quat, x, contacts):
    """Gap of the OPEN point that is deepest, or what is certain of it; inf if none is open."""
    view = seen(ground, matrix(quat), x)
    deepest = np.inf
    for k in range(hull.shape[0]):
        if contacts[k, 0] == OPEN:
            g = gap_of(hull, k, ground[4], view)
            deepest = min(deepest, certain(ground[4], g, hull[k, 3]))
    return deepest


@jit
def lowest_open(hull, ground, quat, x, contacts):
    """Index and gap of the OPEN point that is deepest; (-1, inf) if none is open."""
    view = seen(ground, matrix(quat), x)
    deepest, at = np.inf, -1
    for k in range(hull.shape[0]):
        g = gap_of(hull, k, ground[4], view)
        if g < deepest and contacts[k, 0] == OPEN:
            deepest, at = g, k
    return at, deepest


@jit
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
    for _ in range(MAX_JOIN):
        x, quat, w, moved = shove(body, hull, ground, ground[4], x, quat, w, contacts, rows, n)
        clear -= moved
        if moved == 0.0 or clear > TOUCH:
            break
        clear = clearance(hull, ground, quat, x, contacts)
        if clear >= -SHARED_TOLERANCE:
            break
        view = seen(ground, matrix(quat), x)
        n = 0
        for k in range(hull.shape[0]):
            if contacts[k, 0] == CLOSED or gap_of(hull, k, ground[4], view) < joins(ground[4]):
                rows[n, POINT] = k
                n += 1
    return x, quat, w, clear


@jit
def shove(body, hull, ground, field, x, quat, w, contacts, rows, n):
    """One correction for the first n rows' points, to first order in itself: it is small.

    Returns:
        (x, quat, w, moved): the last is more than any hull point has moved, m; 0 if nothing was off.
    """
    if field is not None:
        return shove_on_field(body, hull, ground, x, quat, w, contacts, rows, n)
    _m, inv_m, J, inv_J, bound = body
    N = ground[0]
    N_b = to_body(matrix(quat), N)
    height = height_over(ground, x)
    tolerance = GAP_TOLERANCE if n == 1 else SHARED_TOLERANCE
    worst = 0.0
    for c in range(n):
        k = int(rows[c, POINT])
        g = gap(hull, k, N_b, height)
        worst = max(worst, abs(g) if contacts[k, 0] == CLOSED else -g)
    if worst <= tolerance:
        return x, quat, w, 0.0
    k = int(rows[0, POINT])
    if n == 1 and hull[k, 3] > 0.0:
        # A round point, alone: lifting keeps w, so Jellett's integral L·q, too. Along M⁻¹Wᵀ a sharp
        # one gains less energy.
        g = gap(hull, k, N_b, height)
        return axpy(-g, N, x), quat, w, abs(g)

    for c in range(n):
        _b, q = arm(hull, int(rows[c, POINT]), N_b)
        rise, roll = shift(inv_m, inv_J, N_b, q, inverse_mass(inv_m, inv_J, N_b, q), 1.0)
        rows[c, RISE] = rise
        put2(rows, c, ROLL, roll)
    up = N_b
    lift = 0.0
    e = (0.0, 0.0, 0.0)
    for _ in range(MAX_PROJECT):
        worst = 0.0
        for c in range(n):
            k = int(rows[c, POINT])
            g = gap(hull, k, up, height + lift)
            if g < 0.0 or contacts[k, 0] == CLOSED:
                worst = max(worst, abs(g))
                lift += g * rows[c, RISE]
                e = axpy(0.5 * g, vec2(rows, c, ROLL), e)
                up = axpy(2.0, cross(N_b, e), N_b)
        if worst <= tolerance:
            break
    quat, w = turn(J, inv_J, quat, w, e)
    return axpy(lift, N, x), quat, w, abs(lift) + 2.0 * bound * sqrt(dot(e, e))


@stage
def shove_on_field(body, hull, ground, x, quat, w, contacts, rows, n):
    """The same where every point has its own normal, which turns as the body is moved: one by one.

    Four points or more cannot all lie on curved ground. Where that shows, they are only kept out of it.
    """
    _m, inv_m, J, inv_J, bound = body
    tolerance = GAP_TOLERANCE if n == 1 else SHARED_TOLERANCE
    moved = 0.0
    for sweep in range(MAX_PROJECT + MAX_PUSH_OUT):
        settled = True
        for c in range(n):
            k = int(rows[c, POINT])
            R = matrix(quat)
            g, N, _H = meet(hull, k, ground[4], seen(ground, R, x))
            down = contacts[k, 0] == CLOSED and sweep < MAX_PROJECT
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
