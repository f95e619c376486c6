"""Method "exact": from event to event.

    fly        without contact: in closed form to the first touch, which is certified
    segment    with contact, or with torque: error-controlled, to the event that ends it
    resolve    what touches: impacts (Eq. 12), then which points push, slide and stick

A bouncing point whose hops get ever shorter is followed hop by hop, each in closed form, until it
leaves the ground slower than STILL: that is after 120 bounces at e = 0.8. Several points that clatter
against each other are at rest once all of them are within NEAR of the ground and slower than SOFT.
"""

from math import inf, sqrt

import numpy as np

from ..algebra import dot, entry, jit, matrix, put2, stage, to_body, to_world, vec, vec2
from ..contact import gyroscopic, push
from ..model import (
    CROWDED,
    MEMORY,
    NOT_FINITE,
    OK,
    STUCK,
    TOUCH,
    gap_of,
    is_finite,
    load,
    seen,
    speed_of,
    store,
    unpack,
)
from ..sweep import POINT, SLIP, TARGET, K, P, Q, in_body, six2, strike
from .attitude import anchor
from .constraint import FREE, SLIDES, STICKS, STILL, closed_rows, keep, place_of, rates, workspace
from .decide import OK as SETTLED
from .decide import decide
from .flight import JERK, first_touch, flown, fly
from .impact import impact
from .segment import BROKEN, DONE, JAM, SIZE, segment

TOL = 1e-12
"""What option `tol` is unless given: about the error of a second of contact, of the motion's own scales."""

STEP_TOL = 0.05
"""Of `tol`: the error allowed in each step."""

NEAR = 1e-12
"""m: points this near when another comes down strike with it."""

SOFT = 1e-6
"""m/s: several points that touch and close slower than that are at rest from now on. What that leaves
out are hops of less than 1e-13 m, which positions can hardly tell from none, and as much slip. At 1e-8 hops
would be below the rounding of positions, and a slender box that lands flat would hop for minutes."""

BRIEF = 1e-9
"""A hop is so short that its acceleration changes by less than that part."""

BRIEF_FROM_STILL = 0.1
"""The same for a point that leaves with TOUCH at most: its hop's height is below 1e-18 m."""

AT_REST = 1e-12
"""m/s and rad/s, and of gravity: a body that sticks and moves and accelerates by less does neither."""

MAX_BLOWS = 30
"""At one time."""

BLOW_SWEEPS, BLOW_AGREED = 1000, 1e-14
"""Sweeps of several points that strike at once; m/s."""

MAX_EVENTS = 1000
"""That follow each other without time in between."""

# What is remembered from call to call, after the points: 1 once begun; 1 in flight, since how long, from
# which motion (13); the next step to try; what acts, acceleration and torque (6); what adding times lost.
BEGUN, FLYING, SINCE, START, NEXT, PULL, TWIST, LOST = 0, 1, 2, 3, 16, 17, 20, 23
EXTRA = 24 // MEMORY


@stage
def begin_flight(past, y):
    """Remember where a flight begins: it is not cut by records."""
    past[FLYING], past[SINCE], past[LOST] = 1.0, 0.0, 0.0
    for s in range(13):
        past[START + s] = y[s]


@stage
def flight(body, hull, ground, a, y, past, span):
    """Fly for `span` seconds or to the first touch. Returns (how long, the point that touches or -1)."""
    if past[FLYING] == 0.0:
        begin_flight(past, y)
    x, quat, v, w = load(past[START : START + 13])
    start = anchor(body[2], body[3], quat, w)
    since = past[SINCE]
    step = span - past[LOST]
    end = since + step
    t, k = first_touch(body, hull, ground, start, a, x, v, since, NEAR, end)
    hop, hopper = brief_hop(body, hull, ground, a, x, quat, v, w, start[4][2])
    if hopper >= 0 and hop >= since and k in (hopper, -1):
        t, k = (hop, hopper) if hop <= end else (end, -1)
    x, quat, v, w = fly(body, start, a, x, v, t)
    if k >= 0:
        past[FLYING] = 0.0
    else:
        past[SINCE] = t
        past[LOST] = (t - since) - step  # so that the sum of many spans is exact
    store(y, x, quat, v, w)
    return t - since, k


@stage
def brief_hop(body, hull, ground, a, x, quat, v, w, spin2):
    """(duration, point) of a hop that begins now and is a parabola to rounding; (inf, -1) if there is none.

    Its height may be far below what positions can tell apart.
    """
    R = matrix(quat)
    field, view = ground[4], seen(ground, R, x)
    v_b, a_b = to_body(R, v), to_body(R, a)
    w_dot = gyroscopic(body[2], body[3], w)
    soonest, point = inf, -1
    for k in range(hull.shape[0]):
        b = vec2(hull, k, 0)
        z, speed, bend = flown(hull, k, field, view, a_b, v_b, w, w_dot)
        if abs(z) <= TOUCH and speed > 0.0 and bend < 0.0:
            t = -2.0 * speed / bend
            jerk = JERK * spin2 * sqrt(spin2) * sqrt(dot(b, b))
            if t * jerk < -(BRIEF if speed > TOUCH else BRIEF_FROM_STILL) * bend and t < soonest:
                soonest, point = t, k
    return soonest, point


