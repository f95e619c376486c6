"""Contacts that all stick: solved at once, because sweeps share a load among many points slowly."""

from .algebra import add, apart, axpy, cross, put2, scale, stage, times, vec2
from .friction import inverse_symmetric
from .sweep import AIM, P, Q, in_axes, in_cone, spread
from .trace import filled, largest, no, some, traced, where

EPSILON = 1e-7
"""Of the body's mass: how much the points' common motion leans on it, so that it always has one
answer. So much of the residual it leaves; the next step begins with that."""


@traced
def rigid(s, inverse, sum_q, S, T):
    """(G + ε M)⁻¹ (S, T): how unit masses at the points move with momentum S, angular momentum T."""
    T = axpy(-s, cross(sum_q, S), T)
    z = (
        inverse[0] * T[0] + inverse[1] * T[1] + inverse[2] * T[2],
        inverse[1] * T[0] + inverse[3] * T[1] + inverse[4] * T[2],
        inverse[2] * T[0] + inverse[4] * T[1] + inverse[5] * T[2],
    )
    return scale(s, axpy(-1.0, cross(z, sum_q), S)), z


@traced
def _gathered(rows, c, on, v, w, S, U, sum_q, G):
    """What row c adds to Aᵀ r and to G: its q's sum, and its moments xx, yy, zz, xy, xz, yz."""
    q = vec2(rows, c, Q)
    r = axpy(-1.0, vec2(rows, c, AIM), add(v, cross(w, q)))
    xx, yy, zz, xy, xz, yz = G
    G1 = (
        xx + (q[1] * q[1] + q[2] * q[2]),
        yy + (q[0] * q[0] + q[2] * q[2]),
        zz + (q[0] * q[0] + q[1] * q[1]),
        xy - q[0] * q[1],
        xz - q[0] * q[2],
        yz - q[1] * q[2],
    )
    return where(on, (add(S, r), add(U, cross(q, r)), add(sum_q, q), G1), (S, U, sum_q, G))


@traced
def _answers(n, m, inv_m, J, F, T, S, U, sum_q, G):
    """η from Aᵀ r and G."""
    epsilon = EPSILON * inv_m
    xx, yy, zz, xy, xz, yz = G
    s = 1.0 / (n + EPSILON)
    inverse = inverse_symmetric(
        (
            xx - s * (sum_q[1] * sum_q[1] + sum_q[2] * sum_q[2]),
            xy + s * sum_q[0] * sum_q[1],
            xz + s * sum_q[0] * sum_q[2],
            yy - s * (sum_q[0] * sum_q[0] + sum_q[2] * sum_q[2]),
            yz + s * sum_q[1] * sum_q[2],
            zz - s * (sum_q[0] * sum_q[0] + sum_q[1] * sum_q[1]),
        )
    )
    y, z = rigid(s, inverse, sum_q, S, U)
    S, U = axpy(-m, y, F), axpy(-1.0, times(J, z), T)
    lam, nu = rigid(s, inverse, sum_q, S, U)
    y, z = rigid(s, inverse, sum_q, scale(EPSILON, lam), scale(epsilon, times(J, nu)))
    return add(lam, y), add(nu, z)


@traced
def _given(rows, c, mu, on, tries, lam, nu, S, U, done):
    """Row c's impulse from η, and what it adds to their sum and moment; is it inside its cone?"""
    q = vec2(rows, c, Q)
    p = add(lam, cross(nu, q))
    S, U = where(on, (add(S, p), add(U, cross(q, p))), (S, U))
    p = in_axes(rows, c, p)
    put2(rows, c, P, where(on & tries, p, vec2(rows, c, P)))
    return S, U, done & (no(on) | in_cone(p, mu))


@stage
def stick(rows, n, m, inv_m, J, inv_J, mu, tries, v, w, F, T):
    """Try to make every contact stick.

    With A the points' 3n rows, which take the body's velocities to theirs, and r the velocities that a
    guess at the impulses leaves, Δp solves A M⁻¹ Aᵀ Δp = −r. Many points that stick are more conditions
    than a rigid body has freedoms. So first r is replaced by the nearest rigid motion, r ≈ A ξ: what
    differs no impulse can undo. That gives the force and moment to apply, (F, T) − M ξ; the least
    impulses that do are themselves a rigid motion of the points, p = A η:

        (G + ε M) ξ = Aᵀ r,    G η = (F, T) − M ξ,    G = Aᵀ A

    where G belongs to unit masses at the points. Where friction or normal forces are not unique, the
    result depends neither on the order of the points nor on the guess.

    Args:
        rows: n rows with AXES, Q and AIM; P is filled.
        n: how many.
        m: kg.
        inv_m: its inverse.
        J: principal moments, kg m².
        inv_J: their inverses.
        mu: friction coefficient.
        tries: whether to: the rows keep their impulses where not.
        v: velocity with the guess in it, body axes.
        w: angular velocity with the guess in it.
        F: impulse of the guess, N s.
        T: its moment, N m s.

    Returns:
        (done, v, w): done if it was to, and every impulse is inside its cone.
    """
    apart()
    zero = filled(v[0], 0.0)
    S, U, sum_q = (zero, zero, zero), (zero, zero, zero), (zero, zero, zero)
    e = scale(EPSILON * inv_m, J)
    G = (e[0] + zero, e[1] + zero, e[2] + zero, zero, zero, zero)
    rows_in_use = int(largest(n))
    for c in range(rows_in_use):
        S, U, sum_q, G = _gathered(rows, c, c < n, v, w, S, U, sum_q, G)
    lam, nu = _answers(n, m, inv_m, J, F, T, S, U, sum_q, G)
    S, U = (zero, zero, zero), (zero, zero, zero)
    done = tries
    for c in range(rows_in_use):
        S, U, done = _given(rows, c, mu, c < n, tries, lam, nu, S, U, done)
        if not some(done):
            return done, v, w
    v, w = spread(inv_m, inv_J, axpy(-1.0, F, S), axpy(-1.0, T, U), v, w)
    return done, v, w
