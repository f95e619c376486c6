"""Free flight: a parabola, and a rotation that keeps energy and angular momentum to rounding."""

from math import sqrt

from .algebra import axpy, cross, dot, jit, scale, times, turned

MAX_TURN = 0.25
"""rad; a longer turn is split, so that the iteration below always contracts."""

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
    speed = sqrt(dot(w, w))
    if speed == 0.0:
        return quat, w
    n = int(speed * h / MAX_TURN) + 1
    dt = h / n
    L = times(J, w)

    # Both are constants of the motion, so the adjusted moments are found once.
    C = 0.5 * dot(L, L)
    H = 0.5 * dot(L, w)
    trace_inv = inv_J[0] + inv_J[1] + inv_J[2]
    inv_det = inv_J[0] * inv_J[1] * inv_J[2]
    sixth = (J[0] + J[1] + J[2]) * inv_det / 6.0
    s3 = 1.0 + dt * dt * (sixth * C - trace_inv * H / 3.0)
    d3 = dt * dt * (sixth * H - inv_det * C / 3.0)
    inv_I = (inv_J[0] * s3 + d3, inv_J[1] * s3 + d3, inv_J[2] * s3 + d3)
    I = (1.0 / inv_I[0], 1.0 / inv_I[1], 1.0 / inv_I[2])

    for _ in range(n):
        # I e + ((I₃−I₂)e₂e₃, …) = (1 + |e|²) dt L/2 for the turn's Cayley vector e, by fixed point:
        # it contracts by about |e| an iteration, because |I₃−I₂| ≤ I₁ for any real body.
        y = scale(0.5 * dt, L)
        e = times(inv_I, y)
        for _ in range(MAX_ITERATIONS):
            s = 1.0 + dot(e, e)
            e_next = (
                inv_I[0] * (s * y[0] - (I[2] - I[1]) * e[1] * e[2]),
                inv_I[1] * (s * y[1] - (I[0] - I[2]) * e[2] * e[0]),
                inv_I[2] * (s * y[2] - (I[1] - I[0]) * e[0] * e[1]),
            )
            change = abs(e_next[0] - e[0]) + abs(e_next[1] - e[1]) + abs(e_next[2] - e[2])
            e = e_next
            if change < 1e-17:
                break
        quat = turned(quat, e)
        # The world's L stays: in body axes it turns the other way.
        t = scale(2.0 / (1.0 + dot(e, e)), cross(L, e))
        L = axpy(1.0, axpy(1.0, t, L), cross(t, e))
    return quat, times(inv_J, L)