@stage
def blow(body, hull, ground, law, y, k, speed, space):
    """The impact of one point (Eq. 12), which closes at `speed` at least. Returns whether it had a path."""
    _m, inv_m, _J, inv_J, _bound = body
    mu, e = law
    rows = space[0]
    x, quat, v, w = load(y)
    memory = np.zeros((hull.shape[0], MEMORY))
    memory[k, 0] = SLIDES
    closed_rows(body, hull, ground, mu, y, memory, rows)
    u = (min(rows[0, TARGET], -speed), rows[0, SLIP], rows[0, SLIP + 1])
    kk = six2(rows, 0, K)
    if mu == 0.0:
        kk = (kk[0], 0.0, 0.0, 1.0, 0.0, 1.0)
    p_n, p_1, p_2, ok = impact(kk, mu, e, u)
    R = matrix(quat)
    v_b, w = push(inv_m, inv_J, vec2(rows, 0, Q), in_body(rows, 0, (p_n, p_1, p_2)), to_body(R, v), w)
    store(y, x, quat, to_world(R, v_b), w)
    y[SIZE + k] += p_n
    return ok


@stage
def blows(body, hull, ground, law, y, contacts, soft, space):
    """Points that strike while others touch, all at once, as `impulse` does it: Newton's law, without gain.

    `soft`: without restitution.
    """
    m, inv_m, J, _inv_J, _bound = body
    mu, e = law
    rows = space[0]
    n = closed_rows(body, hull, ground, mu, y, contacts, rows)
    for c in range(n):
        u = rows[c, TARGET]
        put2(rows, c, TARGET, (-e * u if u < -STILL and not soft else 0.0, 0.0, 0.0))
    x, quat, v, w = load(y)
    R = matrix(quat)
    v_b, w = strike(rows, n, m, inv_m, J, mu, True, to_body(R, v), w, BLOW_SWEEPS, BLOW_AGREED)
    store(y, x, quat, to_world(R, v_b), w)
    for c in range(n):
        y[SIZE + int(rows[c, POINT])] += rows[c, P]


@stage
def touching(hull, ground, y, contacts, touch, still, struck):
    """Mark what touches and does not leave as closed, and, after a blow, as not sticking any more.

    Returns:
        (how many, the fastest that closes, m/s, which).
    """
    x, quat, v, w = load(y)
    field, view = ground[4], seen(ground, matrix(quat), x)
    n, fastest, which = 0, 0.0, -1
    for k in range(hull.shape[0]):
        closed = contacts[k, 0] != FREE
        if closed or gap_of(hull, k, field, view) <= touch:
            speed = speed_of(hull, k, field, view, v, w)
            if speed > still:
                contacts[k, 0] = FREE
                continue
            n += 1
            if struck or not closed:
                contacts[k, 0] = SLIDES
            if -speed > fastest:
                fastest, which = -speed, k
    return n, fastest, which


@stage
def anchor_points(body, hull, ground, mu, y, contacts, space):
    """Remember where sharp points stick, along their rows' tangents."""
    rows = space[0]
    n = closed_rows(body, hull, ground, mu, y, contacts, rows)
    x, quat, _v, _w = load(y)
    R = matrix(quat)
    for c in range(n):
        k = int(rows[c, POINT])
        if contacts[k, 0] == STICKS:
            contacts[k, 1], contacts[k, 2] = place_of(hull, rows, c, R, x)


@jit
def curved(field):
    """Is the ground a height field?"""
    return field is not None


@stage
def resolve(body, hull, ground, law, a, torque, y, contacts, touch, still, space):
    """Impacts of what touches and closes, then how each closed point goes on.

    Returns:
        OK; STUCK; or CROWDED: over curved ground more than one point would touch.
    """
    for blow_number in range(MAX_BLOWS):
        n, fastest, which = touching(hull, ground, y, contacts, touch, still, blow_number > 0)
        if n == 0:
            return OK
        if n > 1 and curved(ground[4]):
            return CROWDED
        if fastest > still:
            if n == 1:
                if not blow(body, hull, ground, law, y, which, 0.0, space):
                    return STUCK
                contacts[which, 0] = FREE
            else:
                blows(body, hull, ground, law, y, contacts, fastest < SOFT or blow_number > 3, space)
            if fastest > SOFT or n == 1:
                still = STILL
                continue
        keep(body, hull, ground, law[0], y, contacts, space)
        which = decide(body, hull, ground, law[0], a, torque, y, contacts, space)
        if which == SETTLED:
            anchor_points(body, hull, ground, law[0], y, contacts, space)
            return OK
        # Painlevé's paradox: no force, so an impulse
        if not blow(body, hull, ground, law, y, which, STILL, space):
            return STUCK
    return STUCK


