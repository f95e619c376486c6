"""Motion between events under forces without a closed form: sustained contact, or flight with torque.

DOP853 with error control. A step ends early where something happens: a force would have to pull,
friction no longer holds, slip stops, or an open point comes down. None of that is looked for at the end of
a step only: a step is halved until the points' accelerations rule out that an open point has been below
the surface in between, and until no stage shows what the end does not.
"""

from math import inf, sqrt

from ..algebra import dot, jit, matrix, stage, to_body, vec2
from ..model import closing_speed, gap, height_over, load
from ..sweep import POINT, SLIP
from .constraint import FREE, RATE, SLIDES, STILL, direction, keep, rates
from .dop853 import ERROR_3, ERROR_5, STAGES, STEP, TABLE

SIZE = 13
"""Of the motion in y = (x, quat, v, w, p): v in world, w in body axes. After it come the hull points'
normal impulses so far, N s, which are integrated along, but decide nothing."""

DONE, EVENT, JAM, BROKEN = 0, 1, 2, 3

SUNK = 1e-13
"""m: an open point this deep has come down."""

PULLS = 1e-12
"""Of the body's weight, or what else it is pressed by: a force of minus that would have to pull."""

SHORTEST = 1e-14
"""s, and of the segment: shorter steps get nowhere."""

NEARLY = 0.98
"""Of the time until slip stops at its present rate: how far a step goes. The next begins so much nearer."""

WIDEN = 4.0
"""By how much the next step is longer at most, where one was halved."""

MAX_ROOT = 100
SLACK = 1.25
"""On accelerations seen at the stages, as a bound for all of the step."""


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
def attempt(body, hull, plane, mu, a, torque, y, h, contacts, space, stages, y1):
    """One step of h seconds from y to y1, then what is kept is put back.

    stages[0] holds dy/dt at y; the rest is filled, stages[STAGES] with dy/dt at y1.

    Returns:
        (error of the worst component, the margin at the end, the least one seen at a stage).
    """
    seen = inf
    for i in range(1, STAGES + 1):
        for s in range(y.size):
            total = 0.0
            for j in range(i):
                total += TABLE[i, j] * stages[j, s]
            y1[s] = y[s] + h * total
        if i < STAGES:
            m, _n = rates(body, hull, plane, mu, a, torque, y1, contacts, space, stages[i])
            seen = min(seen, m)
    length, fast, spin, _weight = scales(body, a, torque, y)
    worst = 0.0
    for s in range(SIZE):
        five, three = 0.0, 0.0
        for j in range(STAGES):
            five += TABLE[ERROR_5, j] * stages[j, s]
            three += TABLE[ERROR_3, j] * stages[j, s]
        five, three = abs(h * five), abs(h * three)
        both = sqrt(five * five + 0.01 * three * three)
        error = five * five / both if both > 0.0 else 0.0
        scale = length if s < 3 else (1.0 if s < 7 else (fast if s < 10 else spin))
        worst = max(worst, error / scale) if scale > 0.0 else worst
        if not 0.0 * error == 0.0:
            worst = inf
    if worst < inf:
        keep(body, hull, plane, mu, y1, contacts, space)
        end, _n = rates(body, hull, plane, mu, a, torque, y1, contacts, space, stages[STAGES])
    else:
        end = -inf
    return worst, end, seen


@jit
def lowest_free(hull, plane, y, contacts):
    """Gap of the lowest open point that comes down; inf if there is none."""
    x, quat, v, w = load(y)
    R = matrix(quat)
    N_b, height = to_body(R, plane[0]), height_over(plane, x)
    least = inf
    for k in range(hull.shape[0]):
        if contacts[k, 0] == FREE and closing_speed(hull, k, plane, R, v, w) < 0.0:
            least = min(least, gap(hull, k, N_b, height))
    return least


