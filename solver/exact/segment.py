"""Motion between events under forces without a closed form: sustained contact, or flight with torque.

DOP853 with error control. A step ends early where something happens: a force would have to pull,
friction no longer holds, slip stops, or an open point comes down. None of that is looked for at the end of
a step only: a step is halved until the points' accelerations rule out that an open point has been below
the surface in between, and until no stage shows what the end does not.
"""

from math import inf, sqrt

import numpy as np

from ..algebra import dot, jit, matrix, stage, vec2
from ..model import gap_of, load, seen, speed_of
from ..sweep import POINT, SLIP
from .constraint import FREE, RATE, SLIDES, STILL, direction, keep, rates, scales
from .dop853 import ERROR_3, ERROR_5, STAGES, TABLE
from .flight import hollow, within

SIZE = 13
"""Of the motion in y = (x, quat, v, w, p): v in world, w in body axes. After it come the hull points'
normal impulses so far, N s, which are integrated along, but decide nothing."""

DONE, EVENT, JAM, BROKEN = 0, 1, 2, 3

SUNK = 1e-13
"""m: an open point this deep has come down."""

PULLS = 1e-12
"""Of the body's weight, or what else it is pressed by: a force of minus that would have to pull."""

TURN = 1.0
"""rad: a longer step could deceive its own estimate of errors."""

SHORTEST = 1e-14
"""s, and of the segment: shorter steps get nowhere."""

NEARLY = 0.98
"""Of the time until slip stops at its present rate: how far a step goes. The next begins so much nearer."""

WIDEN = 4.0
"""By how much the next step is longer at most, where one was halved."""

MAX_ROOT = 100
SLACK = 1.25
"""On accelerations seen at the stages, as a bound for all of the step."""


@stage
def attempt(body, hull, ground, mu, a, torque, y, h, contacts, space, stages, y1):
    """One step of h seconds from y to y1, then what is kept is put back.

    stages[0] holds dy/dt at y; the rest is filled, stages[STAGES] with dy/dt at y1.

    Returns:
        (error of the worst component, the margin at the end, the least one seen at a stage).
    """
    least = inf
    for i in range(1, STAGES + 1):
        for s in range(y.size):
            total = 0.0
            for j in range(i):
                total += TABLE[i, j] * stages[j, s]
            y1[s] = y[s] + h * total
        if i < STAGES:
            m, _n = rates(body, hull, ground, mu, a, torque, y1, contacts, space, stages[i])
            least = min(least, m)
    length, fast, spin, _weight = scales(body, a, torque, y)
    worst = 0.0
    for s in range(SIZE):
        five, three = 0.0, 0.0
        for j in range(STAGES):
            five += TABLE[ERROR_5, j] * stages[j, s]
            three += TABLE[ERROR_3, j] * stages[j, s]
        five, three = abs(h * five), abs(h * three)
        both = sqrt(five * five + 0.01 * three * three)
        error = five * (five / both) if both > 0.0 else 0.0
        scale = length if s < 3 else (1.0 if s < 7 else (fast if s < 10 else spin))
        if not both < inf:  # or not a number
            worst = inf
        elif scale > 0.0:
            worst = max(worst, error / scale)
    if worst < inf:
        keep(body, hull, ground, mu, y1, contacts, space)
        end, _n = rates(body, hull, ground, mu, a, torque, y1, contacts, space, stages[STAGES])
    else:
        end = -inf
    return worst, end, least


@jit
def lowest_free(hull, ground, y, contacts):
    """Gap of the lowest open point that comes down; inf if there is none."""
    x, quat, v, w = load(y)
    view = seen(ground, matrix(quat), x)
    least = inf
    for k in range(hull.shape[0]):
        if contacts[k, 0] == FREE and speed_of(hull, k, ground[4], view, v, w) < 0.0:
            least = min(least, gap_of(hull, k, ground[4], view))
    return least


@stage
def certain(hull, ground, y, y1, h, contacts, stages):
    """Can no open point have been below the surface between y and y1, h seconds later?

    From the gap z and its rate at both ends, with a bound B on −z'': z >= z0 + z0' t − B t²/2, and so
    from the other end. Dips of less than SUNK may pass.
    """
    field = ground[4]
    pull, turn = 0.0, 0.0
    for i in range(STAGES + 1):
        pull = max(pull, sqrt(stages[i, 7] ** 2 + stages[i, 8] ** 2 + stages[i, 9] ** 2))
        turn = max(turn, sqrt(stages[i, 10] ** 2 + stages[i, 11] ** 2 + stages[i, 12] ** 2))
    x, quat, v, w = load(y)
    x1, quat1, v1, w1 = load(y1)
    spin = sqrt(max(dot(w, w), dot(w1, w1))) + 0.5 * h * turn
    fast = sqrt(max(dot(v, v), dot(v1, v1))) + 0.5 * h * pull
    view, view1 = seen(ground, matrix(quat), x), seen(ground, matrix(quat1), x1)
    for k in range(hull.shape[0]):
        if contacts[k, 0] != FREE:
            continue
        b = vec2(hull, k, 0)
        size = sqrt(dot(b, b))
        B = SLACK * (pull + (turn + spin * spin) * size + hollow(field, fast + spin * size))
        if 0.125 * B * h * h <= SUNK:
            continue
        z = max(0.0, within(field, gap_of(hull, k, field, view), hull[k, 3]))
        z1 = max(0.0, within(field, gap_of(hull, k, field, view1), hull[k, 3]))
        s = speed_of(hull, k, field, view, v, w)
        s1 = speed_of(hull, k, field, view1, v1, w1)
        # until when it is safe from the left, and from when on from the right
        left = (s + sqrt(s * s + 2.0 * B * z)) / B
        right = (-s1 + sqrt(s1 * s1 + 2.0 * B * z1)) / B
        if left + right < h:
            return False
    return True


