"""Free flight: a parabola, and a rotation that keeps energy and angular momentum to rounding."""

from math import sqrt

import numpy as np

from .algebra import axpy, cross, dot, jit, scale, times, turned

MAX_TURN = 0.25
"""rad; a longer turn is split, so that the iteration below always contracts."""

MAX_PIECES = 10_000
MAX_ITERATIONS = 40


@jit
def spin(J, inv_J, quat, w, h):
    """Turn freely for h seconds: J ẇ = −w × J w, the torque-free part of Eq. 2.

    The discrete Moser-Veselov map with its moments of inertia adjusted so that it follows the true
    motion to fourth order (Hairer & Vilmart, J. Phys. A 39:13225, 2006). For any h it keeps the
    kinetic energy and the world's angular momentum to rounding.

    Args:
        J: principal moments of inertia, kg m².
        inv_J: their inverses.
        quat: attitude, body to world.
        w: angular velocity, body axes, rad/s.
        h: s.

    Returns:
        (quat, w) at the end.
    """
    turn = h * sqrt(dot(w, w))
    if turn < 1e-16:  # too small to change a bit of the attitude
        return quat, w
    n = 1
    dt = h
    if not turn < MAX_TURN * MAX_PIECES:  # or not a number: the caller's check finds it
        return (np.nan, np.nan, np.nan, np.nan), w
    if turn > MAX_TURN:
        n = int(turn / MAX_TURN) + 1
        dt = h / n
    L = times(J, w)

    # The adjusted moments I are constants of the motion, so they are found once.
    C = 0.5 * dot(L, L)
    H = 0.5 * dot(L, w)
    trace_inv = inv_J[0] + inv_J[1] + inv_J[2]
    inv_det = inv_J[0] * inv_J[1] * inv_J[2]
    sixth = (J[0] + J[1] + J[2]) * inv_det * (1.0 / 6.0)
    s3 = 1.0 + dt * dt * (sixth * C - trace_inv * H * (1.0 / 3.0))
    d3 = dt * dt * (sixth * H - inv_det * C * (1.0 / 3.0))
    a, b, c = inv_J[0] * s3 + d3, inv_J[1] * s3 + d3, inv_J[2] * s3 + d3  # 1/I
    det = 1.0 / (a * b * c)
    # (I₃ − I₂)/I₁ and its like: at most 1 in size for any real body
    k1, k2, k3 = a * a * (b - c) * det, b * b * (c - a) * det, c * c * (a - b) * det

    for _ in range(n):
        # I e + ((I₃−I₂)e₂e₃, …) = (1 + |e|²) dt L/2 for the turn's Cayley vector e, by fixed point.
        # It contracts by about |e| an iteration.
        y = (0.5 * dt * a * L[0], 0.5 * dt * b * L[1], 0.5 * dt * c * L[2])
        e = y
        for _ in range(MAX_ITERATIONS):
            s = 1.0 + dot(e, e)
            e_next = (
                s * y[0] - k1 * e[1] * e[2],
                s * y[1] - k2 * e[2] * e[0],
                s * y[2] - k3 * e[0] * e[1],
            )
            change = max(abs(e_next[0] - e[0]), abs(e_next[1] - e[1]), abs(e_next[2] - e[2]))
            e = e_next
            if change * turn < 1e-16:  # the next change would be less
                break
        quat = turned(quat, e)
        # The world's L stays: in body axes it turns the other way.
        t = scale(2.0 / (1.0 + dot(e, e)), cross(L, e))
        L = axpy(1.0, axpy(1.0, t, L), cross(t, e))
    return quat, times(inv_J, L)
