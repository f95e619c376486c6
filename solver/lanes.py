"""Several bodies at once, one in each lane of the processor's vector registers, over a plane.

In most steps nothing happens but flight and sustained contact. `steady` takes such a step for all lanes
together. It is made of the very functions that `impulse.step` is made of, and has its bits; a step in which
a contact comes or goes it leaves to `impulse.step`, lane by lane.

The lanes of a group are in arrays whose last index is the lane:

    pad       (PAD, lanes) motion, body, torque, and what else is one number a body; see below
    hull      (p, 4, lanes) points in principal axes and their radii, m
    contacts  (p, 2, lanes) is the hull point OPEN? has it pushed?
    rows      (p, WIDTH, lanes) a row for each closed contact, as in `sweep`; of the first N of them
"""

import numpy as np

from . import impulse
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
    vec,
    vec2,
)
from .impulse import (
    MAX_STEP_TURN,
    dip,
    drift,
    fly,
    in_world,
    reach,
    sagitta,
    turned,
)
from .kick import again, hold
from .model import CLOSED, MEMORY, OPEN, TOUCH, gap, is_finite, seen
from .project import SHARED_TOLERANCE, clearance, shove_on_plane
from .sweep import FORCE, GAP, HELD, POINT, PUSH, RHO, WIDTH, B, P
from .trace import LANES, every, filled, largest, no, some, traced, where

# Columns of the pad.
MOTION = 0  # x, quat, v in world and w in principal axes: 13 numbers
TORQUE = 13  # N m, principal axes
MASS = 16  # kg
INERTIA = 17  # kg m²
FRICTION = 20
RESTITUTION = 21
BOUND = 22  # radius of the bounding sphere, m
N = 23  # how many contacts are closed
CLEAR = 24  # as in `impulse.step`
WORK = 25  # the integral of |torque · w|, J
OK = 26  # 1: the lane has made its step
STEADY = 27  # 1: it has made some since its rows were last renewed
FAILED = 28  # 1: its state was no longer finite; the last good one is kept
BLOW_FRICTION = 29  # the friction coefficient of blows
PAD = 30


@traced
def _flies(ground, bound, a, x, v, h):
    """Too high for any contact, at the start and at the end?"""
    N = ground[0]
    height = dot(N, x) - ground[3]
    fall = h * (dot(N, v) + 0.5 * h * dot(N, a))
    return (height > bound) & (height + fall > bound)


@traced
def _arrived(hull, k, contacts, N_b, height, arrives):
    """Does point k, which is OPEN, touch?"""
    return arrives | ((contacts[k, 0] == OPEN) & (gap(hull, k, N_b, height) <= TOUCH))


@traced
def _pushes(rows, c, n, ok):
    """Row c's contact stays closed only if it pushes."""
    return ok & (no(c < n) | (rows[c, P] > 0.0))


@traced
def _remembered(rows, c, n, ok, h, changed):
    """Row c's force, from which the next step starts: only where it is another."""
    p, F = vec2(rows, c, P), vec2(rows, c, FORCE)
    # what `guess` made of it: there and back might be off by a bit
    same = (p[0] == h * F[0]) & (p[1] == h * F[1]) & (p[2] == h * F[2])
    renew = ok & (c < n) & no(same)
    put2(rows, c, FORCE, where(renew, scale(1.0 / h, p), F))
    return changed | renew


@traced
def _tallied(rows, c, n, ok, ground):
    """Row c's impulse, added to all its impulses."""
    push = vec2(rows, c, PUSH)
    put2(rows, c, PUSH, where(ok & (c < n), add(in_world(ground, vec2(rows, c, P)), push), push))


@traced
def _moved_on(x, quat, v, w, x1, quat1, v1, w1):
    """Has the motion changed?"""
    changed = filled(x[0], False)
    for old, new in zip((*x, *quat, *v, *w), (*x1, *quat1, *v1, *w1), strict=True):
        changed = changed | (old != new)
    return changed


@jit
def arrives(hull, ground, contacts, view, clear):
    """Where a point that is OPEN touches the ground."""
    N_b, height = view[2][0], view[3]
    arrives = filled(height, False)
    for k in range(hull.shape[0]):
        arrives = _arrived(hull, k, contacts, N_b, height, arrives)
    return arrives & no(clear > TOUCH)


