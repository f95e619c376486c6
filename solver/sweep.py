"""Several contacts at once: the single contact solve, swept over the closed ones until they agree.

Block Gauss-Seidel, the per-contact iteration of Hwangbo et al. (IEEE RA-L 3:895, 2018): each block
solves one contact exactly, Eqs. 8 and 10-11, with the others' impulses held. A contact is a row of
numbers here; the solver owns one array of rows and fills the first so many.
"""

import numpy as np

from .algebra import (
    add,
    apart,
    axpy,
    cross,
    dot,
    jit,
    put2,
    put6,
    scale,
    six2,
    stage,
    times,
    vec2,
)
from .friction import cone_impulse, inverse_symmetric
from .trace import filled, largest, most, no, some, sqrt, traced, where

# Columns of a row. Vectors are in body axes. No plain ints: numba compiles a helper anew for each of those.
POINT = np.intp(0)  # index of the hull point
AXES = np.intp(1)  # N, t1, t2
Q = np.intp(10)  # from x to the contact point, m
AIM = np.intp(13)  # velocity asked for, m/s
P = np.intp(16)  # impulse along N, t1, t2, N s
# What only sweeping needs:
ARM = np.intp(19)  # q × N, q × t1, q × t2: the angular part of W, and its like for the tangents
TURN = np.intp(28)  # J⁻¹ times those: rad/s per N s
K = np.intp(37)  # Eq. 10: nn, n1, n2, 11, 12, 22
INV_K = np.intp(43)
TARGET = np.intp(49)  # AIM along N, t1, t2
SLIP = np.intp(52)  # tangential velocity before the impulse, m/s
STEP = np.intp(54)  # what the last sweep changed of P, N s
# What only a height field needs:
NORMAL = np.intp(57)  # N in world axes
# What a step needs to know of the hull point, and of the last step:
B = np.intp(60)  # from x to the hull point, m
RHO = np.intp(63)  # its radius, m
HELD = np.intp(64)  # 1: it is held on the surface; 0: it is kept from passing through
GAP = np.intp(65)  # m
FORCE = np.intp(66)  # along N, t1, t2 in the last step, N
# And what lanes keep in it from step to step:
PUSH = np.intp(69)  # all its impulses so far, world axes, N s
WIDTH = 72
# What `project.shove` keeps there once the impulses are known: Eq. 8 for positions, per metre of gap.
RISE = np.intp(19)
ROLL = np.intp(20)
# And `kick.begin`, over a height field, until `fill`: H in world axes.
BEND = np.intp(19)

EXTRAPOLATE = 0.9
"""Sweeps that shrink by less than this factor are not extrapolated."""

WINDING = 1e-3
"""m/s: sweeps that change so little, and hardly less each time, meet targets that no rigid motion can
meet together. More of them would only wind up impulses that cancel."""

STRIKE_SWEEPS = np.intp(60)
ALWAYS = np.bool_(True)
STRIKE_TOLERANCE = 1e-8
"""m/s: the sweeps of an impact agree when none changes a contact's velocity by more."""


@traced
def stand(rows, c, hull, k):
    """Row c is for hull point k."""
    rows[c, POINT] = k
    put2(rows, c, B, vec2(hull, k, 0))
    rows[c, RHO] = hull[k, 3]


@traced
def place(rows, c, frame, q):
    """Row c's point touches at q, with axes (N, t1, t2); all in body axes."""
    put2(rows, c, AXES, frame[0])
    put2(rows, c, AXES + 3, frame[1])
    put2(rows, c, AXES + 6, frame[2])
    put2(rows, c, Q, q)


@traced
def in_axes(rows, c, a):
    """A vector in body axes along contact c's N, t1, t2."""
    return (
        dot(vec2(rows, c, AXES), a),
        dot(vec2(rows, c, AXES + 3), a),
        dot(vec2(rows, c, AXES + 6), a),
    )


@traced
def in_body(rows, c, p):
    """The inverse of `in_axes`."""
    a = axpy(p[1], vec2(rows, c, AXES + 3), scale(p[0], vec2(rows, c, AXES)))
    return axpy(p[2], vec2(rows, c, AXES + 6), a)


