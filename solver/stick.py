"""Contacts that all stick: solved at once, because sweeps share a load among many points slowly."""

from .algebra import add, axpy, cross, dot, jit, put2, scale, stage, to_world, vec2
from .friction import inverse_symmetric
from .sweep import R_, TARGET, P, Q, velocity

STILL = 1e-11
"""m/s: contacts this near their targets are left as they are."""

EPSILON = 1e-5
"""Of the body's mass: how much `least_norm` leans on it. Small, so that a pass all but ends the
residual; not so small that the impulses, found as a difference over it, lose their digits."""

MAX_PASSES = 3
RESIDUAL = 1e-6
"""m/s: a pass that begins with less ends at rounding."""


@jit
def least_norm(rows, n, m, J, R, frame_b, v, w):
    """Impulses that make every contact stick at once, cones aside; the least that do.

    Many points that stick are more conditions than a rigid body has freedoms, and sweeps share the
    load among them slowly. Here the residual velocities r of the n points are matched by one rigid
    motion (y, z): least squares, as if the points were unit masses, with a small share ε of the
    body's own mass and inertia so that it always has one answer. Then

        (ε m + n) y + z × Σq = Σr
        (ε J + Σ(|q|² − q qᵀ)) z + Σq × y = Σ q × r
        Δẋ = −y,  Δw = −z,  Δp = −(r − y − z × q)/ε

    which is (A M⁻¹ Aᵀ + ε) Δp = −r, with A the points' 3n rows, solved by 3 x 3 matrices alone. It
    shrinks r by about ε m; a second pass brings it to rounding.

    Returns:
        (v, w, worst): the velocities with Δp in them, and the largest |r| it began with, m/s.
    """
    epsilon = EPSILON / m
    S = (0.0, 0.0, 0.0)
    T = (0.0, 0.0, 0.0)
    sum_q = (0.0, 0.0, 0.0)
    xx, yy, zz = epsilon * J[0], epsilon * J[1], epsilon * J[2]
    xy, xz, yz = 0.0, 0.0, 0.0
    worst = 0.0
    for c in range(n):
        u = velocity(rows, c, 1.0, v, w)
        r_n, r_1, r_2 = (
            u[0] - rows[c, TARGET],
            u[1] - rows[c, TARGET + 1],
            u[2] - rows[c, TARGET + 2],
        )
        worst = max(worst, abs(r_n), abs(r_1), abs(r_2))
        put2(rows, c, R_, (r_n, r_1, r_2))
        r = axpy(r_1, frame_b[1], axpy(r_2, frame_b[2], scale(r_n, frame_b[0])))
        q = vec2(rows, c, Q)
        S = add(S, r)
        T = add(T, cross(q, r))
        sum_q = add(sum_q, q)
        xx += q[1] * q[1] + q[2] * q[2]
        yy += q[0] * q[0] + q[2] * q[2]
        zz += q[0] * q[0] + q[1] * q[1]
        xy -= q[0] * q[1]
        xz -= q[0] * q[2]
        yz -= q[1] * q[2]
    s = 1.0 / (n + EPSILON)
    T = axpy(-s, cross(sum_q, S), T)
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
    z = (
        inverse[0] * T[0] + inverse[1] * T[1] + inverse[2] * T[2],
        inverse[1] * T[0] + inverse[3] * T[1] + inverse[4] * T[2],
        inverse[2] * T[0] + inverse[4] * T[1] + inverse[5] * T[2],
    )
    y = scale(s, axpy(-1.0, cross(z, sum_q), S))
    for c in range(n):
        fit = add(y, cross(z, vec2(rows, c, Q)))
        fit = (dot(frame_b[0], fit), dot(frame_b[1], fit), dot(frame_b[2], fit))
        left = axpy(-1.0, fit, vec2(rows, c, R_))
        put2(rows, c, P, axpy(-1.0 / epsilon, left, vec2(rows, c, P)))
    return axpy(-1.0, to_world(R, y), v), axpy(-1.0, z, w), worst


@jit
def holds(rows, n, mu, v, w):
    """True if every contact sticks, inside its cone and on target: nothing is left to solve."""
    worst = 0.0
    for c in range(n):
        u = velocity(rows, c, 1.0, v, w)
        p = vec2(rows, c, P)
        worst = max(
            worst,
            abs(u[0] - rows[c, TARGET]),
            abs(u[1] - rows[c, TARGET + 1]),
            abs(u[2] - rows[c, TARGET + 2]),
        )
        if p[0] <= 0.0 or p[1] * p[1] + p[2] * p[2] > mu * mu * p[0] * p[0]:
            return False
    return worst < STILL


@stage
def stick(rows, n, m, J, mu, R, frame_b, v, w):
    """Try to make every contact stick, from no impulse at all.

    Where friction or normal forces are not unique these are the least ones, independent of the order
    of the points and of what came before.

    Returns:
        (done, v, w): done if every impulse is inside its cone and every point on its target.
    """
    for c in range(n):
        put2(rows, c, P, (0.0, 0.0, 0.0))
    for _ in range(MAX_PASSES):
        v, w, worst = least_norm(rows, n, m, J, R, frame_b, v, w)
        for c in range(n):
            p = vec2(rows, c, P)
            if p[0] <= 0.0 or p[1] * p[1] + p[2] * p[2] > mu * mu * p[0] * p[0]:
                return False, v, w
        if worst < RESIDUAL:
            return True, v, w
    return False, v, w