@jit
def steady(body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, n, h, clear):
    """One step of h seconds, of each lane in which no contact comes or goes.

    Args:
        body: (m, 1/m, J, 1/J, radius of the bounding sphere).
        hull: (p, 4, lanes) points in principal axes and their radii, m.
        ground: (N, t1, t2, d, None), as in `model`.
        law: as in `impulse.step`.
        a: g + F_ext/m, m/s², world axes.
        torque: N m, body axes.
        x: (3,) m.
        quat: (4,).
        v: (3,) m/s.
        w: (3,) rad/s, body axes.
        contacts: (p, 1, lanes), whether each hull point is OPEN.
        rows: (p, WIDTH, lanes), of which the first n have their B, RHO, HELD = 1, GAP = 0 and FORCE.
        n: how many contacts are closed.
        h: s.
        clear: as in `impulse.step`.

    Returns:
        (ok, changed, x, quat, v, w, clear): has the lane made the step? If not, the rest means nothing. And
        will further steps change anything?
    """
    bound = body[4]
    slow = turned(None, v, w, h) < MAX_STEP_TURN
    high = _flies(ground, bound, a, x, v, h)
    bare = n == 0
    x_f, quat_f, v_f, w_f = x, quat, v, w
    if some(high):
        x_f, quat_f, v_f, w_f = fly(body, law[2], a, torque, x, quat, v, w, h)
        if every(high & bare):
            return slow & is_finite(x_f, quat_f, v_f, w_f), high, x_f, quat_f, v_f, w_f, filled(clear, 0.0)
    ok = no(high)
    if some(ok & no(clear > TOUCH)):
        ok = ok & no(arrives(hull, ground, contacts, seen(ground, matrix(quat), x), clear))

    x1, quat1, w1 = drift(body, law[2], x, quat, v, w, 0.5 * h)
    view = seen(ground, matrix(quat1), x1)
    for c in range(int(largest(n))):
        again(rows, c, view)
    v1, w1 = hold(
        body, None, view, law[0], law[2], law[3], law[4],
        a, v, w1, axpy(h, a, v), axpy(h, times(body[3], torque), w1), rows, n, h,
    )  # fmt: skip
    x1, quat1, w1 = drift(body, law[2], x1, quat1, v1, w1, 0.5 * h)

    clear = clear - (reach(bound, v, w, 0.5 * h) + reach(bound, v1, w1, 0.5 * h))
    low = no(clear > TOUCH)
    if some(low):
        clear = where(low, clearance(hull, ground, quat1, x1, contacts, TOUCH), clear)
        ok = ok & no(low & (clear < -TOUCH))
        sag = sagitta(None, bound, a, v, w, v1, w1, h)
        close = ok & low & (clear < sag)
        if some(close):
            when = dip(hull, ground, x, quat, v, w, x1, quat1, v1, w1, contacts, h, sag)
            ok = ok & no(close & (when > 0.0))
    for c in range(int(largest(n))):
        ok = _pushes(rows, c, n, ok)

    x1, quat1, w1, moved = shove_on_plane(body, ground, x1, quat1, w1, rows, n)
    clear = clear - moved
    low = no(moved == 0.0) & no(clear > TOUCH)
    if some(low):
        clear = where(low, clearance(hull, ground, quat1, x1, contacts, TOUCH), clear)
        ok = ok & no(low & (clear < -SHARED_TOLERANCE))

    ok = where(high, bare, ok)
    x1, quat1, v1, w1 = where(high, (x_f, quat_f, v_f, w_f), (x1, quat1, v1, w1))
    ok = slow & ok & is_finite(x1, quat1, v1, w1)
    changed = _moved_on(x, quat, v, w, x1, quat1, v1, w1)
    for c in range(int(largest(n))):
        changed = _remembered(rows, c, n, ok, h, changed)
    return ok, changed, x1, quat1, v1, w1, where(high, 0.0, clear)


@traced
def load_motion(pad):
    """(x, quat, v, w) of every lane."""
    return (
        (pad[0], pad[1], pad[2]),
        (pad[3], pad[4], pad[5], pad[6]),
        (pad[7], pad[8], pad[9]),
        (pad[10], pad[11], pad[12]),
    )


