"""One contact with Coulomb friction: the impulse in the cone that meets a target velocity.

    Δu = K p                                                             (10)
    sliding:  p = p_n (N − μ s),  p_n = −b_n / (N·K(N − μ s))            (11)

Components are along (N, t₁, t₂), the contact's own axes.
"""

from .algebra import apart, jit, stage
from .trace import every, filled, least, most, no, some, sqrt, traced, where

MAX_NEWTON = 12
CLOSE = 1e-7
"""Of the tangent; Newton's steps shrink quadratically, so the next would change nothing."""

SCAN = 32
"""Directions tried where Newton finds no slip direction."""
_COS, _SIN = 0.9807852804032304, 0.19509032201612825  # of a turn / SCAN


@traced
def inverse_symmetric(K):
    """Inverse of the symmetric (K_nn, K_n1, K_n2, K_11, K_12, K_22), in the same order."""
    nn, n1, n2, a, b, c = K
    A = a * c - b * b
    B = n2 * b - n1 * c
    C = n1 * b - n2 * a
    s = 1.0 / (nn * A + n1 * B + n2 * C)
    return (A * s, B * s, C * s, (nn * c - n2 * n2) * s, (n1 * n2 - nn * b) * s,
            (nn * a - n1 * n1) * s)  # fmt: skip


@traced
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


@traced
def _slip(K, mu, b_n, r1, r2):
    """If it slips along the first tangent: D, p_n (both Eq. 11), and the slip that leads to."""
    D = K[0] - mu * K[1]
    p_n = -b_n / D
    return D, p_n, r1 + p_n * (K[1] - mu * K[3]), r2 + p_n * (K[2] - mu * K[4])


@traced
def _quartic(K, mu, b_n, r1, r2, s1, s2):
    """The slip across its direction, times D (1 + t²)², as a polynomial of t, and what it is made of.

    It has no division in it; t is the tangent of half the angle from the direction (s1, s2).
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
    return (c0, c1, c2, c3, c4), K, along, across


@traced
def _descend(c, t):
    """One step of Newton's towards a root at which the polynomial falls. (falls, near, t)."""
    slope = c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * 4.0 * c[4]))
    d = (c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * c[4])))) / slope
    return slope < 0.0, abs(d) < CLOSE, t - least(0.5, most(-0.5, d))


@traced
def _direction(K, mu, b_n, along, across, s1, s2, t):
    """The slip direction at t. (is one, p_n, s1, s2)."""
    s = 1.0 / (1.0 + t * t)
    c, s = (1.0 - t * t) * s, 2.0 * t * s
    D, p_n, slip, _across = _slip(_turned(K, c, s), mu, b_n, c * along + s * across, c * across - s * along)
    return (slip >= 0.0) & (D > 0.0), p_n, c * s1 - s * s2, c * s2 + s * s1


@jit
def _newton(K, mu, b_n, r1, r2, s1, s2):
    """Slip direction at which slip is along itself, near a guess. (found, p_n, s1, s2)."""
    c, K, along, across = _quartic(K, mu, b_n, r1, r2, s1, s2)
    t = filled(b_n, 0.0)
    found = filled(b_n, False)
    seeks = filled(b_n, True)
    for _ in range(MAX_NEWTON):
        falls, near, t1 = _descend(c, t)
        seeks = seeks & falls
        t = where(seeks, t1, t)
        found = found | (seeks & near)
        seeks = seeks & no(near)
        if not some(seeks):
            break
    slips, p_n, s1, s2 = _direction(K, mu, b_n, along, across, s1, s2, t)
    return found & slips, p_n, s1, s2


@traced
def _holding(inv_K, b):
    """p = −K⁻¹ b."""
    return (
        -(inv_K[0] * b[0] + inv_K[1] * b[1] + inv_K[2] * b[2]),
        -(inv_K[1] * b[0] + inv_K[3] * b[1] + inv_K[4] * b[2]),
        -(inv_K[2] * b[0] + inv_K[4] * b[1] + inv_K[5] * b[2]),
    )


