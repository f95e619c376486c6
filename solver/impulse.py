"""Method "impulse": second-order time stepping with impulses, friction and restitution.

One step of h seconds, from a pose and velocities at its start to those at its end:

    collide    points that touch and close get an impact: Eq. 8 for all of them at once
    advance    half a drift; all impulses of the step at the middle pose; half a drift
    locate     did a point go below the ground? then the step ends where it touches, and goes on there
    project    positions alone, onto the surface, along M⁻¹Wᵀ

Drift is straight flight and free spin. Gravity, forces and torque are kicks at the middle pose, so
constant acceleration is exact, and so is rest. A closed contact asks for the velocity at the middle
that lets the *end* of the step meet the constraint: Eq. 5's c, at velocity level. That, and friction
along the mean slip, make sustained contact second order for a few multiplications.
"""

import numpy as np

from .algebra import (
    add,
    axpy,
    dot,
    entry,
    jit,
    matrix,
    put,
    scale,
    times,
    to_body,
    to_world,
    turned,
    vec,
)
from .contact import centripetal, gyroscopic, inverse_mass, shift
from .flight import spin
from .model import (
    CLOSED,
    LATE,
    MEMORY,
    NOT_FINITE,
    OK,
    OPEN,
    TOUCH,
    arm,
    closing_speed,
    gap,
    is_finite,
    load,
    store,
    unpack,
)
from .sweep import (
    P,
    POINT,
    SLIP,
    TARGET,
    WIDTH,
    agree,
    apply,
    fill,
    strike,
    velocity,
    world_impulse,
)

SLOW = 0.1
"""Of g h: approaching slower than gravity's work in a tenth of a step, an impact is plastic; leaving
slower, a contact stays closed. Otherwise a ball would bounce for ever within one step."""

MAX_IMPACTS = 3
"""A step. What is left of it then goes by one plastic step."""

MAX_LOCATE = 40
MAX_ROUNDS = 4
MAX_PROJECT = 20
GAP_TOLERANCE = 1e-13


@jit
def drift(body, x, quat, v, w, h):
    """Straight flight and free spin for h seconds."""
    quat, w = spin(body[2], body[3], quat, w, h)
    return axpy(h, v, x), quat, w


@jit
def advance(body, hull, plane, law, a, torque, x, quat, v, w, contacts, rows, h):
    """Half a drift, all impulses at the middle pose, half a drift.

    Contacts that are CLOSED hold their point on the surface if that takes a push; LATE ones keep it
    from passing through. Their impulses are left in `rows`, so that a trial can be thrown away.

    Returns:
        (x, quat, v, w, n): the end of the step, and how many rows are filled.
    """
    m, inv_m, J, inv_J, _bound = body
    mu = law[0]
    half = 0.5 * h
    x, quat, w = drift(body, x, quat, v, w, half)
    R = matrix(quat)
    N, t1, t2, _d = plane

    n = 0
    for k in range(hull.shape[0]):
        if contacts[k, 0] != OPEN:
            row = rows[n]
            b, q = arm(hull, k, plane, R)
            fill(row, k, inv_m, inv_J, mu, R, N, t1, t2, q)
            u = velocity(row, mu, v, w)
            row[SLIP] = u[1]
            row[SLIP + 1] = u[2]
            n += 1

    v = axpy(h, a, v)
    w = axpy(h, times(inv_J, torque), w)
    for c in range(n):
        row = rows[c]
        contact = contacts[int(row[POINT])]
        p = scale(h, vec(contact, 1))
        put(row, P, p)
        v, w = apply(row, inv_m, mu, p, v, w)

    w_dot = gyroscopic(J, inv_J, w)
    for c in range(n):
        row = rows[c]
        k = int(row[POINT])
        if contacts[k, 0] == CLOSED:
            b, q = arm(hull, k, plane, R)
            c_b = scale(-half, centripetal(w, w_dot, b, q))
            row[TARGET] = dot(to_body(R, N), c_b)
            if mu > 0.0:
                row[TARGET + 1] = dot(to_body(R, t1), c_b)
                row[TARGET + 2] = dot(to_body(R, t2), c_b)
        else:
            put(row, TARGET, (-max(0.0, gap(hull, k, plane, R, x)) / half, 0.0, 0.0))
    v, w = agree(rows, n, inv_m, mu, 1.0, v, w)

    x, quat, w = drift(body, x, quat, v, w, half)
    return x, quat, v, w, n


@jit
def lowest_open(hull, plane, R, x, contacts):
    """Index and gap of the open point that is deepest; (-1, 0) if none is open."""
    deepest, at = 0.0, -1
    for k in range(hull.shape[0]):
        if contacts[k, 0] == OPEN:
            g = gap(hull, k, plane, R, x)
            if at < 0 or g < deepest:
                deepest, at = g, k
    return at, deepest


