"""Method "impulse": second-order time stepping with impulses, friction and restitution.

One step of h seconds, from a pose and velocities at its start to those at its end:

    fly        too high for any contact: nothing but flight
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
    apart,
    axpy,
    borrowed,
    dot,
    entry,
    jit,
    keep_alive,
    matrix,
    put2,
    scale,
    stage,
    times,
    to_body,
    to_world,
    vec,
    vec2,
)
from .field import tangents
from .flight import spin
from .kick import begin, close, hold
from .model import (
    CLOSED,
    LATE,
    NOT_FINITE,
    OK,
    OPEN,
    TOUCH,
    gap_if_below,
    gap_of,
    height_over,
    is_finite,
    load,
    passes_over,
    seen,
    speed_of,
    store,
    unpack,
)
from .project import clearance, lowest_open, project
from .sweep import (
    NORMAL,
    POINT,
    STRIKE_SWEEPS,
    STRIKE_TOLERANCE,
    TARGET,
    WIDTH,
    P,
    fill,
    strike,
    velocity,
)
from .trace import every, filled, most, sqrt, traced, where

SLOW = 0.1
"""Of g h: approaching slower than gravity's work in a tenth of a step, an impact is plastic; leaving
slower, a contact stays closed. Otherwise a ball would bounce for ever within one step."""

MAX_IMPACTS = 3
"""A step. What is left of it then goes by one plastic step."""

WHOLE = 0.25
"""Of a step: a shorter piece leaves the warm start alone, its forces say little about the next."""

TOGETHER = 5e-8
"""m: points this near when another has come down strike with it. Two points of an edge that swings
about two others come down together, but for what `project` leaves."""

MAX_STEP_TURN = 0.5
"""rad; a step in which the body turns further is split: contacts are looked for at its ends. So is one
in which it crosses ground that turns further."""

MAX_STEP_PIECES = 10_000

NOTHING = (0.0, 0.0, 0.0)

MAX_LOCATE = 40
MAX_CUBIC = 6
MAX_ROUNDS = 8


@jit
def drift(body, gyro, x, quat, v, w, h):
    """Straight flight and free spin for h seconds."""
    quat, w = spin(body[2], body[3], gyro, quat, w, h)
    return axpy(h, v, x), quat, w


@jit
def fly(body, gyro, a, torque, x, quat, v, w, h):
    """A step without contacts."""
    if every((torque[0] == 0.0) & (torque[1] == 0.0) & (torque[2] == 0.0)):
        x, quat, w = drift(body, gyro, axpy(0.5 * h * h, a, x), quat, v, w, h)
        return x, quat, axpy(h, a, v), w
    half = 0.5 * h
    x, quat, w = drift(body, gyro, x, quat, v, w, half)
    v, w = axpy(h, a, v), axpy(h, times(body[3], torque), w)
    x, quat, w = drift(body, gyro, x, quat, v, w, half)
    return x, quat, v, w


@jit
def advance(body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, h):
    """Half a drift, all impulses at the middle pose, half a drift.

    Contacts that are CLOSED hold their point on the surface if that takes a push; LATE ones keep it
    from passing through. Their impulses are left in `rows`, so that a trial can be thrown away.

    Returns:
        (x, quat, v, w, n): the end of the step, and how many rows are filled.
    """
    half = 0.5 * h
    x, quat, w = drift(body, law[2], x, quat, v, w, half)
    view = seen(ground, matrix(quat), x)
    n = close(hull, ground[4], view, contacts, rows)
    v1 = axpy(h, a, v)
    w1 = axpy(h, times(body[3], torque), w)
    if n > 0:
        v1, w1 = hold(body, ground[4], view, law[0], law[2], law[3], law[4], a, v, w, v1, w1, rows, n, h)
    x, quat, w1 = drift(body, law[2], x, quat, v1, w1, half)
    return x, quat, v1, w1, n


# The same, called rather than copied where speed matters less.
trial = stage(advance.py_func if hasattr(advance, "py_func") else advance)


@jit
def came_down(hull, ground, quat, x, quat1, x1, contacts):
    """Was the OPEN point that is deepest at the end above the surface at the start, or on it?"""
    k, _depth = lowest_open(hull, ground, quat1, x1, contacts)
    return gap_of(hull, k, ground[4], seen(ground, matrix(quat), x)) >= -TOUCH


@traced
def in_blows(mu, mu_blow):
    """μ of impacts."""
    return mu if mu_blow is None else mu_blow


@stage
def collide(body, hull, ground, mu, e, several, slow, touch, x, quat, v, w, contacts, rows, push):
    """Impact of every point that touches and closes (Eq. 8), with friction and restitution.

    Points that touch and do not leave are closed afterwards. `touch` is the gap up to which they do, m;
    `mu` is the friction coefficient of blows.
    """
    apart()
    m, inv_m, J, inv_J, _bound = body
    R = matrix(quat)
    view = seen(ground, R, x)
    arrives = False
    for k in range(hull.shape[0]):
        if contacts[k, 0] == OPEN and gap_if_below(hull, k, ground, ground[4], view, touch) <= touch:
            arrives = True
    if not arrives:
        return v, w

    v_b = to_body(R, v)
    n = 0
    struck = False
    for k in range(hull.shape[0]):
        closed = contacts[k, 0] == CLOSED
        if closed or gap_if_below(hull, k, ground, ground[4], view, touch) <= touch:
            begin(rows, n, hull, k, ground[4], view)
            u = fill(rows, n, inv_m, inv_J, mu, v_b, w)
            struck = struck or (not closed and u[0] < -TOUCH)
            put2(rows, n, TARGET, (0.0, 0.0, 0.0))
            if e is not None:
                if not closed and u[0] < -slow:
                    rows[n, TARGET] = -e * u[0]
            n += 1
    if struck:
        v_b, w = strike(rows, n, m, inv_m, J, mu, several, v_b, w, STRIKE_SWEEPS, STRIKE_TOLERANCE)
        v = to_world(R, v_b)
    for c in range(n):
        k = int(rows[c, POINT])
        if struck:
            tally(push, k, rows, c, ground, ground[4])
        if contacts[k, 0] != CLOSED and velocity(rows, c, mu, v_b, w)[0] <= max(TOUCH, slow):
            remember(contacts, k, CLOSED, NOTHING)
    return v, w


@traced
def in_world(axes, p):
    """A vector along (N, t1, t2) in world axes."""
    return axpy(p[2], axes[2], axpy(p[1], axes[1], scale(p[0], axes[0])))


@jit
def tally(push, k, rows, c, ground, field):
    """Add row c's impulse to hull point k's."""
    p = vec2(rows, c, P)
    if field is None:
        add_to(push, k, in_world(ground, p))
    else:
        N = vec2(rows, c, NORMAL)
        t1, t2 = tangents(N)
        add_to(push, k, in_world((N, t1, t2), p))
        push[k, 3] += p[0]


@traced
def pushed(push, k, ground, field):
    """The normal part of hull point k's impulses, N s."""
    if field is None:
        return dot(ground[0], vec2(push, k, 0))
    return push[k, 3]