@traced
def in_cone(p, mu):
    """Does the impulse push, and friction hold?"""
    return (p[0] > 0.0) & (p[1] * p[1] + p[2] * p[2] <= mu * mu * p[0] * p[0])


@traced
def spread(inv_m, inv_J, F, T, v, w):
    """The velocities after an impulse F and its moment T (Eqs. 1 and 2 over a blow), body axes."""
    return axpy(inv_m, F, v), axpy(1.0, times(inv_J, T), w)


@traced
def fill(rows, c, inv_m, inv_J, mu, v, w):
    """Prepare contact c for sweeping: arms, Eq. 10's matrix, and its slip at (v, w).

    Without friction (μ None or 0) the tangents are left out. Returns the velocity u of its point.
    """
    q = vec2(rows, c, Q)
    a = cross(q, vec2(rows, c, AXES))
    Ja = times(inv_J, a)
    put2(rows, c, ARM, a)
    put2(rows, c, TURN, Ja)
    nn = inv_m + dot(a, Ja)
    if mu is None:
        put6(rows, c, K, (nn, 0.0, 0.0, 0.0, 0.0, 0.0))
    else:
        a1 = cross(q, vec2(rows, c, AXES + 3))
        a2 = cross(q, vec2(rows, c, AXES + 6))
        Ja1 = times(inv_J, a1)
        Ja2 = times(inv_J, a2)
        put2(rows, c, ARM + 3, a1)
        put2(rows, c, ARM + 6, a2)
        put2(rows, c, TURN + 3, Ja1)
        put2(rows, c, TURN + 6, Ja2)
        k = (nn, dot(a, Ja1), dot(a, Ja2), inv_m + dot(a1, Ja1), dot(a1, Ja2), inv_m + dot(a2, Ja2))
        put6(rows, c, K, k)
        put6(rows, c, INV_K, inverse_symmetric(k))
    u = velocity(rows, c, mu, v, w)
    rows[c, SLIP] = u[1]
    rows[c, SLIP + 1] = u[2]
    return u


@traced
def velocity(rows, c, mu, v, w):
    """Velocity of contact c's point along its axes; the tangents read 0 without friction."""
    u_n = dot(vec2(rows, c, AXES), v) + dot(vec2(rows, c, ARM), w)
    if mu is None:
        return u_n, 0.0, 0.0
    u_1 = dot(vec2(rows, c, AXES + 3), v) + dot(vec2(rows, c, ARM + 3), w)
    u_2 = dot(vec2(rows, c, AXES + 6), v) + dot(vec2(rows, c, ARM + 6), w)
    return u_n, u_1, u_2


@traced
def apply(rows, c, inv_m, mu, p, v, w):
    """The velocities after an impulse p along contact c's axes (Eqs. 1 and 2 over a blow)."""
    v = axpy(inv_m * p[0], vec2(rows, c, AXES), v)
    w = axpy(p[0], vec2(rows, c, TURN), w)
    if mu is not None:
        v = axpy(inv_m * p[1], vec2(rows, c, AXES + 3), v)
        w = axpy(p[1], vec2(rows, c, TURN + 3), w)
        v = axpy(inv_m * p[2], vec2(rows, c, AXES + 6), v)
        w = axpy(p[2], vec2(rows, c, TURN + 6), w)
    return v, w


