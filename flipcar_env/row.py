"""One environment as one row of numbers.

First its state: everything that its future depends on, which `get_state` and `set_state` copy. Then
what the last control step made of it: each hull point's contact impulse, the results, the observation.
A batch is a 2-D array of such rows. What is the same for every row (the car, the ground, the task's
settings) is packed in one flat array, the model. So a compiled call takes few arguments, each of
which would cost as much as a physics step.
"""

import numpy as np

from solver import Body, Plane
from solver.algebra import jit
from solver.model import MEMORY

# Columns of a row.
MOTION = 0  # x, quat, v in world and w in the car's axes: 13 numbers
STEPS = 13  # control steps since the start
HELD = 14  # control steps for which the car has been upright and still
WORK = 15  # the actuator's integral of |torque · w|, J
KEY = 16  # random key: high and low 32 bits
EPISODE = 18  # how many resets since the key was set
START = 19  # kind of start, an index into `starts.KINDS`
CONTACTS = 20  # the solver's memory of each hull point


# Columns of the results, counted from their first.
TERMS = 0  # reward terms, in the order of reward.TERMS
REWARD = 4
TERMINATED = 5
TRUNCATED = 6
SUCCESS = 7
ENERGY = 8
TILT = 9
N_CONTACTS = 10
TOTAL_WORK = 11
FAILED = 12
RESULTS = 13
OBSERVED = 7  # after them the observation, as float32: two to a column


@jit
def state_width(points: int) -> int:
    """Length of the state, and where the (p, 3) contact impulses in world axes begin, N s."""
    return CONTACTS + MEMORY * points


@jit
def results(points: int) -> int:
    """Where the results begin."""
    return state_width(points) + 3 * points


def width(points: int) -> int:
    """Length of a row."""
    return results(points) + RESULTS + OBSERVED


# Fields of the model.
BODY = 0  # m, J, radius of the bounding sphere
PLANE = 5  # N, t1, t2, d
LAW = 15  # μ, e
GRAVITY = 17  # m/s², downwards
LIMIT = 18  # torque limits
CONTROL_DT = 21
SUBSTEPS = 22
MAX_STEPS = 23
HOLD_STEPS = 24
EGOCENTRIC = 25  # 1: egocentric observations; 0: state
WHEELS = 26
HULL = 27  # (p, 4)


def model(
    body: Body,
    plane: Plane,
    law: tuple[float, float],
    gravity: float,
    limit: tuple[float, float, float],
    wheels: int,
    control_dt: float,
    substeps: int,
    max_steps: int,
    hold_steps: int,
    egocentric: bool,
) -> np.ndarray:
    """Pack what is the same for every row."""
    return np.concatenate(
        [
            [body.m, *np.diag(body.J), body.bounding_radius],
            plane.parameters,
            law,
            [gravity, *limit, control_dt, substeps, max_steps, hold_steps, egocentric, wheels],
            np.column_stack([body.hull, body.radius]).ravel(),
        ]
    )
