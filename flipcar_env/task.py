"""The task, compiled: actuate, step, observe, reward. Rows in, rows out; no Python objects."""

from math import sqrt

import numpy as np

from solver import impulse, lanes
from solver.algebra import apart, borrowed, dot, entry, jit, keep_alive, put, stage, vec
from solver.field import foot, lent
from solver.model import MEMORY, height_over, is_finite, load, store
from solver.sweep import WIDTH as CONTACT_ROW
from solver.sweep import kinetic_energy
from solver.trace import LANES, traced

from . import observe, reward
from . import row as r

PUSH = 4
"""Columns of the hull points' impulses: world axes, and over a height field their normal parts."""


@traced
def cos_tilt(quat):
    """Vertical component of the car's up axis."""
    return 1.0 - 2.0 * (quat[1] * quat[1] + quat[2] * quat[2])


@jit
def energy(model, row, x, v, w):
    """Mechanical energy, zero at rest at the height of the world's origin, J."""
    m = row[r.MASS]
    return kinetic_energy(m, vec(row, r.INERTIA), v, w) + m * model[r.GRAVITY] * x[2]


@jit
def ground_of(model, field):
    """The ground as the solver has it."""
    normal, t1, t2 = vec(model, r.PLANE), vec(model, r.PLANE + 3), vec(model, r.PLANE + 6)
    return normal, t1, t2, model[r.PLANE + 9], lent(field)


@jit
def height(ground, field, x):
    """Distance of the centre of mass to the ground, m."""
    if field is None:
        return height_over(ground, x)
    return foot(field, x)[0]


@jit
def observe_row(model, ground, row, x, quat, v, w):
    """Fill the results that any state has, and the observation."""
    row[r.STATE + r.ENERGY] = energy(model, row, x, v, w)
    row[r.STATE + r.TILT] = reward.tilt(cos_tilt(quat))
    obs = borrowed(row[r.OBSERVED :].view(np.float32))
    if model[r.VIEW] == observe.STATE:
        observe.state(x, quat, v, w, obs)
    else:
        up = height(ground, ground[4], x)
        if model[r.VIEW] != observe.PRIVILEGED:
            observe.egocentric(up, quat, v, w, obs)
            if model[r.VIEW] == observe.REMEMBERING:
                observe.newest(row, obs)
        else:
            left = 1.0 - row[r.STEPS] / model[r.MAX_STEPS]
            observe.privileged(row, up, left, x, quat, v, w, obs)
    if model[r.NOISE] > 0.0:
        observe.disturb(model[r.VIEW], row, obs, model[r.NOISE])


@jit
def clipped(action):
    """An action within [-1, 1]."""
    return (
        min(1.0, max(-1.0, float(action[0]))),
        min(1.0, max(-1.0, float(action[1]))),
        min(1.0, max(-1.0, float(action[2]))),
    )


@jit
def due(model, row, act):
    """The action that is carried out when `act` is given: one given some steps ago, if there is a delay."""
    delay = int(model[r.DELAY])
    return act if delay == 0 else vec(row, r.FORCES - 3 * delay)


@jit
def remember(row, act):
    """Keep an action, in place of the oldest."""
    for j in range(r.GIVEN, r.NEWEST):
        row[j] = row[j + 3]
    put(row, r.NEWEST, act)


@jit
def actuate(model, row, act):
    """The torque about the car's axes when an action is given, N m."""
    act = due(model, row, act)
    return (act[0] * row[r.LIMIT], act[1] * row[r.LIMIT + 1], act[2] * row[r.LIMIT + 2])


@jit
def place_hull(model, row, hull):
    """Fill the hull's points (p, 4) of this row's car, in axes through its centre of mass.

    Returns:
        The radius of a sphere about that centre with all of them inside, m.
    """
    dx, dy, dz = vec(row, r.OFFSET)
    at = r.HULL
    for k in range(hull.shape[0]):
        hull[k, 0], hull[k, 1], hull[k, 2] = model[at] - dx, model[at + 1] - dy, model[at + 2] - dz
        hull[k, 3] = model[at + 3]
        at += 4
    return model[r.BOUND] + sqrt(dx * dx + dy * dy + dz * dz)