@traced
def _asked(rows, c, mu, mean_slip, lasting, v, w):
    """What contact c's solve starts from: (K, its inverse, b, r, guess, slip), as `cone_impulse` has it."""
    p = vec2(rows, c, P)
    u = velocity(rows, c, mu, v, w)
    k = six2(rows, c, K)
    target = vec2(rows, c, TARGET)
    # u without this contact's own impulse
    own = (
        k[0] * p[0] + k[1] * p[1] + k[2] * p[2],
        k[1] * p[0] + k[3] * p[1] + k[4] * p[2],
        k[2] * p[0] + k[4] * p[1] + k[5] * p[2],
    )
    b = (
        u[0] - own[0] - target[0],
        u[1] - own[1] - target[1],
        u[2] - own[2] - target[2],
    )
    slip = (rows[c, SLIP], rows[c, SLIP + 1])
    r = (u[1] - own[1] + mean_slip * slip[0], u[2] - own[2] + mean_slip * slip[1])
    # held on target, it slips by half of this over the step
    slip = (lasting * (slip[0] + target[1]), lasting * (slip[1] + target[2]))
    return k, six2(rows, c, INV_K), b, r, (p[1], p[2]), slip


@traced
def _answered(rows, c, inv_m, mu, on, p_new, v, w):
    """Where it is on, contact c's impulse becomes p_new.

    Returns:
        (dp, change, v, w): what that changes of the impulse, N s, and about of its velocity, m/s; the
        velocities with it.
    """
    p = vec2(rows, c, P)
    k = six2(rows, c, K)
    dp = (p_new[0] - p[0], p_new[1] - p[1], p_new[2] - p[2])
    put2(rows, c, P, where(on, p_new, p))
    v, w = where(on, apply(rows, c, inv_m, mu, dp, v, w), (v, w))
    return dp, abs(dp[0]) * k[0] + abs(dp[1]) * k[3] + abs(dp[2]) * k[5], v, w


@jit
def block(rows, c, inv_m, mu, mean_slip, lasting, on, v, w):
    """Solve contact c with the others' impulses held, where it is on.

    The other arguments are those of `agree`, the result is `_answered`'s.
    """
    k, inv_k, b, r, guess, slip = _asked(rows, c, mu, mean_slip, lasting, v, w)
    p_new = cone_impulse(k, inv_k, mu, b, r, guess, slip, on)
    return _answered(rows, c, inv_m, mu, on, p_new, v, w)


@traced
def _compared(rows, c, on, dp, moved, change, same, square):
    """A sweep's largest change, and how its changes compare with the last's."""
    before = vec2(rows, c, STEP)
    put2(rows, c, STEP, where(on, dp, before))
    return (
        where(on, most(change, moved), change),
        where(on, same + dot(dp, before), same),
        where(on, square + dot(before, before), square),
    )


@traced
def _extrapolated(rows, c, inv_m, mu, on, s, v, w):
    """Contact c's last change, s times more."""
    p = vec2(rows, c, P)
    dp = scale(s, vec2(rows, c, STEP))
    put2(rows, c, P, where(on, add(dp, p), p))
    return where(on, apply(rows, c, inv_m, mu, dp, v, w), (v, w))


@traced
def _outlook(live, fresh, same, square, change):
    """(winds, jumps): where sweeps wind up, and where they shrink so steadily that one can jump ahead."""
    steady = same > EXTRAPOLATE * square
    return live & fresh & steady & (change < WINDING), live & fresh & no(steady) & (same > 0.0)


@stage
def agree(rows, n, inv_m, mu, several, mean_slip, lasting, live, v, w, sweeps, tolerance):
    """Sweep the single contact solve over n rows until their impulses agree.

    It starts from the rows' impulses, which must be in the velocities already.

    Args:
        rows: n filled rows.
        n: how many.
        inv_m: 1/m.
        mu: friction coefficient; None: left out.
        several: None if there is never more than one row.
        mean_slip: 1.0: friction opposes the mean of the slip before and after; 0.0: the slip after.
        lasting: 1.0: a contact that lasts, whose friction works over the whole step; 0.0: a blow.
        live: whether to do anything.
        v: velocity, body axes.
        w: angular velocity, body axes.
        sweeps: at most so many.
        tolerance: m/s; enough when a sweep changes no contact's velocity by more.

    Returns:
        (v, w, change): the velocities with the impulses in them, which are in the rows, and what the
        last sweep still changed, m/s.
    """
    apart()
    change = filled(inv_m, 0.0)
    if several is None:
        _dp, _moved, v, w = block(rows, 0, inv_m, mu, mean_slip, lasting, live, v, w)
        return v, w, change
    fresh = filled(inv_m, False)
    rows_in_use = int(largest(n))
    for sweep in range(sweeps):
        now, same, square = filled(inv_m, 0.0), filled(inv_m, 0.0), filled(inv_m, 0.0)
        for c in range(rows_in_use):
            on = live & (c < n)
            dp, moved, v, w = block(rows, c, inv_m, mu, mean_slip, lasting, on, v, w)
            now, same, square = _compared(rows, c, on, dp, moved, now, same, square)
        change = where(live, where(n == 1, 0.0, now), change)
        live = live & no(change < tolerance)
        if sweep < sweeps - 1:
            winds, jumps = _outlook(live, fresh, same, square, change)
            fresh = no(jumps)
            live = live & no(winds)
            if some(jumps):
                s = same / (square - same)
                for c in range(rows_in_use):
                    v, w = _extrapolated(rows, c, inv_m, mu, jumps & (c < n), s, v, w)
        if not some(live):
            break
    return v, w, change