@jit
def collide(body, hull, plane, law, slow, x, quat, v, w, contacts, rows, push):
    """Impact of every point that touches and closes (Eq. 8), with friction and restitution.

    Points that touch and do not leave are closed afterwards.
    """
    m, inv_m, J, inv_J, _bound = body
    mu, e = law
    R = matrix(quat)
    N, t1, t2, _d = plane
    n = 0
    struck = False
    for k in range(hull.shape[0]):
        closed = contacts[k, 0] == CLOSED
        if closed or abs(gap(hull, k, plane, R, x)) <= TOUCH:
            row = rows[n]
            _b, q = arm(hull, k, plane, R)
            fill(row, k, inv_m, inv_J, mu, R, N, t1, t2, q)
            u = velocity(row, mu, v, w)
            row[SLIP] = u[1]
            row[SLIP + 1] = u[2]
            put(row, TARGET, (0.0, 0.0, 0.0))
            if not closed:
                if u[0] < -TOUCH:
                    struck = True
                if u[0] < -slow:
                    row[TARGET] = -e * u[0]
            n += 1
    if n == 0:
        return v, w
    if struck:
        v, w = strike(rows, n, m, inv_m, J, mu, v, w)
    for c in range(n):
        row = rows[c]
        k = int(row[POINT])
        if struck:
            add_to(push[k], world_impulse(row, mu))
        if contacts[k, 0] != CLOSED and velocity(row, mu, v, w)[0] <= max(TOUCH, slow):
            put(contacts[k], 0, (CLOSED, 0.0, 0.0, 0.0))
    return v, w


@jit
def add_to(array, values):
    """Add a vector to three entries of an array."""
    for j in range(3):
        array[j] += values[j]


@jit
def commit(rows, n, mu, contacts, push, h):
    """Keep a trial's impulses: for the warm start, the record, and which contacts stay closed."""
    for c in range(n):
        row = rows[c]
        contact = contacts[int(row[POINT])]
        add_to(push[int(row[POINT])], world_impulse(row, mu))
        if contact[0] == CLOSED and row[P] > 0.0:
            put(contact, 1, scale(1.0 / h, vec(row, P)))
        else:
            put(contact, 0, (OPEN, 0.0, 0.0, 0.0))


@jit
def project(body, hull, plane, x, quat, w, contacts):
    """Positions alone: closed points onto the surface, open ones out of it, along M⁻¹Wᵀ.

    Newton to rounding. The world's angular momentum stays, so w turns with the body.
    """
    _m, inv_m, J, inv_J, _bound = body
    N = plane[0]
    R = matrix(quat)
    L = to_world(R, times(J, w))
    moved = False
    for _ in range(MAX_PROJECT):
        worst = 0.0
        for k in range(hull.shape[0]):
            g = gap(hull, k, plane, R, x)
            if abs(g) > GAP_TOLERANCE and (g < 0.0 or contacts[k, 0] == CLOSED):
                worst = max(worst, abs(g))
                _b, q = arm(hull, k, plane, R)
                N_b = to_body(R, N)
                lift, turn = shift(inv_m, inv_J, N_b, q, inverse_mass(inv_m, inv_J, N_b, q), g)
                x = axpy(lift, N, x)
                quat = turned(quat, scale(0.5, turn))
                R = matrix(quat)
                moved = True
        if worst <= GAP_TOLERANCE:
            break
    if moved:
        w = times(inv_J, to_body(R, L))
    return x, quat, w


@jit
def locate(body, hull, plane, law, a, torque, x, quat, v, w, contacts, rows, h, depth, k):
    """Time of the first touch within (0, h]: Newton on the step map, from the right, in a bracket.

    Args:
        depth: gap (< 0) of the deepest open point at h.
        k: that point.

    Returns:
        (t, x, quat, v, w, n): the end of a step of t seconds at which no open point is below the
        surface and one touches it.
    """
    lo, hi = 0.0, h
    t = h
    x1, quat1, v1, w1, n = advance(
        body, hull, plane, law, a, torque, x, quat, v, w, contacts, rows, t
    )
    for _ in range(MAX_LOCATE):
        speed = closing_speed(hull, k, plane, matrix(quat1), v1, w1)
        t_next = t - depth / speed if speed < 0.0 else 0.5 * (lo + hi)
        if not lo < t_next < hi:
            t_next = 0.5 * (lo + hi)
        if t_next == lo or t_next == hi:
            break
        t = t_next
        x1, quat1, v1, w1, n = advance(
            body, hull, plane, law, a, torque, x, quat, v, w, contacts, rows, t
        )
        k, depth = lowest_open(hull, plane, matrix(quat1), x1, contacts)
        if abs(depth) <= 0.01 * TOUCH:
            break
        if depth < 0.0:
            hi = t
        else:
            lo = t
    return t, x1, quat1, v1, w1, n