@jit
def judge(model, ground, row, act, before, wheels_down, others_down):
    """Reward the row's step, and observe it.

    Args:
        model: what all rows share.
        ground: as the solver has it.
        row: of which the state is that at the end of the step.
        act: (3,) in [-1, 1], as given.
        before: cos tilt before the step.
        wheels_down: how many tyres' hull points have touched.
        others_down: how many other points.
    """
    x, quat, v, w = load(row)
    failed = row[r.STATE + r.FAILED] != 0.0
    done = due(model, row, act)
    if not failed:
        remember(row, act)
    observe_row(model, ground, row, x, quat, v, w)
    after = cos_tilt(quat)
    still = reward.is_still_upright(after, sqrt(dot(v, v)), sqrt(dot(w, w)), wheels_down, others_down)
    row[r.HELD] = row[r.HELD] + 1.0 if still and not failed else 0.0
    success = row[r.HELD] >= model[r.HOLD_STEPS]
    terms = reward.terms(before, after, success, done)
    put(row, r.STATE + r.TERMS, (terms[0], terms[1], terms[2]))
    row[r.STATE + r.TERMS + 3] = terms[3]
    row[r.STATE + r.REWARD] = terms[0] + terms[1] + terms[2] + terms[3]
    far = x[0] * x[0] + x[1] * x[1] > observe.FIELD * observe.FIELD
    row[r.STATE + r.TERMINATED] = success
    row[r.STATE + r.TRUNCATED] = not success and (failed or far or row[r.STEPS] >= model[r.MAX_STEPS])
    row[r.STATE + r.SUCCESS] = success
    row[r.STATE + r.N_CONTACTS] = wheels_down + others_down
    row[r.STATE + r.TOTAL_WORK] = row[r.WORK]


@jit
def drive_alone(model, ground, row, torque, hull, contacts, scratch, push):
    """The physics of one control step of one row, by `impulse.step`.

    A row whose state would not be finite has FAILED, and is left as it was.
    """
    bound = place_hull(model, row, hull)
    m, inertia = row[r.MASS], vec(row, r.INERTIA)
    inverse = (1.0 / inertia[0], 1.0 / inertia[1], 1.0 / inertia[2])
    body = (m, 1.0 / m, inertia, inverse, bound)
    law = (row[r.FRICTION], row[r.RESTITUTION], True, True, True, row[r.FRICTION])
    a = (0.0, 0.0, -model[r.GRAVITY])
    substeps = int(model[r.SUBSTEPS])
    h = model[r.CONTROL_DT] / substeps
    r.load_contacts(row, contacts)
    push[:] = 0.0
    x, quat, v, w = load(row)
    work = row[r.WORK]
    clear = 0.0
    row[r.STATE + r.FAILED] = 0.0
    for done in range(substeps):
        x1, quat1, v1, w1, clear, still, _k = impulse.split_step(
            body, hull, ground, law, a, torque, x, quat, v, w, contacts, scratch, push, h, clear, 0
        )
        if not is_finite(x1, quat1, v1, w1):
            row[r.STATE + r.FAILED] = 1.0
            return
        work += 0.5 * h * (lanes.power(torque, w) + lanes.power(torque, w1))
        asleep = still > 0 and (x, quat, v, w) == (x1, quat1, v1, w1)
        x, quat, v, w = x1, quat1, v1, w1
        if asleep:
            impulse.repeat(scratch, still, ground, push, substeps - 1 - done)
            for _ in range(done + 1, substeps):
                work += h * lanes.power(torque, w)
            break
    store(row, x, quat, v, w)
    row[r.WORK] = work
    row[r.STEPS] += 1.0
    r.store_contacts(row, contacts)


@jit
def not_finite(actions, which):
    """The first of these rows of actions that is not finite; -1 if all are."""
    for i in which:
        if not 0.0 * actions[i, 0] + 0.0 * actions[i, 1] + 0.0 * actions[i, 2] == 0.0:
            return i
    return -1


