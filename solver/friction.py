"""One contact with Coulomb friction: the impulse in the cone that meets a target velocity.

    Δu = K p                                                             (10)
    sliding:  p = p_n (N − μ s),  p_n = −b_n / (N·K(N − μ s))            (11)

Components are along (N, t₁, t₂), the contact's own axes.
"""

from math import sqrt

from .algebra import jit, stage

MAX_NEWTON = 12
CLOSE = 1e-7
"""Of the tangent; Newton's steps shrink quadratically, so the next would change nothing."""

SCAN = 32
"""Directions tried where Newton finds no slip direction."""
_COS, _SIN = 0.9807852804032304, 0.19509032201612825  # of a turn / SCAN


@jit
def inverse_symmetric(K):
    """Inverse of the symmetric (K_nn, K_n1, K_n2, K_11, K_12, K_22), in the same order."""
    nn, n1, n2, a, b, c = K
    A = a * c - b * b
    B = n2 * b - n1 * c
    C = n1 * b - n2 * a
    s = 1.0 / (nn * A + n1 * B + n2 * C)
    return (A * s, B * s, C * s, (nn * c - n2 * n2) * s, (n1 * n2 - nn * b) * s,
            (nn * a - n1 * n1) * s)  # fmt: skip


@jit
def _turned(K, s1, s2):
    """K with the tangents turned, so that (s1, s2) is the first of them."""
    cc, cs, ss = s1 * s1, s1 * s2, s2 * s2
    return (
        K[0],
        K[1] * s1 + K[2] * s2,
        K[2] * s1 - K[1] * s2,
        K[3] * cc + 2.0 * K[4] * cs + K[5] * ss,
        (K[5] - K[3]) * cs + K[4] * (cc - ss),
        K[3] * ss - 2.0 * K[4] * cs + K[5] * cc,
    )


@jit
def _slip(K, mu, b_n, r1, r2):
    """If it slips along the first tangent: D, p_n (both Eq. 11), and the slip that leads to."""
    D = K[0] - mu * K[1]
    p_n = -b_n / D
    return D, p_n, r1 + p_n * (K[1] - mu * K[3]), r2 + p_n * (K[2] - mu * K[4])


@jit
def _newton(K, mu, b_n, r1, r2, s1, s2):
    """Slip direction at which slip is along itself, near a guess. (found, p_n, s1, s2).

    The slip across its direction, times D, has no division in it. Written with the tangent t of half
    the angle from the guess, it is a polynomial of fourth degree over (1 + t²)².
    """
    K = _turned(K, s1, s2)
    along, across = r1 * s1 + r2 * s2, r2 * s1 - r1 * s2
    n1, n2 = K[1], K[2]
    # D (1 + t²), the part of the slip that friction does not change, and what friction adds
    d0, d1, d2 = K[0] - mu * n1, -2.0 * mu * n2, K[0] + mu * n1
    difference, mixed = mu * (K[5] - K[3]), mu * K[4]
    c0 = d0 * across - b_n * (n2 - mixed)
    c1 = d1 * across - 2.0 * d0 * along + 2.0 * b_n * (n1 + difference)
    c2 = (d2 - d0) * across - 2.0 * d1 * along - 6.0 * b_n * mixed
    c3 = -d1 * across - 2.0 * d2 * along + 2.0 * b_n * (n1 - difference)
    c4 = -d2 * across + b_n * (n2 + mixed)
    t = 0.0
    for _ in range(MAX_NEWTON):
        slope = c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * 4.0 * c4))
        if not slope < 0.0:
            return False, 0.0, s1, s2
        d = (c0 + t * (c1 + t * (c2 + t * (c3 + t * c4)))) / slope
        t -= min(0.5, max(-0.5, d))
        if abs(d) < CLOSE:
            s = 1.0 / (1.0 + t * t)
            c, s = (1.0 - t * t) * s, 2.0 * t * s
            D, p_n, slip, _across = _slip(
                _turned(K, c, s), mu, b_n, c * along + s * across, c * across - s * along
            )
            return slip >= 0.0 and D > 0.0, p_n, c * s1 - s * s2, c * s2 + s * s1
    return False, 0.0, s1, s2