@traced
def store_motion(pad, x, quat, v, w):
    """The inverse of `load_motion`."""
    for column, number in enumerate((*x, *quat, *v, *w)):
        pad[column] = number


@traced
def load_body(pad):
    """(body, μ, torque) of every lane."""
    m = pad[MASS]
    J = (pad[INERTIA], pad[INERTIA + 1], pad[INERTIA + 2])
    inv_J = (1.0 / J[0], 1.0 / J[1], 1.0 / J[2])
    torque = (pad[TORQUE], pad[TORQUE + 1], pad[TORQUE + 2])
    return (m, 1.0 / m, J, inv_J, pad[BOUND]), pad[FRICTION], torque


@traced
def column(pad, at):
    """One number of every lane."""
    return pad[at]


@traced
def set_column(pad, at, number):
    """Set one number of every lane."""
    pad[at] = number


@traced
def set_truth(pad, at, truth):
    """1 where it holds."""
    pad[at] = where(truth, 1.0, 0.0)


@traced
def power(torque, w):
    """|τ · w|, W."""
    return abs(dot(torque, w))


@jit
def release(contacts):
    """No lane is in contact, nor has been."""
    for k in range(contacts.shape[0]):
        set_row(contacts, k, 0, OPEN)
        set_row(contacts, k, 1, 0.0)


@traced
def set_row(array, k, at, number):
    """Set one entry for every lane."""
    array[k, at] = number


@jit
def attach(contacts, rows, pad, hull, pushes, lane, k, F):
    """Close point k's contact in a lane; points come in ascending order. F is its force in the last step."""
    c = int(pad[N, lane])
    pad[N, lane] = c + 1
    contacts[k, 0, lane] = CLOSED
    rows[c, POINT, lane] = k
    rows[c, HELD, lane] = 1.0
    rows[c, GAP, lane] = 0.0
    rows[c, RHO, lane] = hull[k, 3, lane]
    for j in range(3):
        rows[c, B + j, lane] = hull[k, j, lane]
        if pushes is not None:
            rows[c, PUSH + j, lane] = pushes[k, j, lane]
    rows[c, FORCE, lane], rows[c, FORCE + 1, lane], rows[c, FORCE + 2, lane] = F


@jit
def attached(rows, pushes, c, lane):
    """(k, F) of a lane's contact c; its impulses so far go to `pushes`, where that is wanted."""
    k = int(rows[c, POINT, lane])
    if pushes is not None:
        for j in range(3):
            pushes[k, j, lane] = rows[c, PUSH + j, lane]
    return k, (rows[c, FORCE, lane], rows[c, FORCE + 1, lane], rows[c, FORCE + 2, lane])


@traced
def touched(contacts, k, counts):
    """Point k added to the counts of points that have touched."""
    return counts + contacts[k, 1]


