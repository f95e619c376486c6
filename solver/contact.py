"""The single contact of the article: one point of a rigid body touches the ground, without friction.

    m ẍ = m g + F_ext + f N                      (1)
    J ẇ = τ − w × J w + q × (f N)                (2)
    W a + c = 0                                  (5)
    G f + l = 0                                  (6)

    f = −l / G,  and f < 0 would pull: then the contact is off, f = 0       (7)
    i = −(1 + e) v / G,  when v < 0                                        (8)

The numbers are those of `scene.py`'s docstring. Scalars (G, l, v, f, i) are the same in every frame.
Vectors here are taken in the body's principal axes, in which J is diagonal and constant: `N`, `q`,
`w`, and so on stand for Rᵀ times their world-frame namesakes.
"""

from .algebra import axpy, cross, dot, scale, times
from .trace import most, traced


@traced
def gyroscopic(J, inv_J, w):
    """ẇ = −J⁻¹ (w × J w): what the spin does to itself (the free part of Eq. 2, Euler's), rad/s²."""
    return (
        (J[1] - J[2]) * inv_J[0] * (w[1] * w[2]),
        (J[2] - J[0]) * inv_J[1] * (w[2] * w[0]),
        (J[0] - J[1]) * inv_J[2] * (w[0] * w[1]),
    )


@traced
def centripetal(w, w_dot, b, q):
    """w × (w × b) + ẇ × q: how the contact point accelerates because the body turns (Eq. 5's c), m/s².

    b runs from x to the hull point, q from x to the contact point; they differ by the hull point's
    radius along N, which does not turn with the body.
    """
    return axpy(1.0, cross(w, cross(w, b)), cross(w_dot, q))


@traced
def inverse_mass(inv_m, inv_J, N, q):
    """G = 1/m + (q×N)·J⁻¹(q×N): acceleration along N at the contact per unit of f (Eq. 6), 1/kg."""
    a = cross(q, N)
    return inv_m + dot(a, times(inv_J, a))


@traced
def free_acceleration(N, b, q, a_free, w_dot_free, w):
    """l: acceleration of r1 relative to the ground along N if there were no contact force (Eq. 6), m/s².

    Args:
        N: unit normal of the ground.
        b: from x to the hull point, m.
        q: from x to the contact point, m.
        a_free: g + F_ext/m, m/s².
        w_dot_free: J⁻¹(τ − w × J w), rad/s².
        w: angular velocity, rad/s.
    """
    return dot(N, axpy(1.0, a_free, centripetal(w, w_dot_free, b, q)))


@traced
def normal_speed(N, q, v_com, w):
    """v = N·(ẋ + w × q): velocity of r1 relative to the ground along N, negative when closing, m/s."""
    return dot(N, axpy(1.0, v_com, cross(w, q)))


@traced
def force(G, l):
    """f = −l/G, or 0 if that would pull (Eq. 7), N."""
    return most(0.0, -l / G)


@traced
def impulse(G, v, e):
    """i = −(1 + e) v/G if the contact is closing, else 0 (Eq. 8), N s."""
    return most(0.0, -(1.0 + e) * v / G)


@traced
def push(inv_m, inv_J, q, p, v_com, w):
    """The velocities after an impulse p (N s) at the contact: Eqs. 1 and 2, integrated over the blow."""
    return axpy(inv_m, p, v_com), axpy(1.0, times(inv_J, cross(q, p)), w)


@traced
def shift(inv_m, inv_J, N, q, G, gap):
    """Lift along N (m) and turn (rad), along M⁻¹Wᵀ, that close a gap of φ: Eq. 8 for the position."""
    lam = -gap / G
    return lam * inv_m, scale(lam, times(inv_J, cross(q, N)))