@jit
def _holding(inv_K, b):
    """p = −K⁻¹ b."""
    return (
        -(inv_K[0] * b[0] + inv_K[1] * b[1] + inv_K[2] * b[2]),
        -(inv_K[1] * b[0] + inv_K[3] * b[1] + inv_K[4] * b[2]),
        -(inv_K[2] * b[0] + inv_K[4] * b[1] + inv_K[5] * b[2]),
    )


@jit
def cone_impulse(K, inv_K, mu, b, r, guess, slip):
    """Impulse p at one contact such that u = u_free + K p meets the target, inside the friction cone.

    It sticks (all three components on target) while |p_t| ≤ μ p_n. Otherwise it slides: the normal
    component is on target and friction points against the slip s, s ∥ r + K_t p. With r = u_free's
    tangent part plus the slip before the impulse, s is the mean of the slip before and after (second
    order in time); with u_free's alone it is the slip after (never gains energy at e = 0).

    Args:
        K: (nn, n1, n2, 11, 12, 22), 1/kg (Eq. 10).
        inv_K: its inverse.
        mu: friction coefficient; None: left out.
        b: (3,) u_free − target, m/s.
        r: (2,) what the slip direction is measured from, m/s.
        guess: (2,) tangential impulse against which it may slip; (0, 0) if not known.
        slip: (2,) twice the mean slip over the step if it holds, m/s. Where friction would push along
            that, it would do work: then the contact holds on average, without any mean slip. (0, 0)
            for a blow, which has no duration.

    Returns:
        (p_n, p_1, p_2), N s. Zero if the contact separates by itself (b_n ≥ 0).
    """
    if b[0] >= 0.0:
        return 0.0, 0.0, 0.0
    frictionless = -b[0] / K[0]
    if mu is None or mu == 0.0:
        return frictionless, 0.0, 0.0
    p_n, p_1, p_2 = _holding(inv_K, b)
    if p_1 * slip[0] + p_2 * slip[1] > 0.0:
        p_n, p_1, p_2 = _holding(inv_K, (b[0], b[1] + slip[0], b[2] + slip[1]))
    if p_n >= 0.0 and p_1 * p_1 + p_2 * p_2 <= mu * mu * p_n * p_n:
        return p_n, p_1, p_2

    # Slip is sought where it was, then where it is measured from, then against the holding impulse.
    found = False
    r1, r2 = r
    n = sqrt(guess[0] * guess[0] + guess[1] * guess[1])
    if n > 0.0:
        found, p_n, s1, s2 = _newton(K, mu, b[0], r1, r2, -guess[0] / n, -guess[1] / n)
    if not found:
        found, p_n, s1, s2 = _slide(K, mu, b[0], r1, r2, p_1, p_2)
    if not found:  # no slip direction is consistent: push, and leave the slip to the next sweep
        return frictionless, 0.0, 0.0
    return p_n, -mu * p_n * s1, -mu * p_n * s2


@stage
def _slide(K, mu, b_n, r1, r2, p_1, p_2):
    """Slip direction without a good guess. (found, p_n, s1, s2)."""
    n = sqrt(r1 * r1 + r2 * r2)
    if n > 0.0:
        found, p_n, s1, s2 = _newton(K, mu, b_n, r1, r2, r1 / n, r2 / n)
        if found:
            return found, p_n, s1, s2
    n = sqrt(p_1 * p_1 + p_2 * p_2)
    if n > 0.0:
        found, p_n, s1, s2 = _newton(K, mu, b_n, r1, r2, -p_1 / n, -p_2 / n)
        if found:
            return found, p_n, s1, s2
    return _scan(K, mu, b_n, r1, r2)


@stage
def _scan(K, mu, b_n, r1, r2):
    """Newton from the best of many directions: slip most nearly along itself, denominator positive."""
    best = -2.0
    best1, best2 = 1.0, 0.0
    s1, s2 = 1.0, 0.0
    for _ in range(SCAN):
        D, _p, along, across = _slip(_turned(K, s1, s2), mu, b_n, r1 * s1 + r2 * s2, r2 * s1 - r1 * s2)
        n = sqrt(along * along + across * across)
        if D > 0.0 and n > 0.0 and along / n > best:
            best = along / n
            best1, best2 = s1, s2
        s1, s2 = _COS * s1 - _SIN * s2, _COS * s2 + _SIN * s1
    if best == -2.0:
        return False, 0.0, 1.0, 0.0
    return _newton(K, mu, b_n, r1, r2, best1, best2)
