"""Positions alone: which points have come down, and putting them back onto the surface."""

from math import sqrt

import numpy as np

from .algebra import axpy, cross, dot, jit, matrix, put2, to_body, vec2
from .contact import inverse_mass, shift
from .flight import turn
from .model import CLOSED, OPEN, TOUCH, arm, gap, height_over
from .sweep import POINT, RISE, ROLL

MAX_JOIN = 8
MAX_PROJECT = 8
GAP_TOLERANCE = 1e-13
SHARED_TOLERANCE = 5e-9
"""m: several points, which disturb one another, need not be nearer."""


@jit
def clearance(hull, plane, quat, x, contacts):
    """Gap of the OPEN point that is deepest; inf if none is open."""
    N_b = to_body(matrix(quat), plane[0])
    height = height_over(plane, x)
    deepest = np.inf
    for k in range(hull.shape[0]):
        deepest = min(deepest, gap(hull, k, N_b, height) if contacts[k, 0] == OPEN else np.inf)
    return deepest


@jit
def lowest_open(hull, plane, quat, x, contacts):
    """Index and gap of the OPEN point that is deepest; (-1, inf) if none is open."""
    N_b = to_body(matrix(quat), plane[0])
    height = height_over(plane, x)
    deepest, at = np.inf, -1
    for k in range(hull.shape[0]):
        g = gap(hull, k, N_b, height)
        if g < deepest and contacts[k, 0] == OPEN:
            deepest, at = g, k
    return at, deepest


@jit
def project(body, hull, plane, x, quat, w, contacts, rows, n, clear):
    """Positions alone, along M⁻¹Wᵀ: the first n rows' points onto the surface, or out of it.

    A CLOSED point goes onto the surface from either side, any other only out of it; one that the
    correction itself turns into the ground joins. The world's angular momentum stays, so w turns with
    the body.

    Returns:
        (x, quat, w, clear): the last as in `step`.
    """
    for _ in range(MAX_JOIN):
        x, quat, w, moved = shove(body, hull, plane, x, quat, w, contacts, rows, n)
        clear -= moved
        if moved == 0.0 or clear > TOUCH:
            break
        clear = clearance(hull, plane, quat, x, contacts)
        if clear >= -SHARED_TOLERANCE:
            break
        N_b = to_body(matrix(quat), plane[0])
        n = 0
        for k in range(hull.shape[0]):
            if contacts[k, 0] == CLOSED or gap(hull, k, N_b, height_over(plane, x)) < 0.0:
                rows[n, POINT] = k
                n += 1
    return x, quat, w, clear


@jit
def shove(body, hull, plane, x, quat, w, contacts, rows, n):
    """One correction for the first n rows' points, to first order in itself: it is small.

    Returns:
        (x, quat, w, moved): the last is more than any hull point has moved, m; 0 if nothing was off.
    """
    _m, inv_m, J, inv_J, bound = body
    N = plane[0]
    N_b = to_body(matrix(quat), N)
    height = height_over(plane, x)
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