@jit
def step(body, hull, plane, law, a, torque, x, quat, v, w, contacts, rows, push, h):
    """One step of h seconds. `contacts` and `push` (impulses in world axes, summed) are updated.

    Args:
        body: (m, 1/m, J, 1/J, radius of the bounding sphere).
        hull: (p, 4) points in principal axes and their radii, m.
        plane: (N, t1, t2, N·point).
        law: (μ, e).
        a: g + F_ext/m, m/s², world axes.
        torque: N m, body axes.
        x: (3,) m.
        quat: (4,).
        v: (3,) m/s.
        w: (3,) rad/s, body axes.
        contacts: (p, MEMORY).
        rows: (p, WIDTH) scratch.
        push: (p, 3) N s.
        h: s.

    Returns:
        (x, quat, v, w).
    """
    N, _t1, _t2, d = plane
    bound = body[4]
    free = torque[0] == 0.0 and torque[1] == 0.0 and torque[2] == 0.0

    # Too high for any contact, at the start and at the end: nothing but flight.
    height = dot(N, x) - d
    fall = h * (dot(N, v) + 0.5 * h * dot(N, a))
    if height > bound and height + fall > bound:
        for k in range(hull.shape[0]):
            contacts[k, 0] = OPEN
        if free:
            x, quat, w = drift(body, axpy(0.5 * h * h, a, x), quat, v, w, h)
            return x, quat, axpy(h, a, v), w
        x, quat, v, w, _n = advance(
            body, hull, plane, law, a, torque, x, quat, v, w, contacts, rows, h
        )
        return x, quat, v, w

    mu = law[0]
    slow = SLOW * abs(dot(N, a)) * h
    rest = h
    for impact in range(MAX_IMPACTS + 1):
        v, w = collide(body, hull, plane, law, slow, x, quat, v, w, contacts, rows, push)
        x1, quat1, v1, w1, n = advance(
            body, hull, plane, law, a, torque, x, quat, v, w, contacts, rows, rest
        )
        k, depth = lowest_open(hull, plane, matrix(quat1), x1, contacts)
        t = rest
        if k >= 0 and depth < -TOUCH:
            if impact < MAX_IMPACTS:
                t, x1, quat1, v1, w1, n = locate(
                    body, hull, plane, law, a, torque, x, quat, v, w, contacts, rows, rest, depth, k
                )
            else:
                x1, quat1, v1, w1, n = plastic(
                    body, hull, plane, law, a, torque, x, quat, v, w, contacts, rows, rest
                )
        commit(rows, n, mu, contacts, push, t)
        quat, v = quat1, v1
        x, quat, w = project(body, hull, plane, x1, quat1, w1, contacts)
        rest -= t
        if rest <= 0.0:
            break
    return x, quat, v, w


@jit
def plastic(body, hull, plane, law, a, torque, x, quat, v, w, contacts, rows, h):
    """A step in which every open point that would end below is kept from it, newcomers added."""
    x1, quat1, v1, w1, n = x, quat, v, w, 0
    for _ in range(MAX_ROUNDS):
        x1, quat1, v1, w1, n = advance(
            body, hull, plane, law, a, torque, x, quat, v, w, contacts, rows, h
        )
        R = matrix(quat1)
        added = False
        for k in range(hull.shape[0]):
            if contacts[k, 0] == OPEN and gap(hull, k, plane, R, x1) < -TOUCH:
                put(contacts[k], 0, (LATE, 0.0, 0.0, 0.0))
                added = True
        if not added:
            break
    return x1, quat1, v1, w1, n


@entry
def run(body, hull, plane, law, a, torque, state, contacts, f, options, h, n):
    """n steps of h seconds, in place.

    Args:
        body: (5,) m, principal moments, radius of the bounding sphere.
        hull: (p, 4).
        plane: (10,) N, t1, t2, N·point.
        law: (2,) μ, e.
        a: (3,) m/s².
        torque: (3,) N m, principal axes.
        state: (13,) x, quat, v (world axes), w (principal axes).
        contacts: (p, MEMORY) the contacts' memory.
        f: (p,) filled with the mean normal force of each hull point, N.
        options: none.
        h: s.
        n: steps.

    Returns:
        OK, or NOT_FINITE with `state` as it was before the step that failed.
    """
    body_, plane_ = unpack(body, plane)
    law_ = (law[0], law[1])
    a_ = vec(a, 0)
    torque_ = vec(torque, 0)
    rows = np.zeros((hull.shape[0], WIDTH))
    push = np.zeros((hull.shape[0], 3))
    f[:] = 0.0
    x, quat, v, w = load(state)
    for _ in range(n):
        x, quat, v, w = step(
            body_, hull, plane_, law_, a_, torque_, x, quat, v, w, contacts, rows, push, h
        )
        if not is_finite(x, quat, v, w):
            return NOT_FINITE
        store(state, x, quat, v, w)
    for k in range(hull.shape[0]):
        if n > 0:
            f[k] = dot(plane_[0], vec(push[k], 0)) / (n * h)
    return OK


@entry
def push_out(body, hull, plane, law, state):
    """Positions alone: a shallow overlap out of the ground, before a run, in place."""
    body_, plane_ = unpack(body, plane)
    x, quat, v, w = load(state)
    memory = np.zeros((hull.shape[0], MEMORY))
    x, quat, w = project(body_, hull, plane_, x, quat, w, memory)
    store(state, x, quat, v, w)