@traced
def kinetic_energy(m, J, v, w):
    """½ m |v|² + ½ w·J w, J."""
    return 0.5 * (m * dot(v, v) + dot(w, times(J, w)))


@jit
def no_gain(m, J, before, v0, w0, v1, w1):
    """The furthest point from (v0, w0) towards (v1, w1) whose kinetic energy is at most `before`.

    Kinetic energy is quadratic on the way, so the point has a closed form. (v0, w0) must not exceed
    `before`; as friction cones are convex, impulses blended so stay inside theirs.
    """
    dv = (v1[0] - v0[0], v1[1] - v0[1], v1[2] - v0[2])
    dw = (w1[0] - w0[0], w1[1] - w0[1], w1[2] - w0[2])
    a = kinetic_energy(m, J, dv, dw)
    b = m * dot(v0, dv) + dot(times(J, w0), dw)
    c = min(0.0, kinetic_energy(m, J, v0, w0) - before)
    s = 0.0
    if a > 0.0:
        s = min(1.0, max(0.0, (-b + sqrt(b * b - 4.0 * a * c)) / (2.0 * a)))
    return s, axpy(s, dv, v0), axpy(s, dw, w0)


@stage
def strike(rows, n, m, inv_m, J, mu, several, v, w, sweeps, tolerance):
    """All rows are struck at once: Newton's restitution and Coulomb friction, without energy gain.

    The targets (−e times the velocity before, for every contact at once, so restitution does not
    stack) may ask for more than the blow can pay for: Newton's law with friction can gain energy.
    Then the plastic impulse with friction along the slip after, which provably loses, is blended in,
    as little as brings the energy back to what it was. The last two arguments are those of `agree`.
    """
    apart()
    before = kinetic_energy(m, J, v, w)
    for k in range(n):
        put2(rows, k, P, (0.0, 0.0, 0.0))
    v1, w1, _change = agree(rows, n, inv_m, mu, several, 1.0, 0.0, ALWAYS, v, w, sweeps, tolerance)
    if kinetic_energy(m, J, v1, w1) <= before:
        return v1, w1

    newton = rows[:n, P : P + 3].copy()
    for k in range(n):
        put2(rows, k, P, (0.0, 0.0, 0.0))
        put2(rows, k, TARGET, (0.0, 0.0, 0.0))
    v0, w0, _change = agree(rows, n, inv_m, mu, several, 0.0, 0.0, ALWAYS, v, w, sweeps, tolerance)
    # Sweeps cut short may leave a gain: then stop on the way from no impulse at all.
    s, v0, w0 = no_gain(m, J, before, v, w, v0, w0)
    for k in range(n):
        put2(rows, k, P, scale(s, vec2(rows, k, P)))
    s, v1, w1 = no_gain(m, J, before, v0, w0, v1, w1)
    for k in range(n):
        plastic = scale(1.0 - s, vec2(rows, k, P))
        put2(rows, k, P, axpy(s, vec2(newton, k, 0), plastic))
    return v1, w1
