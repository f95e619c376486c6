"""Several contacts at once: the single contact solve, swept over the closed ones until they agree.

Block Gauss-Seidel, the per-contact iteration of Hwangbo et al. (IEEE RA-L 3:895, 2018): each block
solves one contact exactly, Eqs. 8 and 10-11, with the others' impulses held. A contact is a row of
numbers here; the solver owns one array of rows and fills the first so many.
"""

from math import sqrt

from .algebra import add, axpy, cross, dot, jit, put, scale, six, times, to_body, vec
from .friction import cone_impulse, inverse_symmetric

# Columns of a row. Contact axes are (N, t1, t2); directions are stored in world and in body axes.
POINT = 0  # index of the hull point
AXES = 1  # N, t1, t2 in world axes
ARM = 10  # q × N, q × t1, q × t2 in body axes: the angular part of W, and its like for the tangents
TURN = 19  # J⁻¹ times those: rad/s per N s
K = 28  # Eq. 10: nn, n1, n2, 11, 12, 22
INV_K = 34
TARGET = 40  # velocity asked for, m/s
SLIP = 43  # tangential velocity before the impulse, m/s
P = 45  # impulse, N s
WIDTH = 48

MAX_SWEEPS = 60
TOLERANCE = 1e-10
"""m/s: the sweeps agree when none changes a contact's velocity by more."""


@jit
def fill(row, point, inv_m, inv_J, mu, R, N, t1, t2, q):
    """Prepare one contact: its axes, arms and Eq. 10's matrix.

    Args:
        row: (WIDTH,) to fill.
        point: index of the hull point.
        inv_m: 1/m.
        inv_J: inverse principal moments.
        mu: friction coefficient; with 0 the tangents are left out.
        R: attitude as a matrix.
        N: normal, world axes; with t1 and t2 a right-handed frame.
        t1: first tangent.
        t2: second tangent.
        q: from x to the contact point, body axes.
    """
    row[POINT] = point
    put(row, AXES, N)
    a = cross(q, to_body(R, N))
    Ja = times(inv_J, a)
    put(row, ARM, a)
    put(row, TURN, Ja)
    row[K] = inv_m + dot(a, Ja)
    if mu > 0.0:
        put(row, AXES + 3, t1)
        put(row, AXES + 6, t2)
        a1 = cross(q, to_body(R, t1))
        a2 = cross(q, to_body(R, t2))
        Ja1 = times(inv_J, a1)
        Ja2 = times(inv_J, a2)
        put(row, ARM + 3, a1)
        put(row, ARM + 6, a2)
        put(row, TURN + 3, Ja1)
        put(row, TURN + 6, Ja2)
        row[K + 1] = dot(a, Ja1)
        row[K + 2] = dot(a, Ja2)
        row[K + 3] = inv_m + dot(a1, Ja1)
        row[K + 4] = dot(a1, Ja2)
        row[K + 5] = inv_m + dot(a2, Ja2)
        put(row, INV_K, inverse_symmetric(six(row, K)))


@jit
def velocity(row, mu, v, w):
    """Velocity of the contact point along the contact's axes; the tangents read 0 without friction."""
    u_n = dot(vec(row, AXES), v) + dot(vec(row, ARM), w)
    if mu == 0.0:
        return u_n, 0.0, 0.0
    u_1 = dot(vec(row, AXES + 3), v) + dot(vec(row, ARM + 3), w)
    u_2 = dot(vec(row, AXES + 6), v) + dot(vec(row, ARM + 6), w)
    return u_n, u_1, u_2


@jit
def apply(row, inv_m, mu, p, v, w):
    """The velocities after an impulse p along the contact's axes (Eqs. 1 and 2 over a blow)."""
    v = axpy(inv_m * p[0], vec(row, AXES), v)
    w = axpy(p[0], vec(row, TURN), w)
    if mu > 0.0:
        v = axpy(inv_m * p[1], vec(row, AXES + 3), v)
        w = axpy(p[1], vec(row, TURN + 3), w)
        v = axpy(inv_m * p[2], vec(row, AXES + 6), v)
        w = axpy(p[2], vec(row, TURN + 6), w)
    return v, w


