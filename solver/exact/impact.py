"""The frictional impact of one point as a path: Eq. 12 with the energetic restitution law (Stronge 1990).

    du = K (N − μ s) dp_n,   s = u_t/|u_t|,   stick where the cone allows it              (12)

The normal impulse only grows. What compression (u_n < 0) takes, times e², is stored, and restitution
(u_n > 0) spends it; the impact is over when nothing is stored any more. Where slip turns so that an
impact compresses twice, both compressions fill the store. Friction only takes, so no impact gains
energy, whatever e, μ and slip; also not in a jam, N·K(N − μs) ≤ 0: there u_n falls on until slip has
turned or stopped, and then recovers, as K is positive definite.

Slip that keeps its direction is a straight line in (u, p), solved in closed form (Routh's construction
in the plane). Slip that turns is integrated over τ, dp_n = |u_t| dτ: du_t/dτ = |u_t| K_tn − μ K_tt u_t has
no singularity where slip comes near zero, and scales with |u_t|. Integration ends where the direction
has converged, or slip has stopped. From zero slip the impulse sticks, or slips in the one direction in
which friction cannot hold it (Bhatt & Koechling, Comput. Methods Appl. Mech. Eng. 125:163, 1995).

Letters as in `friction.py`: components are along (N, t1, t2), K = (nn, n1, n2, 11, 12, 22).
"""

from math import inf, isfinite, sqrt

import numpy as np

from ..algebra import jit, stage
from ..friction import inverse_symmetric
from .dop853 import ERROR_3, ERROR_5, STAGES, STEP, TABLE

RTOL = 1e-12
"""The error allowed in each step: of the point's speed before, and rad in the direction of slip. A loose
one can choose the wrong way out of a near stop."""

SLIP_RTOL = 1e-4
"""Of the slip itself, however small. Its direction decides how it goes on; its size is but the scale."""

CONVERGED = 1e-12
"""rad: slip so near to a direction that attracts it takes that direction."""

STIFF, STIFF_CONVERGED = 3.0, 1e-9
"""Where steps are longer than so many times that in which slip is attracted, they no longer bring it
nearer than about 1e-10 rad; it is near enough there, as what is left of its turn is added in closed form."""

SMALL, SECOND = 1e-3, 1e-14
"""rad; and of the impulse. Slip that is about to stop takes a direction that attracts it as soon as what
is of second order no longer matters."""

INVARIANT = 2e-15
"""Slip that turns so slowly, in the units of `impact`, keeps its direction: rounding would turn it so."""

STOPPED = 1e-16
"""Of the point's speed before: slip so slow is zero."""

MAX_STEPS = 1000
"""Of one impact. A random one takes about 30, and hardly any more than 200."""

MAX_ROOT = 80
"""Bisection alone would need 53."""

# How a part of the path ended.
_OVER, _NO_SLIP, _FAILED = 0, 1, 2
# What an event is the root of.
_RATE, _SPEED, _STORE = 0, 1, 2


@jit
def _moved(K, u, p):
    """u + K p (Eq. 10)."""
    return (
        u[0] + K[0] * p[0] + K[1] * p[1] + K[2] * p[2],
        u[1] + K[1] * p[0] + K[3] * p[1] + K[4] * p[2],
        u[2] + K[2] * p[0] + K[4] * p[1] + K[5] * p[2],
    )


@jit
def _rates(K, mu, s1, s2):
    """Slip along s = (s1, s2) gains D in u_n (Eq. 11), h along itself and k across per unit of p_n.

    The last one is dk/dφ, with φ the angle of s.
    """
    a1, a2 = K[3] * s1 + K[4] * s2, K[4] * s1 + K[5] * s2
    D = K[0] - mu * (K[1] * s1 + K[2] * s2)
    v1, v2 = K[1] - mu * a1, K[2] - mu * a2
    h, k = v1 * s1 + v2 * s2, v2 * s1 - v1 * s2
    return D, h, k, -h - mu * (K[3] * s2 * s2 - 2.0 * K[4] * s1 * s2 + K[5] * s1 * s1)