@stage
def alone(pad, hull, contacts, rows, pushes, lane, ground, a, h, memory, scratch, push, points):
    """One step of one lane, by `impulse.split_step`."""
    apart()
    memory[:] = 0.0
    for c in range(int(pad[N, lane])):
        k, F = attached(rows, pushes, c, lane)
        memory[k, 0] = CLOSED
        put2(memory, k, 1, F)
        if pad[STEADY, lane] != 0.0:
            contacts[k, 1, lane] = 1.0
        contacts[k, 0, lane] = OPEN
    push[:] = 0.0
    for k in range(hull.shape[0]):
        for j in range(4):
            points[k, j] = hull[k, j, lane]
        if pushes is not None:
            for j in range(3):
                push[k, j] = pushes[k, j, lane]
    m = pad[MASS, lane]
    J = (pad[INERTIA, lane], pad[INERTIA + 1, lane], pad[INERTIA + 2, lane])
    body = (m, 1.0 / m, J, (1.0 / J[0], 1.0 / J[1], 1.0 / J[2]), pad[BOUND, lane])
    law = (pad[FRICTION, lane], pad[RESTITUTION, lane], True, True, True, pad[BLOW_FRICTION, lane])
    torque = (pad[TORQUE, lane], pad[TORQUE + 1, lane], pad[TORQUE + 2, lane])
    w0 = (pad[10, lane], pad[11, lane], pad[12, lane])
    x, v, w = (pad[0, lane], pad[1, lane], pad[2, lane]), (pad[7, lane], pad[8, lane], pad[9, lane]), w0
    quat = (pad[3, lane], pad[4, lane], pad[5, lane], pad[6, lane])
    clear = pad[CLEAR, lane]
    x, quat, v, w, clear, _still, _k = impulse.split_step(
        body, points, ground, law, a, torque, x, quat, v, w, memory, scratch, push, h, clear, 0
    )
    if not is_finite(x, quat, v, w):
        pad[FAILED, lane] = 1.0
        return
    pad[0, lane], pad[1, lane], pad[2, lane] = x
    pad[3, lane], pad[4, lane], pad[5, lane], pad[6, lane] = quat
    pad[7, lane], pad[8, lane], pad[9, lane] = v
    pad[10, lane], pad[11, lane], pad[12, lane] = w
    pad[CLEAR, lane] = clear
    pad[WORK, lane] += 0.5 * h * (power(torque, w0) + power(torque, w))
    pad[N, lane] = pad[STEADY, lane] = 0.0
    for k in range(hull.shape[0]):
        if pushes is not None:
            for j in range(3):
                pushes[k, j, lane] = push[k, j]
        if push[k, 0] != 0.0 or push[k, 1] != 0.0 or push[k, 2] != 0.0:
            contacts[k, 1, lane] = 1.0
        if memory[k, 0] != OPEN:
            attach(contacts, rows, pad, hull, pushes, lane, k, vec2(memory, k, 1))


@jit
def drive(pad, hull, contacts, rows, pushes, used, ground, a, h, steps, memory, scratch, push, points):
    """So many steps of h seconds of a group of bodies, in place; f32 and fields are not for it.

    A lane whose state would not be finite is FAILED, and stays as it was.

    Args:
        pad: with MOTION, TORQUE, the body, N and WORK.
        hull: see above, as are
        contacts: these, and
        rows: these, both from `attach`.
        pushes: (p, 3, lanes) all impulses on each hull point, world axes, N s; None: not wanted.
        used: how many lanes there are bodies in; the others must hold one of those again.
        ground: (N, t1, t2, d, None), as in `model`.
        a: m/s², of all of them.
        h: s.
        steps: how many.
        memory: (p, MEMORY) scratch.
        scratch: (p, WIDTH) scratch.
        push: (p, 4) scratch.
        points: (p, 4) scratch.
    """
    set_column(pad, CLEAR, 0.0)
    set_column(pad, FAILED, 0.0)
    body, mu, torque = load_body(pad)
    x, quat, v, w = load_motion(pad)
    n, clear, work = column(pad, N), column(pad, CLEAR), column(pad, WORK)
    law = (mu, None, True, True, True, None)
    alive = filled(mu, True)
    made = filled(mu, False)
    for done in range(steps):
        ok, changed, x1, quat1, v1, w1, clear1 = steady(
            body, hull, ground, law, a, torque, x, quat, v, w, contacts, rows, n, h, clear
        )
        ok = ok & alive
        work = where(ok, work + 0.5 * h * (power(torque, w) + power(torque, w1)), work)
        x, quat, v, w, clear = where(ok, (x1, quat1, v1, w1, clear1), (x, quat, v, w, clear))
        made = made | ok
        if pushes is not None:
            for c in range(int(largest(n))):
                _tallied(rows, c, n, ok, ground)
        if not every(ok):
            store_motion(pad, x, quat, v, w)
            set_column(pad, CLEAR, clear)
            set_column(pad, WORK, work)
            set_truth(pad, OK, ok)
            set_truth(pad, STEADY, made)
            for lane in range(used):
                if pad[OK, lane] == 0.0 and pad[FAILED, lane] == 0.0:
                    alone(
                        pad, hull, contacts, rows, pushes, lane, ground, a, h, memory, scratch, push, points
                    )
            x, quat, v, w = load_motion(pad)
            n, clear, work = column(pad, N), column(pad, CLEAR), column(pad, WORK)
            alive = column(pad, FAILED) == 0.0
            made = column(pad, STEADY) > 0.0
        elif not some(changed):  # nor will it
            for _ in range(done + 1, steps):
                work = where(alive, work + h * power(torque, w), work)
                if pushes is not None:
                    for c in range(int(largest(n))):
                        _tallied(rows, c, n, alive, ground)
            break
    store_motion(pad, x, quat, v, w)
    set_column(pad, WORK, work)
    set_truth(pad, STEADY, made)
    for lane in range(used):
        if pad[STEADY, lane] != 0.0:
            for c in range(int(pad[N, lane])):
                contacts[int(rows[c, POINT, lane]), 1, lane] = 1.0


