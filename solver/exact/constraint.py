"""Sustained contact: the forces that keep closed points on the surface, and the motion they leave.

A closed point slides: it does not accelerate along N, and friction is μ times the normal force, against
its slip (Eq. 11; without friction these are Eqs. 6 and 7). Or it sticks, or rolls: it does not accelerate
at all. With A the rows of what must not accelerate, and V those of what each force does, friction included,

    (A Vᵀ) λ = −l,    l = A a_free + c                                     (6, for several contacts)

Where the forces are not unique, the λ of least norm are taken; for points that stick, or slide without
friction, the motion does not depend on that.

What the constraints keep is put back after every step: gaps, the places of sharp points that stick, and
velocities, each by the smallest correction in the sense of kinetic energy, M⁻¹ Aᵀ.
"""

from math import inf, sqrt

import numpy as np

from ..algebra import (
    add,
    axpy,
    dot,
    jit,
    matrix,
    put,
    put2,
    put_quat,
    scale,
    six2,
    stage,
    times,
    to_body,
    to_world,
    vec2,
)
from ..contact import centripetal, gyroscopic
from ..flight import turn
from ..friction import cone_impulse
from ..kick import begin, turning
from ..model import gap_of, load, seen
from ..sweep import AIM, ARM, AXES, INV_K, POINT, SLIP, STEP, TARGET, TURN, WIDTH, K, P, Q, fill, in_axes
from .least_norm import least_norm

# What is remembered of each hull point: how it touches, and two numbers along t1 and t2. Of a sharp
# point that sticks they are the place where, m; of one that slides, the last direction of slip.
FREE, SLIDES, STICKS = 0.0, 1.0, 2.0

STILL = 1e-12
"""m/s: slower than this a contact does not move, along the normal or across it."""

ON_CONE = 1.0 - 1e-12
"""Friction that fills so much of its cone slides."""

SLAVED = 1e-9
"""m/s: slip that is slower has the direction in which it can grow, or the one that it had. A smooth start
of slip is stiff: steps would have to be shorter than its speed over what friction decelerates it by."""

# What the equations are about.
FORCE, POSE, MOTION = 0, 1, 2

MAX_POSE = 4
FINEST_GAP = 1e-16
"""m, and of the distance from the origin: nearer than that nothing can be put."""

SPEED, RATE = TARGET, STEP
"""Columns of a row, used here for N·u, m/s, and for the rate of the slip speed, m/s²."""


@stage
def workspace(points):
    """Room for `rates` and what follows from it: (rows, A, V, B, Q, r, λ)."""
    n = 3 * points
    return (
        np.zeros((points, WIDTH)), np.zeros((n, 6)), np.zeros((n, 6)), np.zeros((n, n)),
        np.zeros((n, n)), np.zeros(n), np.zeros(n),
    )  # fmt: skip


@jit
def scales(body, a, torque, y):
    """What errors in (x, quat, v, w) are measured by: m, 1, m/s, rad/s; and forces, N."""
    _x, _quat, v, w = load(y)
    size = body[4]
    pull = sqrt(dot(a, a))
    spin = sqrt(dot(w, w))
    fast = max(sqrt(dot(v, v)), spin * size, sqrt(pull * size))
    twist = sqrt(dot(torque, torque))
    weight = body[0] * (pull + spin * spin * size) + (twist / size if size > 0.0 else 0.0)
    return size, max(fast, 1e-30), max(spin, fast / size if size > 0.0 else 0.0, 1e-30), max(weight, 1e-300)


@stage
def closed_rows(body, hull, ground, mu, y, contacts, rows):
    """A row for each contact that is not FREE, in body axes, with its velocity. Returns how many."""
    x, quat, v, w = load(y)
    R = matrix(quat)
    view = seen(ground, R, x)
    v_b = to_body(R, v)
    n = 0
    for k in range(hull.shape[0]):
        if contacts[k, 0] != FREE:
            begin(rows, n, hull, k, ground[4], view)
            b = vec2(hull, k, 0)
            put2(rows, n, AIM, turning(rows, n, ground[4], R, b, hull[k, 3], v_b, w, (0.0, 0.0, 0.0)))
            u = fill(rows, n, body[1], body[3], mu, v_b, w)
            rows[n, SPEED] = u[0]
            n += 1
    return n