@jit
def cone_impulse(K, inv_K, mu, b, r, guess, slip, on):
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
        on: whether the result is wanted.

    Returns:
        (p_n, p_1, p_2), N s. Zero if the contact separates by itself (b_n ≥ 0).
    """
    p, frictionless, done = _unslipping(K, inv_K, mu, b, slip)
    done = done | no(on)
    if mu is None or every(done):
        return p
    # Slip is sought where it was, then where it is measured from, then against the holding impulse.
    r1, r2 = r
    found, p_n, s1, s2 = _newton(K, mu, b[0], r1, r2, *_unit(-guess[0], -guess[1]))
    if some(no(found | done)):
        found, p_n, s1, s2 = _slide(K, mu, b[0], r1, r2, p[1], p[2], found, p_n, s1, s2)
    return _sliding(mu, done, p, frictionless, found, p_n, s1, s2)


@traced
def _unslipping(K, inv_K, mu, b, slip):
    """The impulse if it separates or sticks, that without friction, and whether it does either."""
    parts = b[0] >= 0.0
    frictionless = -b[0] / K[0]
    if mu is None:
        return (where(parts, 0.0, frictionless), 0.0, 0.0), frictionless, True
    p = _holding(inv_K, b)
    works = p[1] * slip[0] + p[2] * slip[1] > 0.0
    p = where(works, _holding(inv_K, (b[0], b[1] + slip[0], b[2] + slip[1])), p)
    smooth = mu == 0.0
    p = where(smooth, (frictionless, 0.0, 0.0), p)
    sticks = (p[0] >= 0.0) & (p[1] * p[1] + p[2] * p[2] <= mu * mu * p[0] * p[0])
    return where(parts, (0.0, 0.0, 0.0), p), frictionless, parts | smooth | sticks


@traced
def _unit(a, b):
    """A direction; not a number where there is none."""
    n = sqrt(a * a + b * b)
    return a / n, b / n


@traced
def _sliding(mu, done, p, frictionless, found, p_n, s1, s2):
    """p where it is done, else the impulse against the slip.

    Where no slip direction is consistent, it pushes and leaves the slip to the next sweep.
    """
    against = where(found, (p_n, -mu * p_n * s1, -mu * p_n * s2), (frictionless, 0.0, 0.0))
    return where(done, p, against)


@stage
def _slide(K, mu, b_n, r1, r2, p_1, p_2, found, p_n, s1, s2):
    """Slip direction without a good guess, where none is found yet. (found, p_n, s1, s2)."""
    apart()
    slide = _newton(K, mu, b_n, r1, r2, *_unit(r1, r2))
    found, p_n, s1, s2 = where(found, (found, p_n, s1, s2), slide)
    if every(found):
        return found, p_n, s1, s2
    slide = _newton(K, mu, b_n, r1, r2, *_unit(-p_1, -p_2))
    found, p_n, s1, s2 = where(found, (found, p_n, s1, s2), slide)
    if every(found):
        return found, p_n, s1, s2
    return where(found, (found, p_n, s1, s2), _scan(K, mu, b_n, r1, r2))


@traced
def _aligned(K, mu, b_n, r1, r2, s1, s2):
    """How nearly slip along a direction is along itself: a cosine; −2 if it can't push so."""
    D, _p, along, across = _slip(_turned(K, s1, s2), mu, b_n, r1 * s1 + r2 * s2, r2 * s1 - r1 * s2)
    n = sqrt(along * along + across * across)
    return where((D > 0.0) & (n > 0.0), along / n, -2.0)


@stage
def _scan(K, mu, b_n, r1, r2):
    """Newton from the best of many directions: slip most nearly along itself, denominator positive."""
    apart()
    best = filled(b_n, -2.0)
    best1, best2 = filled(b_n, 1.0), filled(b_n, 0.0)
    s1, s2 = 1.0, 0.0
    for _ in range(SCAN):
        cosine = _aligned(K, mu, b_n, r1, r2, s1, s2)
        better = cosine > best
        best = where(better, cosine, best)
        best1 = where(better, s1, best1)
        best2 = where(better, s2, best2)
        s1, s2 = _COS * s1 - _SIN * s2, _COS * s2 + _SIN * s1
    found, p_n, s1, s2 = _newton(K, mu, b_n, r1, r2, best1, best2)
    return found & (best > -2.0), p_n, s1, s2