@stage
def unjam(body, hull, ground, law, y, contacts, space):
    """Where a sliding contact's force grows beyond all bounds, and no step is short enough: an impulse.

    A lone point's follows its path. Several that jam each other stop each other's slip, which takes energy.
    """
    n = closed_rows(body, hull, ground, law[0], y, contacts, space[0])
    if n == 1:
        return blow(body, hull, ground, law, y, int(space[0][0, POINT]), STILL, space)
    for c in range(n):
        contacts[int(space[0][c, POINT]), 0] = STICKS
    anchor_points(body, hull, ground, law[0], y, contacts, space)
    keep(body, hull, ground, law[0], y, contacts, space)
    return True


@stage
def rests(body, hull, ground, mu, a, torque, y, contacts, space, dy):
    """Is it at rest, for as long as nothing outside changes? Then it is put to rest entirely."""
    slow = AT_REST * (1.0 + sqrt(dot(a, a)))
    for s in range(7, SIZE):
        if abs(y[s]) > AT_REST:
            return False
    margin, n = rates(body, hull, ground, mu, a, torque, y, contacts, space, dy)
    if n == 0 or margin < 0.0:
        return False
    for s in range(7, SIZE):
        if abs(dy[s]) > slow * (1.0 if s < 10 else 1.0 / body[4]):
            return False
    for s in range(7, SIZE):
        y[s] = 0.0
    return True


@entry
def run(body, hull, ground, law, a, torque, state, contacts, f, options, h, n):
    """Go on for n h seconds, in place.

    The arguments are those of `impulse.run`, but `contacts` has EXTRA more rows, for what is remembered of
    a flight, and options[0] is `tol`.

    Returns:
        OK, NOT_FINITE, STUCK or CROWDED; then `state` is as it was.
    """
    body_, ground_ = unpack(body, ground)
    law_ = (law[0], law[1])
    a_, torque_ = vec(a, 0), vec(torque, 0)
    points = hull.shape[0]
    past = contacts[points:].reshape(-1)
    memory = contacts[:points]
    space = workspace(points)
    stages = np.zeros((SIZE, SIZE + points))
    y, y1 = np.zeros(SIZE + points), np.zeros(SIZE + points)
    y[:SIZE] = state
    f[:] = 0.0
    span = n * h
    if not span > 0.0:
        return OK
    free = torque_[0] == 0.0 and torque_[1] == 0.0 and torque_[2] == 0.0
    t, idle = 0.0, 0
    same = True
    for s in range(3):
        same = same and past[PULL + s] == a[s] and past[TWIST + s] == torque[s]
        past[PULL + s], past[TWIST + s] = a[s], torque[s]
    if past[BEGUN] == 0.0:
        past[BEGUN] = 1.0
        past[NEXT] = span
        flag = resolve(body_, hull, ground_, law_, a_, torque_, y, memory, TOUCH, TOUCH, space)
        if flag != OK:
            return flag
    elif not same:
        past[FLYING] = 0.0
        flag = resolve(body_, hull, ground_, law_, a_, torque_, y, memory, 0.0, STILL, space)
        if flag != OK:
            return flag
    while t < span:
        closed = False
        for k in range(points):
            closed = closed or memory[k, 0] != FREE
        event = True
        if not closed and free:
            dt, k = flight(body_, hull, ground_, a_, y, past, span - t)
            event = k >= 0
        elif closed and rests(body_, hull, ground_, law_[0], a_, torque_, y, memory, space, stages[0]):
            past[FLYING] = 0.0
            dt = span - t
            for k in range(points):
                y[SIZE + k] += dt * stages[0, SIZE + k]
            event = False
        else:
            past[FLYING] = 0.0
            why, dt, past[NEXT] = segment(
                body_, hull, ground_, law_[0], a_, torque_, y, memory, span - t, past[NEXT],
                STEP_TOL * options[0], space, stages, y1,
            )  # fmt: skip
            if why == BROKEN:
                return NOT_FINITE
            event = why != DONE
            if why == JAM and not unjam(body_, hull, ground_, law_, y, memory, space):
                return STUCK
        if not is_finite(*load(y)):
            return NOT_FINITE
        t += dt
        idle = idle + 1 if dt <= 0.0 else 0
        if idle > MAX_EVENTS:
            return STUCK
        if event:
            # a point that leaves by less than TOUCH and is back at once has not left
            still = STILL if dt > 0.0 else TOUCH
            flag = resolve(body_, hull, ground_, law_, a_, torque_, y, memory, NEAR, still, space)
            if flag != OK:
                return flag
        else:
            break
    for s in range(SIZE):
        state[s] = y[s]
    for k in range(points):
        f[k] = y[SIZE + k] / span
    return OK
