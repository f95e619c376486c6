"""Free flight: a parabola, and a rotation that keeps energy and angular momentum to rounding."""

import numpy as np

from .algebra import add, axpy, cross, dot, jit, product, scale, times
from .contact import gyroscopic
from .trace import every, filled, floor, fma, largest, no, some, sqrt, traced, where

MAX_TURN = 0.0125
"""rad; a longer turn is split. Kinetic energy is then off by less than rounding a piece (the error
goes with the sixth power of the turn), and so are the series for cosine and sine."""

MAX_PIECES = 100_000.0

STILL_TURN = 1e-16
"""rad: too small to change a bit of the attitude."""


@jit
def spin(J, inv_J, gyro, quat, w, h):
    """Turn freely for h seconds: J ẇ = −w × J w, the torque-free part of Eq. 2.

    Fourth order: the rotation vector by Magnus' series, its integrals by the classical Runge-Kutta
    rule. The body's angular momentum then turns back by just the rotation the body has made, so that
    the world's stays to rounding for any h; kinetic energy stays to rounding because pieces are short.

    Args:
        J: principal moments of inertia, kg m².
        inv_J: their inverses.
        gyro: None to leave −w × J w out.
        quat: attitude, body to world.
        w: angular velocity, body axes, rad/s.
        h: s.

    Returns:
        (quat, w) at the end.
    """
    turn2 = h * h * dot(w, w)
    still = turn2 < STILL_TURN * STILL_TURN
    if every(still):
        return quat, w
    follows = turn2 < (MAX_TURN * MAX_PIECES) ** 2
    n, dt = filled(turn2, 1.0), h + filled(turn2, 0.0)
    if some(turn2 > MAX_TURN * MAX_TURN):
        n = pieces(turn2, follows)
        dt = h / n
    for piece in range(int(largest(n))):
        e = half_turn(J, inv_J, gyro, w, dt)
        quat1, w1 = turn(J, inv_J, quat, w, e)
        on = (piece < n) & no(still)
        quat = where(on, quat1, quat)
        w = where(on, spun(gyro, J, w, w1), w)
    # too fast to follow, or not a number: the caller's check finds it
    return where(follows, quat, (np.nan, np.nan, np.nan, np.nan)), w


@traced
def pieces(turn2, follows):
    """How many pieces a turn is split into, of which this is the square, rad²."""
    n = floor(sqrt(turn2) / MAX_TURN) + 1.0
    return where((turn2 > MAX_TURN * MAX_TURN) & follows, n, 1.0)


@traced
def spun(gyro, J, w, w1):
    """The spin after a turn: w1, which keeps the world's J w, unless −w × J w is left out; then it is w.

    Where that is zero the two differ by rounding: then it is w1 as well, to have the same bits.
    """
    if gyro is None:
        return where((J[0] == J[1]) & (J[1] == J[2]), w1, w)
    return w1


@traced
def half_turn(J, inv_J, gyro, w, h):
    """Half the rotation vector of h seconds: ∫w dt + ½∫∫ w × w dt dt, halved; body axes."""
    e = scale(0.5 * h, w)
    if gyro is None:
        return e
    w_dot = gyroscopic(J, inv_J, w)
    w_dot1 = gyroscopic(J, inv_J, axpy(0.5 * h, w_dot, w))
    w_dot2 = gyroscopic(J, inv_J, axpy(0.5 * h, w_dot1, w))
    s = h * h * (1.0 / 12.0)
    e = axpy(s, add(w_dot, add(w_dot1, w_dot2)), e)
    return axpy(0.5 * h * s, cross(w, w_dot1), e)


@traced
def turn(J, inv_J, quat, w, e):
    """Turn by the rotation vector 2e (body axes, |e| < 0.01), and w so that the world's J w stays."""
    angle2 = dot(e, e)
    c = fma(-angle2, fma(-angle2, 1.0 / 24.0, 1.0 / 2.0), 1.0)
    e = scale(fma(-angle2, fma(-angle2, 1.0 / 120.0, 1.0 / 6.0), 1.0), e)
    # what rounding did to the norm so far is taken back
    n2 = fma(quat[3], quat[3], fma(quat[2], quat[2], fma(quat[1], quat[1], quat[0] * quat[0])))
    fix = fma(-0.5, n2, 1.5)
    quat = product(quat, (fix * c, fix * e[0], fix * e[1], fix * e[2]))
    # L' = L + 2c L×e + 2 (L×e)×e
    t = scale(2.0, cross(times(J, w), e))
    return quat, axpy(1.0, times(inv_J, axpy(c, t, cross(t, e))), w)