@jit
def changing(hull, rows, c, w, w_dot):
    """How contact c's velocity changes because the body, and over curved ground the normal, turn (Eq. 5)."""
    b = vec2(hull, int(rows[c, POINT]), 0)
    return add(vec2(rows, c, AIM), centripetal(w, w_dot, b, vec2(rows, c, Q)))


@jit
def direction(rows, c, contacts):
    """Of contact c's slip; of one that hardly slips, what is remembered."""
    s1, s2 = rows[c, SLIP], rows[c, SLIP + 1]
    speed = sqrt(s1 * s1 + s2 * s2)
    if speed > SLAVED:
        return s1 / speed, s2 / speed
    k = int(rows[c, POINT])
    return contacts[k, 1], contacts[k, 2]


@jit
def equations_of(hull, contacts, k, about):
    """How many a contact has: 3 if it sticks, but a round point that rolls has no place to keep."""
    return 3 if contacts[k, 0] == STICKS and (about != POSE or hull[k, 3] == 0.0) else 1


@stage
def equations(hull, contacts, mu, inv_m, rows, n, about, A, V):
    """Fill A and V. Returns the number of equations."""
    m = 0
    for c in range(n):
        k = int(rows[c, POINT])
        for j in range(equations_of(hull, contacts, k, about)):
            for i in range(3):
                A[m, i] = rows[c, AXES + 3 * j + i]
                A[m, 3 + i] = rows[c, ARM + 3 * j + i]
                V[m, i] = inv_m * A[m, i]
                V[m, 3 + i] = rows[c, TURN + 3 * j + i]
            m += 1
        if about == FORCE and mu > 0.0 and contacts[k, 0] == SLIDES:
            s1, s2 = direction(rows, c, contacts)
            for i in range(3):
                V[m - 1, i] -= mu * inv_m * (s1 * rows[c, AXES + 3 + i] + s2 * rows[c, AXES + 6 + i])
                V[m - 1, 3 + i] -= mu * (s1 * rows[c, TURN + 3 + i] + s2 * rows[c, TURN + 6 + i])
    return m


@stage
def answer(m, space):
    """λ of (A Vᵀ) λ = r, and what it changes: (of ẋ or ẍ, of w or ẇ), body axes."""
    _rows, A, V, B, Q_, r, lam = space
    for i in range(m):
        for j in range(m):
            total = 0.0
            for k in range(6):
                total += A[i, k] * V[j, k]
            B[i, j] = total
    least_norm(B, m, r, Q_, lam)
    dv, dw = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(m):
        dv = axpy(lam[i], vec2(V, i, 0), dv)
        dw = axpy(lam[i], vec2(V, i, 3), dw)
    return dv, dw


@jit
def begin_slip(hull, mu, contacts, rows, a_b, w, w_dot):
    """The direction of a lone contact's slip that is about to grow from nothing: along its own growth."""
    k = int(rows[0, POINT])
    s1, s2 = rows[0, SLIP], rows[0, SLIP + 1]
    if contacts[k, 0] == SLIDES and s1 * s1 + s2 * s2 <= SLAVED * SLAVED:
        l = in_axes(rows, 0, add(a_b, changing(hull, rows, 0, w, w_dot)))
        guess = (-contacts[k, 1], -contacts[k, 2])
        p = cone_impulse(six2(rows, 0, K), six2(rows, 0, INV_K), mu, l, (l[1], l[2]), guess, (0.0, 0.0), True)
        friction = sqrt(p[1] * p[1] + p[2] * p[2])
        if friction > ON_CONE * mu * p[0] and friction > 0.0:
            contacts[k, 1], contacts[k, 2] = -p[1] / friction, -p[2] / friction


@jit
def share(mu, contacts, rows, n, lam):
    """The forces of n contacts, from their equations' λ."""
    i = 0
    for c in range(n):
        if contacts[int(rows[c, POINT]), 0] == STICKS:
            put2(rows, c, P, (lam[i], lam[i + 1], lam[i + 2]))
            i += 3
        else:
            s1, s2 = direction(rows, c, contacts)
            put2(rows, c, P, (lam[i], -mu * lam[i] * s1, -mu * lam[i] * s2))
            i += 1