@stage
def _line(u_n, D, store, ee, room):
    """The path while u_n = u_n + D p: (over, p, store) at its end, or at p = room, whichever is first."""
    p = 0.0
    if u_n >= 0.0 and u_n * u_n + 2.0 * D * store < 0.0:  # falls back to zero before the store is spent
        p = -u_n / D
        if p >= room:
            return False, room, store - room * (u_n + 0.5 * D * room)
        store -= 0.5 * u_n * p
        u_n = -0.0
    if u_n < 0.0 or (u_n == 0.0 and D <= 0.0):
        q = -u_n / D if D > 0.0 else inf
        if p + q >= room:
            q = room - p
            return False, room, store - ee * q * (u_n + 0.5 * D * q)
        p += q
        store -= 0.5 * ee * q * u_n
        u_n = 0.0
    q = 2.0 * store / (u_n + sqrt(u_n * u_n + 2.0 * D * store)) if store > 0.0 else 0.0
    if p + q > room:
        q = room - p
        return False, room, store - q * (u_n + 0.5 * D * q)
    return True, p + q, 0.0


@stage
def _step(K, mu, u, dt, f):
    """One step of Eq. 12 over dτ = dt, 1/[K]: (p, work of p_n, error of p).

    Args:
        K: Eq. 10.
        mu: friction coefficient.
        u: velocity before.
        dt: τ of the step.
        f: (12, 4) room for the stages: dp/dτ = |u_t| (N − μ s), and |u_t| u_n.
    """
    x = u
    for i in range(STAGES):
        r = sqrt(x[1] * x[1] + x[2] * x[2])
        f[i, 0] = r
        f[i, 1] = -mu * x[1]
        f[i, 2] = -mu * x[2]
        f[i, 3] = r * x[0]
        a0, a1, a2 = 0.0, 0.0, 0.0
        for j in range(i + 1):
            b = TABLE[i + 1, j]
            a0 += b * f[j, 0]
            a1 += b * f[j, 1]
            a2 += b * f[j, 2]
        x = _moved(K, u, (dt * a0, dt * a1, dt * a2))
    work = 0.0
    e0, e1, e2, g0, g1, g2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(STAGES):
        work += TABLE[STEP, j] * f[j, 3]
        b, c = TABLE[ERROR_5, j], TABLE[ERROR_3, j]
        e0 += b * f[j, 0]
        e1 += b * f[j, 1]
        e2 += b * f[j, 2]
        g0 += c * f[j, 0]
        g1 += c * f[j, 1]
        g2 += c * f[j, 2]
    five = e0 * e0 + e1 * e1 + e2 * e2
    both = sqrt(five + 0.01 * (g0 * g0 + g1 * g1 + g2 * g2))
    b = dt * sqrt(five) / both if both > 0.0 else 0.0
    return (dt * a0, dt * a1, dt * a2), dt * work, (b * e0, b * e1, b * e2)


@jit
def _error(K, u, error, r):
    """The error of p in a step, of what is allowed. u is the velocity after, r the lesser slip."""
    v = _moved(K, (0.0, 0.0, 0.0), error)
    n = sqrt(u[1] * u[1] + u[2] * u[2])
    if not r > 0.0:
        return inf
    turn = abs(v[2] * u[1] - v[1] * u[2]) / (n * r)
    slip = sqrt(v[1] * v[1] + v[2] * v[2])
    return max(turn / RTOL, (slip + abs(v[0])) / RTOL, slip / (SLIP_RTOL * r))


@jit
def _measure(K, mu, u, store, work, kind):
    """What an event is the root of, and its derivative with τ, at the end of a step."""
    r = sqrt(u[1] * u[1] + u[2] * u[2])
    rise = K[0] * r - mu * (K[1] * u[1] + K[2] * u[2])
    if kind == _SPEED:
        return u[0], rise
    if kind == _STORE:
        return store - work, -r * u[0]
    D, _h, k, _slope = _rates(K, mu, u[1] / r, u[2] / r)
    return D, -mu * k * (K[2] * u[1] - K[1] * u[2]) / r


@stage
def _event(K, mu, u, store, dt, guess, kind, rising, f):
    """Where in a step over dt there is an event: Newton, kept between the step's ends by bisection.

    Returns:
        (found, dt up to there, p, work).
    """
    low, high = 0.0, dt
    t = guess if 0.0 < guess < dt else 0.5 * dt
    p, work = u, 0.0
    last = False
    for _ in range(MAX_ROOT):
        p, work, _error = _step(K, mu, u, t, f)
        if last:
            return True, t, p, work
        value, slope = _measure(K, mu, _moved(K, u, p), store, work, kind)
        if (value > 0.0) == rising:
            high = t
        else:
            low = t
        new = t - value / slope if slope != 0.0 else 0.5 * (low + high)
        if not low <= new <= high:
            new = 0.5 * (low + high)
        # Newton's next correction would be the square of this one.
        last = abs(new - t) <= 1e-8 * t or high - low <= 1e-15 * high
        t = new
    return False, t, p, work