@entry
def step(model, field, rows, actions, which, push):
    """One control step of some environments on one ground, one by one, in place.

    Args:
        model: what they share (`row.model`).
        field: the ground's, or None for a plane.
        rows: (n, row.width).
        actions: (n, 3) float32, clipped to [-1, 1] here.
        which: (m,) their indices.
        push: (p, PUSH) filled with the last one's impulse on each hull point, N s.

    Returns:
        -1, or the first environment whose action is not finite: then nothing has been done.
    """
    bad = not_finite(actions, which)
    if bad >= 0:
        return bad
    points = push.shape[0]
    hulls, memory = np.empty((points, 4)), np.empty((points, MEMORY))
    scratches = np.empty((points, CONTACT_ROW))
    hull, contacts, scratch = borrowed(hulls), borrowed(memory), borrowed(scratches)
    shared, states, given = borrowed(model), borrowed(rows), borrowed(actions)
    ground = ground_of(shared, field)
    for i in which:
        row, act = states[i], clipped(given[i])
        before = cos_tilt(load(row)[1])
        drive_alone(shared, ground, row, actuate(shared, row, act), hull, contacts, scratch, borrowed(push))
        wheels_down, others_down = 0, 0
        for k in range(points):
            if push[k, 0] != 0.0 or push[k, 1] != 0.0 or push[k, 2] != 0.0:
                if k < shared[r.WHEELS]:
                    wheels_down += 1
                else:
                    others_down += 1
        judge(shared, ground, row, act, before, wheels_down, others_down)
    keep_alive(hulls, memory, scratches)
    return -1


@jit
def kind_of(model, ground, row):
    """How alike two rows' next steps will be: those of a kind share a group. 0 to KINDS - 1."""
    closed = int(row[r.CLOSED])
    if closed == 0:
        return 0 if height_over(ground, vec(row, r.MOTION)) > model[r.BOUND] else 1
    n, slides = 0, 0
    while closed:
        closed &= closed - 1
        if n < r.SLOTS:
            force = vec(row, r.FORCES + 3 * n)
            most = 0.99 * row[r.FRICTION] * force[0]
            slides += force[1] * force[1] + force[2] * force[2] >= most * most
        n += 1
    return 2 + min(n, MAX_ALIKE - 1) * MAX_ALIKE + min(slides, MAX_ALIKE - 1)


MAX_ALIKE = 6
KINDS = 2 + MAX_ALIKE * MAX_ALIKE


@jit
def sort(model, ground, rows, which, order):
    """Fill `order` with the indices `which`, rows of a kind together."""
    counts = np.zeros(KINDS + 1, np.int64)
    begins = borrowed(counts)
    for i in which:
        begins[kind_of(model, ground, rows[i]) + 1] += 1
    for kind in range(KINDS):
        begins[kind + 1] += begins[kind]
    for i in which:
        kind = kind_of(model, ground, rows[i])
        order[begins[kind]] = i
        begins[kind] += 1
    keep_alive(counts)


@stage
def enter(model, row, act, lane, pad, hull, contacts, rows):
    """Give a row's car to a lane."""
    apart()
    for j in range(lanes.TORQUE):
        pad[j, lane] = row[j]
    pad[lanes.TORQUE, lane], pad[lanes.TORQUE + 1, lane], pad[lanes.TORQUE + 2, lane] = actuate(
        model, row, act
    )
    pad[lanes.MASS, lane] = row[r.MASS]
    for j in range(3):
        pad[lanes.INERTIA + j, lane] = row[r.INERTIA + j]
    pad[lanes.FRICTION, lane] = pad[lanes.BLOW_FRICTION, lane] = row[r.FRICTION]
    pad[lanes.RESTITUTION, lane] = row[r.RESTITUTION]
    pad[lanes.WORK, lane] = row[r.WORK]
    offset = vec(row, r.OFFSET)
    if (pad[SHIFT, lane], pad[SHIFT + 1, lane], pad[SHIFT + 2, lane]) != offset:
        pad[SHIFT, lane], pad[SHIFT + 1, lane], pad[SHIFT + 2, lane] = offset
        pad[lanes.BOUND, lane] = place_hull(model, row, hull[:, :, lane])
    pad[lanes.N, lane] = 0.0
    closed = int(row[r.CLOSED])
    slot = r.FORCES
    k = 0
    while closed:
        if closed & 1:
            force = (0.0, 0.0, 0.0)
            if slot < r.STATE:
                force = vec(row, slot)
            lanes.attach(contacts, rows, pad, hull, None, lane, k, force)
            slot += 3
        closed >>= 1
        k += 1