@traced
def remember(contacts, k, state, F):
    """Hull point k's state and force."""
    contacts[k, 0] = state
    put2(contacts, k, 1, F)


@traced
def add_to(array, k, a):
    """Add a vector to row k of an array."""
    put2(array, k, 0, add(a, vec2(array, k, 0)))


@jit
def commit(rows, n, ground, contacts, push, h, whole):
    """Keep a trial's impulses: which contacts stay closed, and the warm start.

    Returns:
        (opened, changed): did a contact open, is anything now remembered otherwise?
    """
    opened, changed = False, False
    typical = h >= WHOLE * whole
    for c in range(n):
        # stopping a LATE point loads the others as well: such forces would mislead the next step
        typical = typical and contacts[int(rows[c, POINT]), 0] != LATE
    for c in range(n):
        k = int(rows[c, POINT])
        p = vec2(rows, c, P)
        tally(push, k, rows, c, ground, ground[4])
        if contacts[k, 0] == CLOSED and p[0] > 0.0:
            F = vec2(contacts, k, 1)
            # what `guess` made of it: there and back might be off by a bit
            same = p[0] == h * F[0] and p[1] == h * F[1] and p[2] == h * F[2]
            if typical and not same:
                put2(contacts, k, 1, scale(1.0 / h, p))
                changed = True
        else:
            remember(contacts, k, OPEN, NOTHING)
            opened = True
    return opened, changed or opened


@jit
def descent(g0, s0, g1, s1, h):
    """About when in (0, h) a gap closes that is g0 and changes at s0 first, g1 < 0 and s1 last.

    By the cubic through all four.
    """
    c2 = 3.0 * (g1 - g0) - h * (2.0 * s0 + s1)
    c3 = 2.0 * (g0 - g1) + h * (s0 + s1)
    u = 1.0 if s1 < 0.0 else g0 / (g0 - g1)
    for _ in range(MAX_CUBIC):
        slope = h * s0 + u * (2.0 * c2 + u * 3.0 * c3)
        if slope >= 0.0:
            break
        u = min(1.0, max(0.0, u - (g0 + u * (h * s0 + u * (c2 + u * c3))) / slope))
    return u * h