@stage
def _slide(K, mu, ee, u):
    """The path while it slips: (end, p, u, store)."""
    f = np.empty((STAGES, 4))
    p = (0.0, 0.0, 0.0)
    store = 0.0
    closing = True
    dt = inf
    for _ in range(MAX_STEPS):
        r = sqrt(u[1] * u[1] + u[2] * u[2])
        if r < STOPPED:
            return _NO_SLIP, p, u, store
        s1, s2 = u[1] / r, u[2] / r
        D, h, k, slope = _rates(K, mu, s1, s2)
        straight = abs(k) <= INVARIANT
        soon = False
        line = s1, s2, u, p, D, h
        if not straight and slope < 0.0:
            turn = -k / slope
            near = STIFF_CONVERGED if STIFF < -dt * slope < inf else CONVERGED
            straight = abs(turn) < near
            soon = abs(turn) < SMALL and turn * turn * r < -h * SECOND and abs(turn) * r * r < -h * SECOND
            if straight or soon:
                # To first order, the slip across ends as if it stuck; slope + h = −μ s⊥·K_tt s⊥.
                t1, t2 = s1 - turn * s2, s2 + turn * s1
                q = -mu * r * turn / (slope + h)
                dp = (0.0, -q * t2, q * t1)
                D_line, h_line, _k, _slope = _rates(K, mu, t1, t2)
                line = t1, t2, _moved(K, u, dp), (p[0], p[1] + dp[1], p[2] + dp[2]), D_line, h_line
        if straight or soon:
            t1, t2, x, y, D_line, h_line = line
            n = sqrt(x[1] * x[1] + x[2] * x[2])
            over, q, left = _line(x[0], D_line, store, ee, n / -h_line if h_line < 0.0 else inf)
            if straight or not over:
                if q == inf:
                    return _FAILED, p, u, store
                p = (y[0] + q, y[1] - mu * q * t1, y[2] - mu * q * t2)
                u = (x[0] + D_line * q, (n + h_line * q) * t1, (n + h_line * q) * t2)
                return (_OVER if over else _NO_SLIP), p, u, left

        if dt == inf:  # a fraction of the time in which the direction changes, or u_n, which is at most 1
            dt = min(0.25 / (abs(k) + abs(h) + abs(slope)), 2.0 / (K[0] * r))
        dp, work, error = _step(K, mu, u, dt, f)
        after = _moved(K, u, dp)
        r_after = sqrt(after[1] * after[1] + after[2] * after[2])
        error = _error(K, after, error, min(r, r_after))
        if not error <= 1.0:
            dt *= max(0.2, 0.9 * error**-0.125) if isfinite(error) else 0.2
            continue
        next_dt = dt * min(5.0, 0.9 * max(error, 1e-8) ** -0.125)

        # Steps end where D, then u_n changes sign, and where the store is spent.
        turns, over = False, False
        for kind in range(3):
            if kind == _RATE:
                D_after = K[0] - mu * (K[1] * after[1] + K[2] * after[2]) / r_after
                happens = D * D_after < 0.0 and abs(D) > CONVERGED
                guess, rising = dt * D / (D - D_after), D < 0.0
            elif kind == _SPEED:
                happens = turns = after[0] >= 0.0 if closing else after[0] < 0.0
                guess, rising = -u[0] / (D * r), closing
            else:
                happens = over = not closing and store - work <= 0.0
                turns = turns and not over
                _over, guess, _left = _line(u[0], D, store, ee, inf)
                guess, rising = guess / r, False
            if happens:
                found, dt, dp, work = _event(K, mu, u, store, dt, guess, kind, rising, f)
                after = _moved(K, u, dp)
                if not found:
                    return _FAILED, p, u, store
        if turns:
            after = (0.0, after[1], after[2])
        store -= ee * work if closing else work
        p = (p[0] + dp[0], p[1] + dp[1], p[2] + dp[2])
        u = after
        if turns:
            closing = not closing
            over = store <= 0.0 and not closing
        if over:
            return _OVER, p, u, store
        dt = next_dt
    return _FAILED, p, u, store


