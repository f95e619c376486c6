"""One environment as one row of numbers.

First its state: everything that its future depends on, which `get_state` and `set_state` copy. Then
what the last control step made of it: the results and the observation. A batch is a 2-D array of such
rows. What is the same for every row on the same ground (the hull, the plane, the task's settings) is
packed in one flat array, the model. So a compiled call takes few arguments, each of which would cost as
much as a physics step.
"""

import numpy as np

from solver import Body
from solver.algebra import jit
from solver.model import CLOSED as HELD_ON
from solver.model import OPEN

# Columns of a row.
MOTION = 0  # x, quat, v in world and w in the car's axes: 13 numbers
STEPS = 13  # control steps since the start
HELD = 14  # control steps for which the car has been upright and still
WORK = 15  # the actuator's integral of |torque · w|, J
KEY = 16  # random key: high and low 32 bits
EPISODE = 18  # how many resets since the key was set
START = 19  # kind of start, an index into `starts.KINDS`
CAR = 20  # this episode's car: the columns below, in the order of `car.NOMINAL`
CLOSED = 32  # which hull points are in contact: bit k is point k's
GIVEN = 33  # the last actions, the newest last: those carried out late, and one that is observed
MAX_DELAY = 2
NEWEST = GIVEN + 3 * (MAX_DELAY - 1)
FORCES = GIVEN + 3 * MAX_DELAY  # of the first so many contacts, along N, t1, t2, N: a first guess
SLOTS = 4
"""No facet of the car's hull has more points, and no more have been seen in contact at once."""
STATE = FORCES + 3 * SLOTS  # so long is the state

# Columns of the car.
MASS = 20  # kg
INERTIA = 21  # roll, pitch and yaw, kg m²
OFFSET = 24  # of the centre of mass from the nominal car's, m, car's axes
FRICTION = 27
RESTITUTION = 28
LIMIT = 29  # torque limits, N m

# Columns of the results, counted from their first, which is STATE.
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
OBSERVED = STATE + RESULTS  # from here the observation, as float32: two to a column

MAX_POINTS = 53
"""So many bits has a float64's whole number."""


def width(observed: int) -> int:
    """Length of a row with so many numbers in its observation."""
    return OBSERVED + (observed + 1) // 2


# Fields of the model.
BOUND = 0  # radius of the bounding sphere, m
PLANE = 1  # N, t1, t2, d
GRAVITY = 11  # m/s², downwards
CONTROL_DT = 12
SUBSTEPS = 13
MAX_STEPS = 14
HOLD_STEPS = 15
VIEW = 16  # kind of observation, an index into `observe.KINDS`
WHEELS = 17
SCATTER = 18  # m; starts are within ± so much of the origin in x and y
DELAY = 19  # control steps from an action to its torque
NOISE = 20  # of the sensors, in `observe.SENSORS`
HULL = 21  # (p, 4)


def model(
    body: Body,
    plane: np.ndarray,
    gravity: float,
    wheels: int,
    control_dt: float,
    substeps: int,
    max_steps: int,
    hold_steps: int,
    view: int,
    scatter: float,
    delay: int,
    noise: float,
) -> np.ndarray:
    """Pack what is the same for every row on the same ground."""
    if len(body.hull) > MAX_POINTS:
        raise ValueError(f"body must have at most {MAX_POINTS} hull points, got {len(body.hull)}")
    return np.concatenate(
        [
            [body.bounding_radius],
            plane,
            [gravity, control_dt, substeps, max_steps, hold_steps, view, wheels, scatter, delay, noise],
            np.column_stack([body.hull, body.radius]).ravel(),
        ]
    )


@jit
def load_contacts(row, contacts):
    """The solver's memory of the contacts, (p, MEMORY), from a row."""
    closed = int(row[CLOSED])
    slot = FORCES
    for k in range(contacts.shape[0]):
        contacts[k, 0] = OPEN
        contacts[k, 1] = contacts[k, 2] = contacts[k, 3] = 0.0
        if (closed >> k) & 1:
            contacts[k, 0] = HELD_ON
            if slot < STATE:
                for j in range(3):
                    contacts[k, 1 + j] = row[slot + j]
            slot += 3


@jit
def store_contacts(row, contacts):
    """The inverse of `load_contacts`.

    Where more contacts are closed than there are slots, the last ones' forces are forgotten: the solver
    then starts from none.
    """
    closed = 0
    slot = FORCES
    for k in range(contacts.shape[0]):
        if contacts[k, 0] != OPEN:
            closed |= 1 << k
            if slot < STATE:
                for j in range(3):
                    row[slot + j] = contacts[k, 1 + j]
                slot += 3
    row[CLOSED] = closed
    for j in range(slot, STATE):
        row[j] = 0.0
