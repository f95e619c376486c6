"""One environment as one row of numbers: everything that its future depends on.

A batch is a 2-D array of such rows; `get_state` and `set_state` copy one. What is the same for every
row (the car, the ground, the task's settings) is packed in one flat array, the model, so that a
compiled call takes few arguments.
"""

import numpy as np

from solver import Body, Plane
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


def width(points: int) -> int:
    """Length of a row."""
    return CONTACTS + MEMORY * points


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