@traced
def _dipped(contacts, k, h, g0, s0, g1, s1, deepest, when):
    """What point k makes of (deepest, when), by the cubic through its gap g and speed s at both ends."""
    s0, s1 = h * s0, h * s1
    c2 = 3.0 * (g1 - g0) - 2.0 * s0 - s1
    c3 = 2.0 * (g0 - g1) + s0 + s1
    # the cubic's minimum: the only root of its slope in (0, 1)
    u = -s0 / (c2 + sqrt(most(0.0, c2 * c2 - 3.0 * c3 * s0)))
    g = g0 + u * (s0 + u * (c2 + u * c3))
    dips = (contacts[k, 0] == OPEN) & (s0 < 0.0) & (s1 > 0.0) & (g < deepest)
    return where(dips, (g, u * h), (deepest, when))


@stage
def dip(hull, ground, x, quat, v, w, x1, quat1, v1, w1, contacts, h, sag):
    """When, in a step of h seconds, an OPEN point is deepest that has been below the surface in between.

    By the cubic through its gap and speed at both ends, of which neither is below. 0 if there is none.
    No gap sags below the line between its ends by more than `sag`.
    """
    apart()
    field = ground[4]
    view, view1 = seen(ground, matrix(quat), x), seen(ground, matrix(quat1), x1)
    deepest, when = filled(view[3], -TOUCH), filled(view[3], 0.0)
    for k in range(hull.shape[0]):
        if passes_over(hull, k, field, view, view1, sag):
            continue
        g0, g1 = gap_of(hull, k, field, view), gap_of(hull, k, field, view1)
        s0, s1 = speed_of(hull, k, field, view, v, w), speed_of(hull, k, field, view1, v1, w1)
        deepest, when = _dipped(contacts, k, h, g0, s0, g1, s1, deepest, when)
    return when


@stage
def locate(body, hull, ground, law, a, torque, x, quat, v, w, end, contacts, rows, h):
    """Time of the first touch within (0, h]: Newton on the step map, in a bracket, from a cubic guess.

    `end` is where `advance` comes to at h, with an open point below the surface; the rest is
    `advance`'s.

    Returns:
        (t, x, quat, v, w, n): the end of a step of t seconds at which no open point is below the
        surface and one touches it.
    """
    apart()
    lo, hi = 0.0, h
    t = h
    x1, quat1, v1, w1, n = end
    k, depth = lowest_open(hull, ground, quat1, x1, contacts)
    field = ground[4]
    view = seen(ground, matrix(quat), x)
    g0 = gap_of(hull, k, field, view)
    s0 = speed_of(hull, k, field, view, v, w)
    s1 = speed_of(hull, k, field, seen(ground, matrix(quat1), x1), v1, w1)
    t_next = descent(g0, s0, depth, s1, h)
    for _ in range(MAX_LOCATE):
        if not lo < t_next < hi:
            t_next = 0.5 * (lo + hi)
            if t_next == lo or t_next == hi:
                break
        t = t_next
        x1, quat1, v1, w1, n = trial(body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, t)
        k, depth = lowest_open(hull, ground, quat1, x1, contacts)
        if abs(depth) <= 0.01 * TOUCH:
            break
        if depth < 0.0:
            hi = t
        else:
            lo = t
        speed = speed_of(hull, k, field, seen(ground, matrix(quat1), x1), v1, w1)
        t_next = t - depth / speed if speed < 0.0 else lo
    return t, x1, quat1, v1, w1, n


@stage
def plastic(body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, h):
    """A step in which every open point that would end below is kept from it, newcomers added."""
    apart()
    x1, quat1, v1, w1, n = x, quat, v, w, 0
    for _ in range(MAX_ROUNDS):
        x1, quat1, v1, w1, n = trial(body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, h)
        view = seen(ground, matrix(quat1), x1)
        added = False
        for k in range(hull.shape[0]):
            if contacts[k, 0] == OPEN and gap_if_below(hull, k, ground, ground[4], view, -TOUCH) < -TOUCH:
                remember(contacts, k, LATE, NOTHING)
                added = True
        if not added:
            break
    return x1, quat1, v1, w1, n