@stage
def leave(row, lane, pad, rows):
    """The inverse, after the step."""
    apart()
    row[r.STATE + r.FAILED] = pad[lanes.FAILED, lane]
    if pad[lanes.FAILED, lane] != 0.0:
        return
    for j in range(lanes.TORQUE):
        row[j] = pad[j, lane]
    row[r.WORK] = pad[lanes.WORK, lane]
    row[r.STEPS] += 1.0
    closed = 0
    slot = r.FORCES
    for c in range(int(pad[lanes.N, lane])):
        k, force = lanes.attached(rows, None, c, lane)
        closed |= 1 << k
        if slot < r.STATE:
            put(row, slot, force)
            slot += 3
    row[r.CLOSED] = closed
    for j in range(slot, r.STATE):
        row[j] = 0.0


SHIFT = lanes.PAD
"""Columns of the pad, after the solver's: the centre of mass for which a lane's hull is placed."""
WHEELS_DOWN, OTHERS_DOWN = SHIFT + 3, SHIFT + 4
PAD = SHIFT + 5


@jit
def count_down(contacts, wheels, pad):
    """Count each lane's hull points that have touched, tyres and others."""
    none = 0.0 * lanes.column(pad, lanes.MASS)
    down = none
    for k in range(wheels):
        down = lanes.touched(contacts, k, down)
    lanes.set_column(pad, WHEELS_DOWN, down)
    down = none
    for k in range(wheels, contacts.shape[0]):
        down = lanes.touched(contacts, k, down)
    lanes.set_column(pad, OTHERS_DOWN, down)


@entry
def step_many(model, rows, actions, which):
    """The same as `step` over a plane for many, which share the processor's lanes; actions must be finite."""
    n, points = which.shape[0], (model.shape[0] - r.HULL) // 4
    shared, states, given = borrowed(model), borrowed(rows), borrowed(actions)
    ground = ground_of(shared, None)
    order = np.empty(n, np.int64)
    sort(shared, ground, states, borrowed(which), borrowed(order))
    pads = np.full((PAD, LANES), np.nan)
    hulls, touches = np.empty((points, 4, LANES)), np.empty((points, 2, LANES))
    contact_rows = np.zeros((points, CONTACT_ROW, LANES))
    memories, scratches = np.empty((points, MEMORY)), np.empty((points, CONTACT_ROW))
    pushes, nodes = np.empty((points, PUSH)), np.empty((points, 4))
    pad, hull, contacts = borrowed(pads), borrowed(hulls), borrowed(touches)
    held, memory, scratch = borrowed(contact_rows), borrowed(memories), borrowed(scratches)
    push, spots = borrowed(pushes), borrowed(nodes)
    a = (0.0, 0.0, -shared[r.GRAVITY])
    substeps = int(shared[r.SUBSTEPS])
    h = shared[r.CONTROL_DT] / substeps
    for first in range(0, n, LANES):
        used = min(LANES, n - first)
        lanes.release(contacts)
        for lane in range(LANES):
            i = order[first + min(lane, used - 1)]
            enter(shared, states[i], clipped(given[i]), lane, pad, hull, contacts, held)
        lanes.drive(
            pad, hull, contacts, held, None, used, ground, a, h, substeps, memory, scratch, push, spots
        )
        count_down(contacts, int(shared[r.WHEELS]), pad)
        for lane in range(used):
            i = order[first + lane]
            row = states[i]
            before = cos_tilt(load(row)[1])
            leave(row, lane, pad, held)
            wheels_down, others_down = int(pad[WHEELS_DOWN, lane]), int(pad[OTHERS_DOWN, lane])
            judge(shared, ground, row, clipped(given[i]), before, wheels_down, others_down)
    keep_alive(order, pads, hulls, touches, contact_rows, memories, scratches, pushes, nodes)


@jit
def look_at(model, ground, row):
    """Fill the results and the observation of a row that has just been set."""
    for j in range(r.STATE, r.OBSERVED):
        row[j] = 0.0
    x, quat, v, w = load(row)
    observe_row(model, ground, row, x, quat, v, w)


@entry
def look(model, field, rows, which):
    """`look_at` the rows of these indices; `field` as in `step`."""
    ground = ground_of(model, field)
    for i in which:
        look_at(model, ground, rows[i])