@jit
def by_load(contacts, rows, n, space):
    """Scale the friction's equations where points stick, so that the least norm is that of p_t/√p_n.

    Which of many shares of friction bodies take is not theirs to say, but that one is within the cones can
    be. Of least norm, all points take as much, those that carry little more than they can; so weighted,
    each takes as it carries. The motion is the same. √p_n, relative, is left in the rows' RATE.
    """
    _rows, A, V, _B, _Q, r, _lam = space
    largest = 0.0
    for c in range(n):
        largest = max(largest, rows[c, P])
    i = 0
    for c in range(n):
        own = 3 if contacts[int(rows[c, POINT]), 0] == STICKS else 1
        s = sqrt(max(rows[c, P], 0.0) / largest) if largest > 0.0 else 1.0
        rows[c, RATE] = s
        for j in range(i + 1, i + own):
            r[j] *= s
            for k in range(6):
                A[j, k] *= s
                V[j, k] *= s
        i += own


@stage
def accelerations(body, hull, mu, a_b, torque, w, contacts, n, space):
    """(ẍ, ẇ), body axes, with the forces of n closed contacts, which are left in their rows' P.

    Returns:
        (x_ddot, w_dot, solvable): not solvable where a lone point slides as in Painlevé's paradox.
    """
    _m, inv_m, J, inv_J, _bound = body
    rows, A, V, _B, _Q, r, lam = space
    w_dot = axpy(1.0, times(inv_J, torque), gyroscopic(J, inv_J, w))
    if n == 0:
        return a_b, w_dot, True
    if n == 1 and mu > 0.0:
        begin_slip(hull, mu, contacts, rows, a_b, w, w_dot)
    count = equations(hull, contacts, mu, inv_m, rows, n, FORCE, A, V)
    i = 0
    for c in range(n):
        k = int(rows[c, POINT])
        l = add(a_b, changing(hull, rows, c, w, w_dot))
        for _ in range(equations_of(hull, contacts, k, FORCE)):
            r[i] = -dot(vec2(A, i, 0), l)
            i += 1
    dv, dw = answer(count, space)
    x_ddot, w_ddot = add(a_b, dv), add(w_dot, dw)

    share(mu, contacts, rows, n, lam)
    if mu > 0.0 and n > 1 and count > n and margin(mu, contacts, rows, n) < 0.0:
        by_load(contacts, rows, n, space)
        answer(count, space)
        share(mu, contacts, rows, n, lam)
        for c in range(n):
            if contacts[int(rows[c, POINT]), 0] == STICKS:
                s = rows[c, RATE]
                put2(rows, c, P, (rows[c, P], s * rows[c, P + 1], s * rows[c, P + 2]))
    if mu > 0.0:
        for c in range(n):
            if contacts[int(rows[c, POINT]), 0] != STICKS:
                s1, s2 = direction(rows, c, contacts)
                u_dot = add(x_ddot, changing(hull, rows, c, w, w_ddot))
                rows[c, RATE] = s1 * dot(vec2(rows, c, AXES + 3), u_dot) + s2 * dot(
                    vec2(rows, c, AXES + 6), u_dot
                )
    solvable = True
    if count == 1:
        D = 0.0  # N·K(N − μs)
        for i in range(6):
            D += A[0, i] * V[0, i]
        solvable = D > 0.0
    return x_ddot, w_ddot, solvable