@entry
def run_many(body, hull, ground, law, a, torque, states, memories, f, h, n):
    """n steps of h seconds of each of many bodies, in place: `impulse.run` for all of them.

    Args:
        body: (5,) m, principal moments, radius of the bounding sphere.
        hull: (p, 4).
        ground: (10,) N, t1, t2, d.
        law: (3,) μ, e, μ of blows; no term is left out, which changes no bit.
        a: (3,) m/s².
        torque: (3,) N m, principal axes.
        states: (m, 13) x, quat, v (world axes), w (principal axes).
        memories: (m, p, MEMORY) the contacts' memories.
        f: (m, p) filled with the mean normal force of each hull point, N.
        h: s.
        n: steps.

    Returns:
        The first body whose state was no longer finite, or -1; its state is as before the step that failed.
    """
    points = hull.shape[0]
    pads, hulls = np.zeros((PAD, LANES)), np.empty((points, 4, LANES))
    touches, contact_rows = np.empty((points, 2, LANES)), np.zeros((points, WIDTH, LANES))
    totals, memory = np.empty((points, 3, LANES)), np.empty((points, MEMORY))
    scratches, tally, spots = np.empty((points, WIDTH)), np.empty((points, 4)), np.empty((points, 4))
    pad, nodes, contacts, rows = borrowed(pads), borrowed(hulls), borrowed(touches), borrowed(contact_rows)
    pushes = borrowed(totals)
    plane = (vec(ground, 0), vec(ground, 3), vec(ground, 6), ground[9], None)
    a_ = vec(a, 0)
    for k in range(points):
        for j in range(4):
            for lane in range(LANES):
                nodes[k, j, lane] = hull[k, j]
    failed = -1
    for first in range(0, states.shape[0], LANES):
        used = min(LANES, states.shape[0] - first)
        release(contacts)
        totals[:] = 0.0
        for lane in range(LANES):
            i = first + min(lane, used - 1)
            for j in range(TORQUE):
                pad[j, lane] = states[i, j]
            for j in range(3):
                pad[TORQUE + j, lane] = torque[j]
                pad[INERTIA + j, lane] = body[1 + j]
            pad[MASS, lane], pad[BOUND, lane] = body[0], body[4]
            pad[FRICTION, lane], pad[RESTITUTION, lane], pad[BLOW_FRICTION, lane] = law[0], law[1], law[2]
            pad[N, lane] = pad[WORK, lane] = 0.0
            for k in range(points):
                if memories[i, k, 0] != OPEN:
                    F = (memories[i, k, 1], memories[i, k, 2], memories[i, k, 3])
                    attach(contacts, rows, pad, nodes, pushes, lane, k, F)
        drive(
            pad, nodes, contacts, rows, pushes, used, plane, a_, h, n,
            borrowed(memory), borrowed(scratches), borrowed(tally), borrowed(spots),
        )  # fmt: skip
        for lane in range(used):
            i = first + lane
            for j in range(TORQUE):
                states[i, j] = pad[j, lane]
            for k in range(points):
                for j in range(MEMORY):
                    memories[i, k, j] = 0.0
            for c in range(int(pad[N, lane])):
                k, F = attached(rows, pushes, c, lane)
                memories[i, k, 0] = CLOSED
                memories[i, k, 1], memories[i, k, 2], memories[i, k, 3] = F
            for k in range(points):
                push = (pushes[k, 0, lane], pushes[k, 1, lane], pushes[k, 2, lane])
                f[i, k] = dot(plane[0], push) / (n * h) if n > 0 else 0.0
            if pad[FAILED, lane] != 0.0 and failed < 0:
                failed = i
    keep_alive(pads, hulls, touches, contact_rows, totals, memory, scratches, tally, spots)
    return failed