@jit
def world_impulse(row, mu):
    """The row's impulse in world axes, N s."""
    p = scale(row[P], vec(row, AXES))
    if mu > 0.0:
        p = axpy(row[P + 1], vec(row, AXES + 3), p)
        p = axpy(row[P + 2], vec(row, AXES + 6), p)
    return p


@jit
def agree(rows, n, inv_m, mu, mean_slip, v, w):
    """Sweep the single contact solve over n rows until their impulses agree.

    Args:
        rows: prepared rows, with targets; their impulses P are the first guess, already in v and w.
        n: how many.
        inv_m: 1/m.
        mu: friction coefficient.
        mean_slip: 1.0: friction opposes the mean of the slip before and after; 0.0: the slip after.
        v: velocity, world axes.
        w: angular velocity, body axes.

    Returns:
        (v, w) with the impulses in them; the impulses are in the rows.
    """
    for sweep in range(MAX_SWEEPS):
        change = 0.0
        for k in range(n):
            row = rows[k]
            p = vec(row, P)
            u = velocity(row, mu, v, w)
            Kk = six(row, K)
            # u without this contact's own impulse, K p
            b = (
                u[0] - row[TARGET] - (Kk[0] * p[0] + Kk[1] * p[1] + Kk[2] * p[2]),
                u[1] - row[TARGET + 1] - (Kk[1] * p[0] + Kk[3] * p[1] + Kk[4] * p[2]),
                u[2] - row[TARGET + 2] - (Kk[2] * p[0] + Kk[4] * p[1] + Kk[5] * p[2]),
            )
            r = (
                b[1] + row[TARGET + 1] + mean_slip * row[SLIP],
                b[2] + row[TARGET + 2] + mean_slip * row[SLIP + 1],
            )
            p_new = cone_impulse(Kk, six(row, INV_K), mu, b, r)
            dp = (p_new[0] - p[0], p_new[1] - p[1], p_new[2] - p[2])
            put(row, P, p_new)
            v, w = apply(row, inv_m, mu, dp, v, w)
            change = max(change, abs(dp[0]) * Kk[0] + abs(dp[1]) * Kk[3] + abs(dp[2]) * Kk[5])
        if n == 1 or change < TOLERANCE:
            break
    return v, w


@jit
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


@jit
def strike(rows, n, m, inv_m, J, mu, v, w):
    """All rows are struck at once: Newton's restitution and Coulomb friction, without energy gain.

    The targets (−e times the velocity before, for every contact at once, so restitution does not
    stack) may ask for more than the blow can pay for: Newton's law with friction can gain energy.
    Then the plastic impulse with friction along the slip after, which provably loses, is blended in,
    as little as brings the energy back to what it was.
    """
    before = kinetic_energy(m, J, v, w)
    for k in range(n):
        put(rows[k], P, (0.0, 0.0, 0.0))
    v1, w1 = agree(rows, n, inv_m, mu, 1.0, v, w)
    if kinetic_energy(m, J, v1, w1) <= before:
        return v1, w1

    newton = rows[:n, P : P + 3].copy()
    for k in range(n):
        put(rows[k], P, (0.0, 0.0, 0.0))
        put(rows[k], TARGET, (min(0.0, rows[k, TARGET]), 0.0, 0.0))
    v0, w0 = v, w
    v0, w0 = agree(rows, n, inv_m, mu, 0.0, v0, w0)
    # Sweeps cut short may leave a gain: then stop on the way from no impulse at all.
    s, v0, w0 = no_gain(m, J, before, v, w, v0, w0)
    for k in range(n):
        put(rows[k], P, scale(s, vec(rows[k], P)))
    s, v1, w1 = no_gain(m, J, before, v0, w0, v1, w1)
    for k in range(n):
        p0 = vec(rows[k], P)
        put(
            rows[k],
            P,
            add(scale(1.0 - s, p0), scale(s, (newton[k, 0], newton[k, 1], newton[k, 2]))),
        )
    return v1, w1