@stage
def rates(body, hull, ground, mu, a, torque, y, contacts, space, dy):
    """dy/dt of y = (x, quat, v, w, p): the motion, and the hull points' normal impulses.

    Returns:
        (margin, how many contacts): the least of what must stay positive, N, pushing forces and what
        friction has left; −inf where there is no answer.
    """
    _x, quat, v, w = load(y)
    rows = space[0]
    n = closed_rows(body, hull, ground, mu, y, contacts, rows)
    R = matrix(quat)
    x_ddot, w_dot, solvable = accelerations(body, hull, mu, to_body(R, a), torque, w, contacts, n, space)
    put(dy, 0, v)
    qw, qx, qy, qz = quat
    dy[3] = -0.5 * (qx * w[0] + qy * w[1] + qz * w[2])
    dy[4] = 0.5 * (qw * w[0] + qy * w[2] - qz * w[1])
    dy[5] = 0.5 * (qw * w[1] + qz * w[0] - qx * w[2])
    dy[6] = 0.5 * (qw * w[2] + qx * w[1] - qy * w[0])
    put(dy, 7, to_world(R, x_ddot))
    put(dy, 10, w_dot)
    for k in range(hull.shape[0]):
        dy[13 + k] = 0.0
    for c in range(n):
        dy[13 + int(rows[c, POINT])] = rows[c, P]
    return (margin(mu, contacts, rows, n) if solvable else -inf), n


@stage
def margin(mu, contacts, rows, n):
    """The least of the pushes of n contacts and of what friction has left where they stick, N."""
    least = inf
    for c in range(n):
        p = vec2(rows, c, P)
        least = min(least, p[0])
        if contacts[int(rows[c, POINT]), 0] == STICKS:
            least = min(least, mu * p[0] - sqrt(p[1] * p[1] + p[2] * p[2]))
    return least


@jit
def place_of(hull, rows, c, R, x):
    """Where contact c's sharp point is along its tangents, m."""
    r1 = add(x, to_world(R, vec2(hull, int(rows[c, POINT]), 0)))
    return dot(to_world(R, vec2(rows, c, AXES + 3)), r1), dot(to_world(R, vec2(rows, c, AXES + 6)), r1)


@stage
def keep(body, hull, ground, mu, y, contacts, space):
    """Put y back where its constraints hold: the pose first, then the velocities. Returns how many."""
    _m, inv_m, J, inv_J, _bound = body
    rows, A, V, _B, _Q, r, _lam = space
    x, quat, v, w = load(y)
    size = y[3] * y[3] + y[4] * y[4] + y[5] * y[5] + y[6] * y[6]
    put_quat(y, 3, (y[3] / sqrt(size), y[4] / sqrt(size), y[5] / sqrt(size), y[6] / sqrt(size)))
    n = closed_rows(body, hull, ground, mu, y, contacts, rows)
    if n == 0:
        return n
    finest = FINEST_GAP * (1.0 + abs(x[0]) + abs(x[1]) + abs(x[2]))
    for _ in range(MAX_POSE):
        x, quat, v, w = load(y)
        R = matrix(quat)
        view = seen(ground, R, x)
        count = equations(hull, contacts, mu, inv_m, rows, n, POSE, A, V)
        i = 0
        worst = 0.0
        for c in range(n):
            k = int(rows[c, POINT])
            r[i] = -gap_of(hull, k, ground[4], view)
            worst = max(worst, abs(r[i]))
            i += 1
            if equations_of(hull, contacts, k, POSE) == 3:
                at1, at2 = place_of(hull, rows, c, R, x)
                r[i], r[i + 1] = contacts[k, 1] - at1, contacts[k, 2] - at2
                worst = max(worst, abs(r[i]), abs(r[i + 1]))
                i += 2
        if worst <= finest:
            break
        dx, turned = answer(count, space)
        quat, w = turn(J, inv_J, quat, w, scale(0.5, turned))
        put(y, 0, add(x, to_world(R, dx)))
        put_quat(y, 3, quat)
        put(y, 10, w)
        closed_rows(body, hull, ground, mu, y, contacts, rows)

    count = equations(hull, contacts, mu, inv_m, rows, n, MOTION, A, V)
    i = 0
    for c in range(n):
        r[i] = -rows[c, SPEED]
        i += 1
        if contacts[int(rows[c, POINT]), 0] == STICKS:
            r[i], r[i + 1] = -rows[c, SLIP], -rows[c, SLIP + 1]
            i += 2
    dv, dw = answer(count, space)
    x, quat, v, w = load(y)
    put(y, 7, add(v, to_world(matrix(quat), dv)))
    put(y, 10, add(w, dw))
    return n
