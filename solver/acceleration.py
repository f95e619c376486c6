"""Method "acceleration": the article as written.

Each step the contact force is found from accelerations (Eq. 7; Eq. 11 when the point slides with
friction) and the motion is stepped with it; a collision is an impulse (Eq. 8) that also puts the
point back on the surface. Every touching point is treated by itself and the forces are added. So:

- with one frictionless contact this is the article, first order in the step;
- nothing holds the point on the surface between collisions: its gap drifts;
- several points push too hard together, and sliding points never stick.

It is here to be read, and to show where it fails.
"""

from math import sqrt, tan

import numpy as np

from .algebra import (
    axpy,
    cross,
    dot,
    entry,
    jit,
    matrix,
    put6,
    scale,
    stage,
    times,
    to_body,
    to_world,
    turned,
    vec,
)
from .contact import (
    force,
    free_acceleration,
    gyroscopic,
    impulse,
    inverse_mass,
    normal_speed,
    push,
    shift,
)
from .model import (
    CLOSED,
    NOT_FINITE,
    OK,
    OPEN,
    PAINLEVE,
    TOUCH,
    arm,
    bending,
    gap_of,
    is_finite,
    load,
    meet,
    seen,
    speed_of,
    store,
    unpack,
    upward,
)

STIFF = (0.0, 0.0)
"""No spring: forces come from accelerations alone."""


@jit
def contact_force(body, hull, k, field, mu, spring, view, a_free, w_dot_free, v, w):
    """Eq. 9 of one point, with Eq. 11's denominator if it slides with friction, all in body axes.

    With a spring of (α, β) = (0, 0) it is Eq. 7.

    Returns:
        (f, F, q): the normal force, N, the whole force, N, and where it acts. f is NaN where Eq. 11's
        denominator is not positive: Painlevé's paradox, in which a force has no meaning.
    """
    _m, inv_m, _J, inv_J, _bound = body
    phi, N, H = meet(hull, k, field, view)
    b, q = arm(hull, k, N)
    alpha, beta = spring
    l = free_acceleration(N, b, q, a_free, w_dot_free, w) + bending(field, H, view[0], b, v, w)
    l += 2.0 * alpha * normal_speed(N, q, v, w) + beta * beta * phi
    direction = N
    if mu > 0.0:
        u = axpy(1.0, v, cross(w, q))
        slip = axpy(-dot(N, u), N, u)
        speed = sqrt(dot(slip, slip))
        if speed > TOUCH:
            direction = axpy(-mu / speed, slip, N)
    # N·K(N − μs); without friction the G of Eq. 6.
    arms = times(inv_J, cross(q, direction))
    G = inv_m * dot(N, direction) + dot(cross(q, N), arms)
    if G <= 0.0:
        return np.nan, scale(np.nan, N), q
    f = force(G, l)
    return f, scale(f, direction), q


@stage
def collide(body, hull, ground, e, every_frame, x, quat, v, w, contacts):
    """Eq. 8 at every point that touches, or has sunk, and closes; each by itself, then added."""
    _m, inv_m, _J, inv_J, _bound = body
    R = matrix(quat)
    view = seen(ground, R, x)
    v_b = to_body(R, v)
    v1, w1 = v_b, w
    turn = (0.0, 0.0, 0.0)
    for k in range(hull.shape[0]):
        g, N, _H = meet(hull, k, ground[4], view)
        if contacts[k, 0] == OPEN and g > TOUCH:
            continue
        _b, q = arm(hull, k, N)
        speed = normal_speed(N, q, v_b, w)
        G = inverse_mass(inv_m, inv_J, N, q)
        if every_frame and contacts[k, 0] == CLOSED:
            p = scale(-speed / G, N)
            v1, w1 = push(inv_m, inv_J, q, p, v1, w1)
        elif contacts[k, 0] == OPEN:
            if speed < -TOUCH:
                p = scale(impulse(G, speed, e), N)
                v1, w1 = push(inv_m, inv_J, q, p, v1, w1)
            if g < 0.0:
                dx, dq = shift(inv_m, inv_J, N, q, G, g)
                x = axpy(dx, upward(ground, ground[4], R, N), x)
                turn = axpy(1.0, dq, turn)
    v = to_world(R, v1)
    return x, turned(quat, scale(0.5, turn)), v, w1