@jit
def slip_ends(contacts, rows, n, mu, noise):
    """(does a slip end here?, how long until one does at its rate, s); a rate below `noise` is none."""
    soonest, ended = inf, False
    if mu > 0.0:
        for c in range(n):
            if contacts[int(rows[c, POINT]), 0] == SLIDES and rows[c, RATE] < -noise:
                s1, s2 = direction(rows, c, contacts)
                speed = rows[c, SLIP] * s1 + rows[c, SLIP + 1] * s2
                if speed <= STILL:
                    ended = True
                soonest = min(soonest, -max(0.0, speed) / rows[c, RATE])
    return ended, soonest


@jit
def reverses(contacts, rows, n, slips):
    """Has a contact's slip turned back on what it was?"""
    for c in range(n):
        k = int(rows[c, POINT])
        if contacts[k, 0] == SLIDES:
            s1, s2 = direction(rows, c, contacts)
            if s1 * slips[k, 0] + s2 * slips[k, 1] < 0.0:
                return True
    return False


@stage
def segment(body, hull, ground, mu, a, torque, y, contacts, span, h, tol, space, stages, y1):
    """From y, in place, for `span` seconds or until something happens.

    Args:
        body: (m, 1/m, J, 1/J, bound).
        hull: (p, 4).
        ground: (N, t1, t2, d, field).
        mu: friction coefficient.
        a: g + F_ext/m, m/s².
        torque: N m, body axes.
        y: (13 + p,) motion and impulses.
        contacts: (p, MEMORY): which points are closed, and how.
        span: s.
        h: the first step to try, s.
        tol: the error allowed in each step, of the motion's own scales.
        space: of `workspace`.
        stages: (13, 13 + p) scratch.
        y1: (13 + p,) scratch.

    Returns:
        (why, how long it went on, a good next step): DONE, EVENT, JAM where no step is short enough,
        BROKEN if something is not a number.
    """
    t = 0.0
    floor = SHORTEST * (1.0 + span)
    slips = np.zeros((hull.shape[0], 2))
    while t < span:
        _size, _fast, spin, weight = scales(body, a, torque, y)
        m, n = rates(body, hull, ground, mu, a, torque, y, contacts, space, stages[0])
        rows = space[0]
        if not m > -inf:
            return JAM, t, h
        for c in range(n):
            k = int(rows[c, POINT])
            if contacts[k, 0] == SLIDES:
                slips[k, 0], slips[k, 1] = direction(rows, c, contacts)
        ended, soonest = slip_ends(contacts, rows, n, mu, PULLS * weight / body[0])
        if ended:
            return EVENT, t, h
        last = span - t
        step = min(h, last, NEARLY * soonest, TURN / spin)
        cut = step if step < h else -1.0  # not because of errors
        while True:
            if step < floor and step < last:
                return (JAM if n > 0 else BROKEN), t, h
            for k in range(hull.shape[0]):
                if contacts[k, 0] == SLIDES:
                    contacts[k, 1], contacts[k, 2] = slips[k, 0], slips[k, 1]
            error, end, least = attempt(
                body, hull, ground, mu, a, torque, y, step, contacts, space, stages, y1
            )
            if not error <= tol:
                step *= max(0.2, 0.9 * (tol / error) ** 0.125) if error < inf else 0.2
                continue
            grow = min(5.0, 0.9 * (tol / max(error, 1e-30)) ** 0.125)
            if reverses(contacts, rows, n, slips):
                step *= 0.5
                continue
            event = end < -PULLS * weight or lowest_free(hull, ground, y1, contacts) < -SUNK
            if event:
                break
            if least < -PULLS * weight and step > 1e3 * floor:
                step *= 0.5
                continue
            if not certain(hull, ground, y, y1, step, contacts, stages):
                step *= 0.5
                continue
            break
        if event:
            # where the first sign of it is: by halving, as several signs may change
            low, high = 0.0, step
            for _ in range(MAX_ROOT):
                step = 0.5 * (low + high)
                if high - low <= 1e-16 * (1.0 + high) or step <= low or step >= high:
                    break
                _error, end, _least = attempt(
                    body, hull, ground, mu, a, torque, y, step, contacts, space, stages, y1
                )
                if end < -PULLS * weight or lowest_free(hull, ground, y1, contacts) < 0.0:
                    high = step
                else:
                    low = step
            attempt(body, hull, ground, mu, a, torque, y, high, contacts, space, stages, y1)
            step = high
        for s in range(y.size):
            y[s] = y1[s]
        t += step
        if event:
            return EVENT, t, h
        h = max(h, step * grow) if step == cut else step * min(grow, WIDEN)
    return DONE, t, h
