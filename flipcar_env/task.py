"""The task, compiled: actuate, step, observe, reward. Rows in, rows out; no Python objects."""

from math import sqrt

import numpy as np

from solver import impulse
from solver.algebra import borrowed, dot, entry, jit, once, put, vec
from solver.model import MEMORY, is_finite, load, store, unpack
from solver.sweep import WIDTH as CONTACT_ROW
from solver.sweep import kinetic_energy

from . import car, observe, reward
from . import row as r

RESTITUTION = True if car.RESTITUTION > 0.0 else None
"""None: the car's kernel leaves restitution out; every other term it has (`solver.terms`)."""


@jit
def kept(term, value):
    """The value, or None if its term is left out."""
    if term is None:
        return None
    return value


@jit
def cos_tilt(quat):
    """Vertical component of the car's up axis."""
    return 1.0 - 2.0 * (quat[1] * quat[1] + quat[2] * quat[2])


@jit
def energy(model, x, v, w):
    """Mechanical energy, zero at rest on the ground plane's height, J."""
    m = model[r.BODY]
    return kinetic_energy(m, vec(model, r.BODY + 1), v, w) + m * model[r.GRAVITY] * x[2]


@jit
def observe_row(model, out, x, quat, v, w):
    """Fill the results that any state has, and the observation."""
    out[r.ENERGY] = energy(model, x, v, w)
    out[r.TILT] = reward.tilt(cos_tilt(quat))
    obs = borrowed(out[r.RESULTS :].view(np.float32))
    if model[r.EGOCENTRIC] != 0.0:
        observe.egocentric(x, quat, v, w, obs)
    else:
        observe.state(x, quat, v, w, obs)


@once
def step_row(model, hull, row, action, scratch):
    """One control step of one environment."""
    body, ground = unpack(model[r.BODY : r.BODY + 5], (model[r.PLANE : r.PLANE + 10], None))
    law = (model[r.LAW], kept(RESTITUTION, model[r.LAW + 1]), True, True, True, None)
    g = (0.0, 0.0, -model[r.GRAVITY])
    substeps = int(model[r.SUBSTEPS])
    h = model[r.CONTROL_DT] / substeps
    points = hull.shape[0]
    contacts = borrowed(row[r.CONTACTS : r.state_width(points)].reshape(points, MEMORY))
    push = borrowed(row[r.state_width(points) : r.results(points)].reshape(points, 3))
    out = borrowed(row[r.results(points) :])

    # actuate
    act = (
        min(1.0, max(-1.0, float(action[0]))),
        min(1.0, max(-1.0, float(action[1]))),
        min(1.0, max(-1.0, float(action[2]))),
    )
    torque = (
        act[0] * model[r.LIMIT],
        act[1] * model[r.LIMIT + 1],
        act[2] * model[r.LIMIT + 2],
    )

    # step
    push[:] = 0.0
    x, quat, v, w = load(row)
    before = cos_tilt(quat)
    failed = False
    work = row[r.WORK]
    clear = 0.0
    for done in range(substeps):
        x1, quat1, v1, w1, clear, still = impulse.step(
            body, hull, ground, law, g, torque, x, quat, v, w, contacts, scratch, push, h, clear
        )
        if not is_finite(x1, quat1, v1, w1):
            failed = True
            break
        work += 0.5 * h * (abs(dot(torque, w)) + abs(dot(torque, w1)))
        asleep = still > 0 and (x, quat, v, w) == (x1, quat1, v1, w1)
        x, quat, v, w = x1, quat1, v1, w1
        if asleep:
            impulse.repeat(scratch, still, ground, push, substeps - 1 - done)
            for _ in range(done + 1, substeps):
                work += h * abs(dot(torque, w))
            break
    store(row, x, quat, v, w)
    row[r.WORK] = work
    row[r.STEPS] += 1.0

    # observe
    observe_row(model, out, x, quat, v, w)

    # reward
    wheels_down, others_down = 0, 0
    for k in range(points):
        if push[k, 0] != 0.0 or push[k, 1] != 0.0 or push[k, 2] != 0.0:
            if k < model[r.WHEELS]:
                wheels_down += 1
            else:
                others_down += 1
    after = cos_tilt(quat)
    still = reward.is_still_upright(after, sqrt(dot(v, v)), sqrt(dot(w, w)), wheels_down, others_down)
    row[r.HELD] = row[r.HELD] + 1.0 if still else 0.0
    success = row[r.HELD] >= model[r.HOLD_STEPS]
    terms = reward.terms(before, after, success, act)
    put(out, r.TERMS, (terms[0], terms[1], terms[2]))
    out[r.TERMS + 3] = terms[3]
    out[r.REWARD] = terms[0] + terms[1] + terms[2] + terms[3]
    far = x[0] * x[0] + x[1] * x[1] > observe.FIELD * observe.FIELD
    out[r.TERMINATED] = success
    out[r.TRUNCATED] = not success and (failed or far or row[r.STEPS] >= model[r.MAX_STEPS])
    out[r.SUCCESS] = success
    out[r.N_CONTACTS] = wheels_down + others_down
    out[r.TOTAL_WORK] = work
    out[r.FAILED] = failed


@entry
def step(model, rows, actions):
    """One control step of n environments, in place; none if an action is not finite.

    Args:
        model: what they share (`row.model`).
        rows: (n, row.width).
        actions: (n, 3) float32, clipped to [-1, 1] here.

    Returns:
        -1, or the first environment whose action is not finite: then nothing has been done.
    """
    for i in range(rows.shape[0]):
        if not 0.0 * (actions[i, 0] + actions[i, 1] + actions[i, 2]) == 0.0:
            return i
    hull = borrowed(model[r.HULL :].reshape(-1, 4))
    scratch = np.empty((hull.shape[0], CONTACT_ROW))
    for i in range(rows.shape[0]):
        step_row(borrowed(model), hull, borrowed(rows[i]), borrowed(actions[i]), borrowed(scratch))
    return -1


@entry
def look(model, row):
    """Fill the results and the observation of a row that has just been set."""
    out = row[r.results((model.size - r.HULL) // 4) :]
    out[: r.RESULTS] = 0.0
    x, quat, v, w = load(row)
    observe_row(model, out, x, quat, v, w)