@jit
def close(hull, ground, x, quat, v, w, contacts):
    """A point that touches and is still is a closed contact: Eqs. 6-7 hold for it."""
    view = seen(ground, matrix(quat), x)
    for k in range(hull.shape[0]):
        touches = abs(gap_of(hull, k, ground[4], view)) <= TOUCH
        if touches and abs(speed_of(hull, k, ground[4], view, v, w)) <= TOUCH:
            contacts[k, 0] = CLOSED


@stage
def forces(body, hull, ground, mu, spring, a, torque, x, quat, v, w, contacts, f):
    """Accelerations (ẍ world, ẇ body) of Eqs. 1-3 with every closed contact's force; f is filled."""
    _m, inv_m, J, inv_J, _bound = body
    R = matrix(quat)
    view = seen(ground, R, x)
    a_b, v_b = to_body(R, a), to_body(R, v)
    w_dot = axpy(1.0, times(inv_J, torque), gyroscopic(J, inv_J, w))
    x_ddot, w_ddot = a_b, w_dot
    for k in range(hull.shape[0]):
        f[k] = 0.0
        if contacts[k, 0] == CLOSED:
            f[k], F, q = contact_force(body, hull, k, ground[4], mu, spring, view, a_b, w_dot, v_b, w)
            if f[k] > 0.0:
                x_ddot, w_ddot = push(inv_m, inv_J, q, F, x_ddot, w_ddot)
            elif f[k] == 0.0:
                contacts[k, 0] = OPEN
    return to_world(R, x_ddot), w_ddot


@jit
def turn_by(quat, w, h):
    """The attitude after turning with constant w (body axes) for h seconds."""
    speed = sqrt(dot(w, w))
    half = 0.5 * h * speed
    return turned(quat, scale(0.5 * h if half < 1e-9 else tan(half) / speed, w))


@jit
def euler(x, quat, v, w, x_ddot, w_ddot, h):
    """Semi-implicit Euler: the velocities, then the pose with them."""
    v = axpy(h, x_ddot, v)
    w = axpy(h, w_ddot, w)
    return axpy(h, v, x), turn_by(quat, w, h), v, w


@entry
def run(body, hull, ground, law, a, torque, state, contacts, f, options, h, n):
    """n steps of h seconds, in place; the arguments are those of `impulse.run`.

    `f` is left as the force at the end, not a mean. options[0] != 0: Eq. 8 with e = 0 every step.

    Returns:
        OK, NOT_FINITE, or PAINLEVE; then `state` is as it was before the step that failed.
    """
    body_, ground_ = unpack(body, ground)
    mu, e = law[0], law[1]
    a_ = vec(a, 0)
    torque_ = vec(torque, 0)
    every_frame = options[0] != 0.0
    x, quat, v, w = load(state)
    for _ in range(n):
        x, quat, v, w = collide(body_, hull, ground_, e, every_frame, x, quat, v, w, contacts)
        close(hull, ground_, x, quat, v, w, contacts)
        x_ddot, w_ddot = forces(body_, hull, ground_, mu, STIFF, a_, torque_, x, quat, v, w, contacts, f)
        if np.isnan(f).any():
            return PAINLEVE
        x, quat, v, w = euler(x, quat, v, w, x_ddot, w_ddot, h)
        if not is_finite(x, quat, v, w):
            return NOT_FINITE
        store(state, x, quat, v, w)
    close(hull, ground_, x, quat, v, w, contacts)
    forces(body_, hull, ground_, mu, STIFF, a_, torque_, x, quat, v, w, contacts.copy(), f)
    return PAINLEVE if np.isnan(f).any() else OK


@entry
def quantities(body, hull, ground, law, a, torque, state, out):
    """The article's φ, v, G, l, f, i (Eqs. 4-8) of every hull point, by itself; out is (p, 6)."""
    body_, ground_ = unpack(body, ground)
    _m, inv_m, J, inv_J, _bound = body_
    x, quat, v, w = load(state)
    R = matrix(quat)
    view, field = seen(ground_, R, x), ground_[4]
    v_b, a_b = to_body(R, v), to_body(R, vec(a, 0))
    w_dot = axpy(1.0, times(inv_J, vec(torque, 0)), gyroscopic(J, inv_J, w))
    for k in range(hull.shape[0]):
        phi, N, H = meet(hull, k, field, view)
        b, q = arm(hull, k, N)
        speed = normal_speed(N, q, v_b, w)
        G = inverse_mass(inv_m, inv_J, N, q)
        l = free_acceleration(N, b, q, a_b, w_dot, w) + bending(field, H, R, b, v_b, w)
        f, i = force(G, l), impulse(G, speed, law[1])
        put6(out, k, 0, (phi, speed, G, l, f, i))
