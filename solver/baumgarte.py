"""Method "baumgarte": the article's other cure for drift, a spring and a damper in l (Eq. 9).

    f = −(l + 2α v + β² φ) / G

pulls a point that has left the surface back to it, as a damped oscillator would: x″ + 2α x′ + β² x = 0,
critically damped at α = β. A point that arrives is dealt Eq. 8's impulse once. Every touching point is
treated by itself and the forces are added, as with "acceleration". So:

- the gap of a sliding contact stays small, of first order in the step;
- the step must be short against the spring: β h < 2 √(1 − α h), or it rings and then explodes;
- a body that starts inside the ground is thrown out of it, at about β φ: energy is gained;
- several points push too hard together, and sliding points never stick.

It is here to be compared, and to show where it fails.
"""

import numpy as np

from .acceleration import euler, forces
from .algebra import entry, matrix, scale, stage, to_body, to_world, vec
from .contact import impulse, inverse_mass, normal_speed, push
from .model import (
    CLOSED,
    NOT_FINITE,
    OK,
    OPEN,
    PAINLEVE,
    TOUCH,
    arm,
    is_finite,
    load,
    meet,
    seen,
    store,
    unpack,
)

ALPHA = 20.0
"""1/s."""

BETA = 20.0
"""1/s; equal to α: critically damped, back within a twentieth of a second."""


@stage
def arrive(body, hull, ground, e, x, quat, v, w, contacts):
    """Eq. 8 at every point that has come down and closes; it is a closed contact from then on."""
    _m, inv_m, _J, inv_J, _bound = body
    R = matrix(quat)
    view = seen(ground, R, x)
    v_b = to_body(R, v)
    v1, w1 = v_b, w
    for k in range(hull.shape[0]):
        g, N, _H = meet(hull, k, ground[4], view)
        if contacts[k, 0] == OPEN and g <= TOUCH:
            contacts[k, 0] = CLOSED
            _b, q = arm(hull, k, N)
            speed = normal_speed(N, q, v_b, w)
            if speed < -TOUCH:
                i = impulse(inverse_mass(inv_m, inv_J, N, q), speed, e)
                v1, w1 = push(inv_m, inv_J, q, scale(i, N), v1, w1)
    return to_world(R, v1), w1


@entry
def run(body, hull, ground, law, a, torque, state, contacts, f, options, h, n):
    """n steps of h seconds, in place; the arguments are those of `impulse.run`.

    `f` is left as the force at the end, not a mean. options: α and β, 1/s.

    Returns:
        OK, NOT_FINITE, or PAINLEVE; then `state` is as it was before the step that failed.
    """
    body_, ground_ = unpack(body, ground)
    mu, e = law[0], law[1]
    a_ = vec(a, 0)
    torque_ = vec(torque, 0)
    spring = (options[0], options[1])
    x, quat, v, w = load(state)
    for _ in range(n):
        v, w = arrive(body_, hull, ground_, e, x, quat, v, w, contacts)
        x_ddot, w_ddot = forces(body_, hull, ground_, mu, spring, a_, torque_, x, quat, v, w, contacts, f)
        if np.isnan(f).any():
            return PAINLEVE
        x, quat, v, w = euler(x, quat, v, w, x_ddot, w_ddot, h)
        if not is_finite(x, quat, v, w):
            return NOT_FINITE
        store(state, x, quat, v, w)
    closed = contacts.copy()
    v, w = arrive(body_, hull, ground_, e, x, quat, v, w, closed)
    forces(body_, hull, ground_, mu, spring, a_, torque_, x, quat, v, w, closed, f)
    return PAINLEVE if np.isnan(f).any() else OK
