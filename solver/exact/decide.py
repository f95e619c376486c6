"""Which of the touching points push, which of them slide, and which stick: decided from accelerations.

For points that touch and do not move along the normal, the article's two cases, f = −l/G or off (Eq. 7),
become one problem: no point accelerates into the ground, none pulls, only those push that do not accelerate
away; and friction holds what does not slip if it can, else slip begins against it.
"""

from math import sqrt

from ..algebra import add, axpy, matrix, put2, six2, stage, times, to_body, vec2
from ..contact import gyroscopic
from ..friction import cone_impulse
from ..model import load
from ..sweep import INV_K, POINT, SLIP, TARGET, K, P, apply, in_axes, velocity
from .constraint import (
    FREE,
    ON_CONE,
    SLAVED,
    SLIDES,
    STICKS,
    accelerations,
    changing,
    closed_rows,
    direction,
    margin,
    scales,
)

SWEEPS = 2000
AGREED = 1e-14
"""Of the free acceleration: sweeps agree when none changes a point's acceleration by more."""

HOLDS = 1e-13
"""Of the weight: by so much a force may pull, or friction hold too much. A segment ends at ten times that."""

OK = -1


@stage
def decide(body, hull, ground, mu, a, torque, y, contacts, space):
    """Set how each closed point touches, so that the forces that follow are those of rigid contact.

    Args:
        body: (m, 1/m, J, 1/J, bound).
        hull: (p, 4).
        ground: (N, t1, t2, d, field).
        mu: friction coefficient.
        a: g + F_ext/m, m/s².
        torque: N m, body axes.
        y: motion; closed points do not move along the normal.
        contacts: (p, MEMORY): every point that touches and does not leave is not FREE.
        space: of `workspace`.

    Returns:
        OK, or the hull point whose force has no answer: Painlevé's paradox.
    """
    rows = space[0]
    n = closed_rows(body, hull, ground, mu, y, contacts, rows)
    if n == 0:
        return OK
    for c in range(n):
        k = int(rows[c, POINT])
        slip = sqrt(rows[c, SLIP] ** 2 + rows[c, SLIP + 1] ** 2)
        contacts[k, 0] = SLIDES if slip > SLAVED or mu == 0.0 else STICKS
    _x, quat, _v, w = load(y)
    a_b = to_body(matrix(quat), a)
    _a, _w, solvable = accelerations(body, hull, mu, a_b, torque, w, contacts, n, space)
    weight = scales(body, a, torque, y)[3]
    if solvable and margin(mu, contacts, rows, n) >= -HOLDS * weight:
        return OK
    return sweep(body, hull, mu, a_b, torque, w, contacts, rows, n)


@stage
def sweep(body, hull, mu, a_b, torque, w, contacts, rows, n):
    """Sweep Eq. 7 with friction over n points until they agree, and see which push, slide and stick."""
    _m, inv_m, J, inv_J, _bound = body
    w_dot = axpy(1.0, times(inv_J, torque), gyroscopic(J, inv_J, w))
    size = 0.0
    for c in range(n):
        # what the point would accelerate by, less what `velocity` says of (a, ẇ): Eq. 5's c
        c_term = in_axes(rows, c, changing(hull, rows, c, w, (0.0, 0.0, 0.0)))
        put2(rows, c, TARGET, c_term)
        put2(rows, c, P, (0.0, 0.0, 0.0))
        l = add(velocity(rows, c, mu, a_b, w_dot), c_term)
        size = max(size, abs(l[0]), abs(l[1]), abs(l[2]))
    x_ddot, w_ddot = a_b, w_dot
    jammed = OK
    for _ in range(SWEEPS):
        change = 0.0
        jammed = OK
        for c in range(n):
            k = int(rows[c, POINT])
            p, kk = vec2(rows, c, P), six2(rows, c, K)
            u = add(velocity(rows, c, mu, x_ddot, w_ddot), vec2(rows, c, TARGET))
            b = (
                u[0] - kk[0] * p[0] - kk[1] * p[1] - kk[2] * p[2],
                u[1] - kk[1] * p[0] - kk[3] * p[1] - kk[4] * p[2],
                u[2] - kk[2] * p[0] - kk[4] * p[1] - kk[5] * p[2],
            )
            if contacts[k, 0] == STICKS:
                new = cone_impulse(
                    kk, six2(rows, c, INV_K), mu, b, (b[1], b[2]), (p[1], p[2]), (0.0, 0.0), True
                )
            else:
                s1, s2 = direction(rows, c, contacts)
                D = kk[0] - mu * (kk[1] * s1 + kk[2] * s2)
                f = 0.0
                if b[0] < 0.0:
                    if D <= 0.0:
                        jammed = k
                    else:
                        f = -b[0] / D
                new = (f, -mu * f * s1, -mu * f * s2)
            dp = (new[0] - p[0], new[1] - p[1], new[2] - p[2])
            put2(rows, c, P, new)
            x_ddot, w_ddot = apply(rows, c, inv_m, mu, dp, x_ddot, w_ddot)
            change = max(change, abs(dp[0]) * kk[0] + abs(dp[1]) * kk[3] + abs(dp[2]) * kk[5])
        if change <= AGREED * size or n == 1:
            break
    if jammed != OK:
        return jammed
    for c in range(n):
        k = int(rows[c, POINT])
        p = vec2(rows, c, P)
        if p[0] <= AGREED * size / rows[c, K]:
            contacts[k, 0] = FREE
        elif contacts[k, 0] == STICKS:
            friction = sqrt(p[1] * p[1] + p[2] * p[2])
            if friction > ON_CONE * mu * p[0]:
                contacts[k, 0] = SLIDES
                contacts[k, 1], contacts[k, 2] = -p[1] / friction, -p[2] / friction
    return OK