@traced
def reach(bound, v, w, h):
    """More than any hull point can move in h seconds of drift, m.

    Free spin changes |w| by less than the allowance as long as a step turns by less than MAX_TURN.
    """
    return h * (sqrt(dot(v, v)) + 1.25 * bound * sqrt(dot(w, w)))


@traced
def bend(field, u):
    """How fast the normal under a point at u turns at most (Ṅ = H ċ), rad/s for m/s."""
    if field is None:
        return 0.0
    return field[5] * u


@traced
def turned(field, v, w, h):
    """How far the body turns in h seconds, and at most the ground under it, rad."""
    return h * (sqrt(dot(w, w)) + bend(field, sqrt(dot(v, v))))


@traced
def sagitta(field, bound, a, v, w, v1, w1, h):
    """More than any hull point's gap in h seconds sags below the line between its ends, m."""
    w2 = 1.6 * most(dot(w, w), dot(w1, w1))
    u2 = 2.0 * (most(dot(v, v), dot(v1, v1)) + bound * bound * w2)
    return 0.125 * h * h * (sqrt(dot(a, a)) + 2.0 * bound * w2 + bend(field, u2))


@jit
def step(body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, push, h, clear):
    """One step of h seconds. `contacts` and `push` (impulses in world axes, summed) are updated.

    Args:
        body: (m, 1/m, J, 1/J, radius of the bounding sphere).
        hull: (p, 4) points in principal axes and their radii, m.
        ground: (N, t1, t2, d, field), as in `model`.
        law: (μ, e, gyroscopic, several, centripetal, μ of blows); None: left out (`terms`). Without `several`
            there must be one hull point.
        a: g + F_ext/m, m/s², world axes.
        torque: N m, body axes.
        x: (3,) m.
        quat: (4,).
        v: (3,) m/s.
        w: (3,) rad/s, body axes.
        contacts: (p, MEMORY).
        rows: (p, WIDTH) scratch.
        push: (p, 3) N s; over a height field (p, 4), the normal parts summed in the last.
        h: s.
        clear: no OPEN point is closer to the surface than this, m; 0 if not known. It spares looking
            at points that cannot have come down yet, and never changes the result.

    Returns:
        (x, quat, v, w, clear, still): the last is 0, or how many rows push if what the contacts
        remember has not changed. If the motion has not either, then no further step will change
        anything, and `repeat` is all that they do.
    """
    N = ground[0]
    bound = body[4]
    # Too high for any contact, at the start and at the end.
    height = dot(N, x) - ground[3]
    fall = h * (dot(N, v) + 0.5 * h * dot(N, a))
    if height > bound and height + fall > bound:
        for k in range(hull.shape[0]):
            contacts[k, 0] = OPEN
        x, quat, v, w = fly(body, law[2], a, torque, x, quat, v, w, h)
        return x, quat, v, w, 0.0, 0
    return near(body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, push, h, clear)


@stage
def near(body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, push, h, clear):
    """A step of `step` near enough to the ground for contacts."""
    apart()
    bound = body[4]
    slow = SLOW * abs(dot(ground[0], a)) * h
    changed, n = True, 0
    rest = h
    for impact in range(MAX_IMPACTS + 1):
        if clear <= TOUCH:
            touch = TOUCH if impact == 0 else TOGETHER
            v, w = collide(
                body, hull, ground, in_blows(law[0], law[5]), law[1], law[3], slow, touch,
                x, quat, v, w, contacts, rows, push,
            )  # fmt: skip
        x1, quat1, v1, w1, n = advance(
            body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, rest
        )
        t = rest
        clear -= reach(bound, v, w, 0.5 * rest) + reach(bound, v1, w1, 0.5 * rest)
        if clear <= TOUCH:
            sag = sagitta(ground[4], bound, a, v, w, v1, w1, rest)
            clear = clearance(hull, ground, quat1, x1, contacts, sag)
            end = rest
            if -TOUCH <= clear < sag:
                end = dip(hull, ground, x, quat, v, w, x1, quat1, v1, w1, contacts, rest, sag)
                if end > 0.0:
                    there = trial(body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, end)
                    clear = clearance(hull, ground, there[1], there[0], contacts, TOUCH)
                    if clear < -TOUCH:
                        x1, quat1, v1, w1, n = there
                    else:  # the cubic was wrong: take the whole step again
                        x1, quat1, v1, w1, n = trial(
                            body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, rest
                        )
                        clear = 0.0
            if clear < -TOUCH:
                if impact < MAX_IMPACTS and came_down(hull, ground, quat, x, quat1, x1, contacts):
                    t, x1, quat1, v1, w1, n = locate(
                        body, hull, ground, law, a, torque,
                        x, quat, v, w, (x1, quat1, v1, w1, n), contacts, rows, end,
                    )  # fmt: skip
                else:
                    x1, quat1, v1, w1, n = plastic(
                        body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, rest
                    )
                clear = 0.0
        opened, changed = commit(rows, n, ground, contacts, push, t, h)
        if opened:
            clear = 0.0
        v = v1
        x, quat, w, clear = project(body, hull, ground, x1, quat1, w1, contacts, rows, n, clear)
        rest -= t
        if rest <= 0.0:
            break
    return x, quat, v, w, clear, n if impact == 0 and not changed else 0