@jit
def _from_rest(K, mu):
    """How the impulse goes on without slip: (sticks, dp_1/dp_n, dp_2/dp_n).

    It slips along the s for which K_tn = (μ K_tt + h I) s with h > 0: Newton on 1/|s| = 1, which comes
    to the only such h from below.
    """
    a, b, c = mu * K[3], mu * K[4], mu * K[5]
    h = 0.0
    s1, s2, n = 0.0, 0.0, 0.0
    for i in range(MAX_ROOT):
        det = (a + h) * (c + h) - b * b
        s1 = ((c + h) * K[1] - b * K[2]) / det
        s2 = ((a + h) * K[2] - b * K[1]) / det
        n = sqrt(s1 * s1 + s2 * s2)
        if i == 0 and n <= 1.0:
            return True, -mu * s1, -mu * s2
        # d|s|/dh = −s·(μ K_tt + h I)⁻¹ s / |s|
        fall = ((c + h) * s1 * s1 - 2.0 * b * s1 * s2 + (a + h) * s2 * s2) / (det * n)
        step = (n - 1.0) * n / fall
        h += step
        if not step > 1e-15 * h:
            break
    return False, -mu * s1 / n, -mu * s2 / n


@stage
def impact(K, mu, e, u):
    """The impulse of one frictional impact, along its path (Eq. 12).

    Args:
        K: (nn, n1, n2, 11, 12, 22), 1/kg, positive definite (Eq. 10).
        mu: friction coefficient, ≥ 0.
        e: energetic coefficient of restitution, 0 to 1: restitution's work is −e² compression's.
        u: (3,) velocity of the contact point before, m/s.

    Returns:
        (p_n, p_1, p_2, ok), N s. Zero if the point is not closing (u_n ≥ 0). ok is False, with zero
        impulse, where there is no path: if an argument is not finite, if K is not positive definite to
        rounding, or if MAX_STEPS do not suffice. u + K p has no slip, to rounding, where it sticks, and
        no more energy than u.
    """
    nothing = (0.0, 0.0, 0.0)
    size = K[0] + K[3] + K[5]
    speed = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    if not (isfinite(size + K[1] + K[2] + K[4] + mu + e) and isfinite(speed) and K[0] > 0.0):
        return 0.0, 0.0, 0.0, False
    if u[0] >= 0.0 or speed == 0.0:
        return 0.0, 0.0, 0.0, True
    if mu == 0.0:
        return -(1.0 + e) * u[0] / K[0], 0.0, 0.0, True

    # In units in which K's trace and the speed are 1
    s, unit = 1.0 / size, speed / size
    K = (K[0] * s, K[1] * s, K[2] * s, K[3] * s, K[4] * s, K[5] * s)
    s = 1.0 / speed
    before = (u[0] * s, u[1] * s, u[2] * s)
    ee = e * e
    end, p, u, store = _slide(K, mu, ee, before)
    sticks, u_n = False, 0.0
    if end == _NO_SLIP:
        sticks, g1, g2 = _from_rest(K, mu)
        D = K[0] + K[1] * g1 + K[2] * g2
        if not D > 0.0:
            return 0.0, 0.0, 0.0, False
        _over, q, _store = _line(u[0], D, store, ee, inf)
        u_n = u[0] + D * q
        p = (p[0] + q, p[1] + q * g1, p[2] + q * g2)
    elif end == _FAILED:
        return 0.0, 0.0, 0.0, False
    if sticks:  # then it ends without slip: take out what errors have added up to
        left = _moved(K, before, p)
        p = _moved(inverse_symmetric(K), p, (u_n - left[0], -left[1], -left[2]))

    # What the quadrature's error may have left outside the cone, or gained
    n = sqrt(p[1] * p[1] + p[2] * p[2])
    if n > mu * p[0]:
        p = (p[0], p[1] * mu * p[0] / n, p[2] * mu * p[0] / n)
    Kp = _moved(K, nothing, p)
    spent = -(p[0] * before[0] + p[1] * before[1] + p[2] * before[2])
    needed = 0.5 * (p[0] * Kp[0] + p[1] * Kp[1] + p[2] * Kp[2])
    if needed > spent:
        unit *= spent / needed
    return p[0] * unit, p[1] * unit, p[2] * unit, isfinite(p[0] + p[1] + p[2])
