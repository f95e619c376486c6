"""Sustained contacts: the impulses, at the middle pose of a step, that hold points on the surface.

- close: a row for each contact that is not open
- guess: the last step's forces
- aim: the velocities to reach, so that the end of the step meets the constraint
- hold: leave them if they hold; make all stick if they can; else sweep
"""

from math import sqrt

from .algebra import dot, jit, matrix, put2, scale, to_body, vec2
from .contact import centripetal, gyroscopic
from .model import CLOSED, OPEN, arm, gap, height_over
from .stick import holds, stick
from .sweep import POINT, SLIP, STRIKE_SWEEPS, TARGET, P, agree, apply, fill, velocity

ON_CONE = 0.999
"""A force that fills so much of its cone slides; then sweeping is quicker than trying to stick."""

SWEEPS = 12
AGREED = 1e-4
"""Of g h: how well the sweeps agree. What is left is taken up by the next step, which starts from
this one's forces."""

FINEST = 1e-12
"""m/s; where there is no gravity."""

COLD = 1e-3
"""m/s, beyond g h: sweeps that still change so much had a first guess that was worse than none."""


@jit
def frame_in_body(plane, R):
    """(N, t1, t2) in body axes."""
    return to_body(R, plane[0]), to_body(R, plane[1]), to_body(R, plane[2])


@jit
def prepare(body, hull, plane, mu, frame_b, k, v, w, rows, c):
    """Fill row c for hull point k, with the slip before any impulse. Returns (u, b, q)."""
    frame = (plane[0], plane[1], plane[2])
    b, q = arm(hull, k, frame_b[0])
    fill(rows, c, k, body[1], body[3], mu, frame, frame_b, q)
    u = velocity(rows, c, mu, v, w)
    rows[c, SLIP] = u[1]
    rows[c, SLIP + 1] = u[2]
    return u, b, q


@jit
def close(body, hull, plane, mu, quat, v, w, contacts, rows):
    """Fill a row for each contact that is not OPEN.

    Returns:
        (n, slides): how many, and whether any slid in the last step (or there is no friction).
    """
    frame_b = frame_in_body(plane, matrix(quat))
    n = 0
    slides = mu == 0.0
    for k in range(hull.shape[0]):
        if contacts[k, 0] != OPEN:
            prepare(body, hull, plane, mu, frame_b, k, v, w, rows, n)
            F = vec2(contacts, k, 1)
            slid = F[1] * F[1] + F[2] * F[2] >= ON_CONE * (mu * F[0]) ** 2
            slides = slides or (slid and F[0] > 0.0)
            n += 1
    return n, slides


@jit
def guess(inv_m, mu, v, w, contacts, rows, n, h):
    """The velocities with the last step's forces in them; the rows get the impulses."""
    for c in range(n):
        p = scale(h, vec2(contacts, int(rows[c, POINT]), 1))
        put2(rows, c, P, p)
        v, w = apply(rows, c, inv_m, mu, p, v, w)
    return v, w


@jit
def aim(J, inv_J, hull, plane, x, quat, w, contacts, rows, n, h):
    """Targets: Eq. 5's c at velocity level, u = −(h/2) c, with the spin that is expected to come out.

    Without it, sustained contact is of first order. A LATE point, still above the surface, may come
    down to it by the end of the step.
    """
    frame_b = frame_in_body(plane, matrix(quat))
    w_dot = gyroscopic(J, inv_J, w)
    half = 0.5 * h
    for c in range(n):
        k = int(rows[c, POINT])
        if contacts[k, 0] == CLOSED:
            b, q = arm(hull, k, frame_b[0])
            u = scale(-half, centripetal(w, w_dot, b, q))
            put2(rows, c, TARGET, (dot(frame_b[0], u), dot(frame_b[1], u), dot(frame_b[2], u)))
        else:
            g = gap(hull, k, frame_b[0], height_over(plane, x))
            put2(rows, c, TARGET, (-max(0.0, g) / half, 0.0, 0.0))


@jit
def hold(body, hull, plane, mu, a, x, quat, v, w, contacts, rows, n, slides, h):
    """The velocities after the impulses of n contacts; (v, w) have gravity and torque in them already."""
    m, inv_m, J, inv_J, _bound = body
    v1, w1 = guess(inv_m, mu, v, w, contacts, rows, n, h)
    aim(J, inv_J, hull, plane, x, quat, w1, contacts, rows, n, h)
    if not slides:
        if holds(rows, n, mu, v1, w1):
            return v1, w1
        if n > 1:
            R = matrix(quat)
            done, v1, w1 = stick(rows, n, m, J, mu, R, frame_in_body(plane, R), v, w)
            if done:
                return v1, w1
            v1, w1 = guess(inv_m, mu, v, w, contacts, rows, n, h)
    gh = h * sqrt(dot(a, a))
    enough = max(FINEST, AGREED * gh)
    v1, w1, change = agree(rows, n, inv_m, mu, 1.0, v1, w1, SWEEPS, enough)
    if change > COLD + gh:
        for c in range(n):
            put2(rows, c, P, (0.0, 0.0, 0.0))
        v1, w1, change = agree(rows, n, inv_m, mu, 1.0, v, w, STRIKE_SWEEPS, enough)
    return v1, w1