@stage
def repeat(rows, n, ground, push, times):
    """The record of so many more steps like the last, after which nothing had changed (asleep)."""
    apart()
    for _ in range(times):
        for c in range(n):
            tally(push, int(rows[c, POINT]), rows, c, ground, ground[4])


@jit
def alone(several, array, k):
    """The rows that a step looks at: all, or where several contacts are left out point k's."""
    if several is None:
        return array[k : k + 1]
    return array


@jit
def deepest(several, bound, hull, ground, x, quat, v, contacts, h, k, clear):
    """Where several contacts are left out: the one point that may touch in the next h seconds.

    It is the deepest; the contact of any other is over.

    Returns:
        (k, clear): which it is, and `clear` as in `step`: not known of another point than k.
    """
    if several is not None:
        return k, clear
    if hull.shape[0] == 1 or height_over(ground, x) > bound + h * sqrt(dot(v, v)):
        return k, clear
    view = seen(ground, matrix(quat), x)
    least, at = np.inf, k
    for j in range(hull.shape[0]):
        g = gap_of(hull, j, ground[4], view)
        if g < least:
            least, at = g, j
    for j in range(hull.shape[0]):
        if j != at:
            remember(contacts, j, OPEN, NOTHING)
    return at, clear if at == k else 0.0


@jit
def split_step(body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, push, h, clear, k):
    """`step`, in pieces if the body turns far.

    The arguments are those of `step`; k is the hull point that may touch, where there are not several.

    Returns:
        (x, quat, v, w, clear, still, k): still is 0 after several pieces.
    """
    pieces = 1 + int(min(turned(ground[4], v, w, h) / MAX_STEP_TURN, MAX_STEP_PIECES))
    still = 0
    for _ in range(pieces):
        k, clear = deepest(law[3], body[4], hull, ground, x, quat, v, contacts, h, k, clear)
        x, quat, v, w, clear, still = step(
            body, alone(law[3], hull, k), ground, law, a, torque,
            x, quat, v, w, alone(law[3], contacts, k), rows, alone(law[3], push, k), h / pieces, clear,
        )  # fmt: skip
    return x, quat, v, w, clear, still if pieces == 1 else 0, k


@entry
def run(body, hull, ground, law, a, torque, state, contacts, f, options, h, n):
    """n steps of h seconds, in place.

    Args:
        body: (5,) m, principal moments, radius of the bounding sphere.
        hull: (p, 4).
        ground: ((10,) N, t1, t2, d; a field or None).
        law: (μ, e, gyroscopic, several, centripetal, μ of blows), a tuple; None: left out (`terms`).
            Without `several` only the deepest of the hull points touches, in each step. Other methods:
            (2,) μ, e.
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
    body_, ground_ = unpack(body, ground)
    a_ = vec(a, 0)
    torque_ = vec(torque, 0)
    scratch = np.zeros((hull.shape[0], WIDTH))
    pushes = np.zeros((hull.shape[0], 4))
    rows, push = borrowed(scratch), borrowed(pushes)
    points, memory = borrowed(hull), borrowed(contacts)
    x, quat, v, w = load(state)
    f[:] = 0.0
    clear = 0.0
    k = 0
    for done in range(n):
        x, quat, v, w, clear, still, k = split_step(
            body_, points, ground_, law, a_, torque_, x, quat, v, w, memory, rows, push, h, clear, k
        )
        if not is_finite(x, quat, v, w):
            return NOT_FINITE
        asleep = still > 0 and (x, quat, v, w) == load(state)
        store(state, x, quat, v, w)
        if asleep:
            repeat(rows, still, ground_, alone(law[3], push, k), n - 1 - done)
            break
    for k in range(hull.shape[0]):
        if n > 0:
            f[k] = pushed(pushes, k, ground_, ground_[4]) / (n * h)
    keep_alive(scratch, pushes)
    return OK