@stage
def certain(hull, plane, y, y1, h, contacts, stages):
    """Can no open point have been below the surface between y and y1, h seconds later?

    From the gap z and its rate at both ends, with a bound B on z'': z >= z0 + z0' t − B t²/2, and so
    from the other end. Dips of less than SUNK may pass.
    """
    N = plane[0]
    pull, turn, spin2 = 0.0, 0.0, 0.0
    for i in range(STAGES + 1):
        pull = max(pull, -dot(N, (stages[i, 7], stages[i, 8], stages[i, 9])))
        turn = max(turn, sqrt(stages[i, 10] ** 2 + stages[i, 11] ** 2 + stages[i, 12] ** 2))
    _x, _quat, _v, w = load(y)
    _x, _quat, _v, w1 = load(y1)
    spin2 = max(dot(w, w), dot(w1, w1))
    x, quat, v, w = load(y)
    x1, quat1, v1, w1 = load(y1)
    R, R1 = matrix(quat), matrix(quat1)
    N_b, N_b1 = to_body(R, N), to_body(R1, N)
    for k in range(hull.shape[0]):
        if contacts[k, 0] != FREE:
            continue
        b = vec2(hull, k, 0)
        B = SLACK * (pull + (turn + spin2 + h * turn * sqrt(spin2)) * sqrt(dot(b, b)))
        if 0.125 * B * h * h <= SUNK:
            continue
        z = max(0.0, gap(hull, k, N_b, height_over(plane, x)))
        z1 = max(0.0, gap(hull, k, N_b1, height_over(plane, x1)))
        s = closing_speed(hull, k, plane, R, v, w)
        s1 = closing_speed(hull, k, plane, R1, v1, w1)
        # until when it is safe from the left, and from when on from the right
        left = (s + sqrt(s * s + 2.0 * B * z)) / B
        right = (-s1 + sqrt(s1 * s1 + 2.0 * B * z1)) / B
        if left + right < h:
            return False
    return True


@jit
def slip_ends(contacts, rows, n, mu):
    """(does a slip end here?, how long until one does at its present rate, s)."""
    soonest, ended = inf, False
    if mu > 0.0:
        for c in range(n):
            if contacts[int(rows[c, POINT]), 0] == SLIDES and rows[c, RATE] < 0.0:
                speed = sqrt(rows[c, SLIP] ** 2 + rows[c, SLIP + 1] ** 2)
                if speed <= STILL:
                    ended = True
                soonest = min(soonest, -speed / rows[c, RATE])
    return ended, soonest


@jit
def reverses(contacts, rows, n):
    """Has a contact's slip turned back on what it was?"""
    for c in range(n):
        k = int(rows[c, POINT])
        if contacts[k, 0] == SLIDES:
            s1, s2 = direction(rows, c, contacts)
            if s1 * contacts[k, 1] + s2 * contacts[k, 2] < 0.0:
                return True
    return False


@jit
def note_slip(contacts, rows, n):
    """Remember every sliding contact's direction of slip."""
    for c in range(n):
        k = int(rows[c, POINT])
        if contacts[k, 0] == SLIDES:
            contacts[k, 1], contacts[k, 2] = direction(rows, c, contacts)


@stage
def segment(body, hull, plane, mu, a, torque, y, contacts, span, h, tol, space, stages, y1):
    """From y, in place, for `span` seconds or until something happens.

    Args:
        body, hull, plane, a, torque: as in `impulse.step`.
        mu: friction coefficient.
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
    while t < span:
        weight = scales(body, a, torque, y)[3]
        m, n = rates(body, hull, plane, mu, a, torque, y, contacts, space, stages[0])
        rows = space[0]
        if not m > -inf:
            return JAM, t, h
        note_slip(contacts, rows, n)
        ended, soonest = slip_ends(contacts, rows, n, mu)
        if ended:
            return EVENT, t, h
        last = span - t
        step = min(h, last, NEARLY * soonest)
        cut = step if step < h else -1.0  # not because of errors
        while True:
            if step < floor and step < last:
                return JAM, t, h
            error, end, seen = attempt(
                body, hull, plane, mu, a, torque, y, step, contacts, space, stages, y1
            )
            if not error <= tol:
                if error != error:
                    return BROKEN, t, h
                step *= max(0.2, 0.9 * (tol / error) ** 0.125) if error < inf else 0.2
                continue
            grow = min(5.0, 0.9 * (tol / max(error, 1e-30)) ** 0.125)
            if reverses(contacts, rows, n):
                step *= 0.5
                continue
            event = end < -PULLS * weight or lowest_free(hull, plane, y1, contacts) < -SUNK
            if event:
                break
            if seen < -PULLS * weight and step > 1e3 * floor:
                step *= 0.5
                continue
            if not certain(hull, plane, y, y1, step, contacts, stages):
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
                _error, end, seen = attempt(
                    body, hull, plane, mu, a, torque, y, step, contacts, space, stages, y1
                )
                if end < -PULLS * weight or lowest_free(hull, plane, y1, contacts) < -SUNK:
                    high = step
                else:
                    low = step
            attempt(body, hull, plane, mu, a, torque, y, high, contacts, space, stages, y1)
            step = high
        for s in range(y.size):
            y[s] = y1[s]
        t += step
        if event:
            note_slip(contacts, rows, n)
            return EVENT, t, h
        h = max(h, step * grow) if step == cut else step * min(grow, WIDEN)
    return DONE, t, h
