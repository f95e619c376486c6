"""Free rotation of a rigid body in closed form: the attitude after any time, at one cost.

After van Zon & Schofield, J. Comput. Phys. 225:145 (2007). Axis 2 has the middle moment, axis 3 is
the one that w goes round. Then, with Jacobi's elliptic functions of u = u0 + p t,

    w1 = a1 cn u,    w2 = ± a2 sn u,    w3 = a3 dn u                       (A1)

The angular momentum L is fixed in world, so the attitude is where L points in the body, plus a turn α
about L. Counted from the plane of L and a body axis i, the reference, α obeys

    dα/dt = (L / J_i) (1 + (2 E J_i − L²) / (L² − L_i²))                   (A2)

an elliptic integral of the third kind, here Carlson's R_J. Three choices keep the digits:

* The reference is that of the axes 1 and 3 from which L stays away, by 45° at least. The parameter n
  of the integral then lies in [−1, 0], where its parts do not cancel.
* The integral runs over p t from 0, not from u0 to u: its addition theorem leaves an arctangent. The
  difference of two integrals would lose the digits of a nearly round body, whose p is small.
* k' = √(1 − m) comes from J3 |J3 − J2| w3² − J1 |J2 − J1| w1² = A² − B² as (A − B)(A + B), amplitudes
  from sums of squares. L² − 2 E J2 by subtraction would lose when a body turns over.
"""

from math import atan, copysign, cos, cosh, floor, hypot, inf, pi, sin, sqrt, tanh

from ..algebra import jit, product, stage, times, to_body, to_world

SEPARATRIX = 1e-30
"""k' below this counts as 0: the body turns over at most once. Else it would do so each 140/p s."""

MAX_SECH = 350.0
"""Larger |u| are cut there on the separatrix, where cn u = sech u, whose square would underflow."""

STEADY = 1e-150
"""Relative, or rad/s: a wobble, or a spin, that is smaller counts as none."""


@stage
def anchor(J, inv_J, quat, w):
    """All that `at` needs, computed once at a flight's start.

    Within rounding of the separatrix, A = B, rounding decides when, and whether, the body turns over:
    that is no better determined by J and w themselves.

    Args:
        J: principal moments of inertia, kg m², in any order.
        inv_J: their inverses.
        quat: attitude, body to world; its norm need not be exact.
        w: angular velocity, body axes, rad/s.

    Returns:
        Tuples of floats, of one type for every body and motion. The start's attitude up to L; the
        frame (first, 2, reference) as a matrix from the body's axes; J, and A1's amplitudes, in it;
        (1 if the reference is axis 3 else 0, L, the largest w·w of the motion); for A1
        (k', 2K, p, u0, sn u0, cn u0); for A2 (its steady rate, sign, factor, n, root, one period's
        integral); the means of `means`.
    """
    quat = unit(quat)
    low, mid, high = sorted_axes(J)
    A = half_separation(J, mid, high, w)
    B = half_separation(J, mid, low, w)
    along = 1.0  # axes 1, 2, 3 by rising moments, or by falling ones
    if A < B:
        A, B = B, A
        low, high = high, low
        along = -1.0
    J1, J2, J3 = pick(J, low), pick(J, mid), pick(J, high)
    w1, w2, w3 = abs(pick(w, low)), pick(w, mid), abs(pick(w, high))
    D32, D31, D21 = abs(J3 - J2), abs(J3 - J1), abs(J2 - J1)
    if not A > 0.0:
        return steady(quat, w)
    ratio = sqrt(J2 * D32 / (J1 * D31))  # a1 / a2
    a1 = hypot(w1, ratio * w2)
    a3 = hypot(w3, sqrt(J2 * D21 / (J3 * D31)) * w2)
    if not (a1 > STEADY * a3 and a1 > STEADY and a3 > STEADY):
        return steady(quat, w)

    m = (J2 - J1) * J1 / ((J3 - J2) * J3) * (a1 / a3) * (a1 / a3)
    kc = min(1.0, sqrt(A - B) * sqrt(A + B) / (sqrt(J3 * D32) * a3))
    if kc < SEPARATRIX:
        kc = 0.0
    p = a3 * sqrt(D32 * D31 / (J1 * J2))
    L1, L3 = J1 * a1, J3 * a3
    L = hypot(L1, L3)
    if L1 > L3:
        n = -m * (L3 / L1) * (L3 / L1)
        rate = L / J1
        way = along
        M = frame(w, low, mid, high)
        J_f, amplitude = (J1, J2, J3), (a1, way * a1 / ratio, a3)
    else:
        n = -(L1 / L3) * (L1 / L3)
        rate = L / J3
        way = -along
        M = frame(w, high, mid, low)
        J_f, amplitude = (J3, J2, J1), (a3, way * a1 / ratio, a1)
    factor = L * D31 * pick(inv_J, low) * pick(inv_J, high) / p * n * (1.0 / 3.0)
    root = sqrt(-n * (1.0 - n) * (m - n))

    w_f = to_world(M, w)
    s0, c0, d0 = w_f[1] / amplitude[1], w1 / a1, w3 / a3
    agm, mean = means(kc)
    period, third = inf, 0.0
    if kc > 0.0:
        period, third = pi / mean, 2.0 * carlson_j(0.0, kc * kc, 1.0, 1.0 - n)
    u0 = s0 * carlson_f(c0 * c0, d0 * d0, 1.0)
    a2, b3 = a1 / ratio, kc * a3
    spin2 = max(a1 * a1 + a3 * a3, a2 * a2 + b3 * b3)

    h = unit(upright(times(J_f, w_f), L))
    b = to_body(M, (-h[1], -h[2], -h[3]))
    start = product(quat, (h[0], b[0], b[1], b[2]))
    about = (1.0 if L1 > L3 else 0.0, L, spin2)
    return (
        start, M, J_f, amplitude, about,
        (kc, period, p, u0, s0, c0), (rate, way, factor, n, root, third), agm,
    )  # fmt: skip


@stage
def at(anchor, t):
    """The free motion t seconds after the anchor's start, A1 and A2 solved.

    Args:
        anchor: from the function `anchor`.
        t: s, of either sign.

    Returns:
        (quat, w): attitude, body to world, of unit norm and without jumps of sign in t; angular
        velocity, body axes, rad/s.
    """
    start, M, J_f, amplitude, about, jacobi, turn, agm = anchor
    first, L, _spin2 = about
    kc, period, p, u0, s0, c0 = jacobi
    rate, way, factor, n, root, third = turn
    if p == 0.0:  # a steady spin `amplitude` at the rate L
        w = amplitude
        s = 0.5 * t if L == 0.0 else sin(0.5 * L * t) / L
        return unit(product(start, (cos(0.5 * L * t), s * w[0], s * w[1], s * w[2]))), w

    # sn and cn of v = p t and of u, and the integral over v: whole periods 2K, and the rest of each
    v, halves, back = folded(p * t, period)
    s, c, d = sncndn(v, kc, agm)
    integral = halves * third
    if factor != 0.0:
        integral += s * s * s * carlson_j(c * c, d * d, 1.0, 1.0 - n * s * s)
    u, u_halves, u_back = folded(u0 + v, period)
    su, cu, du = sncndn(u, kc, agm)
    # the addition theorem's arctangent, Byrd & Friedman 116.03; the second argument is at least 1
    shift = atan(root * s0 * s * (u_back * su) / (1.0 - n + n * c0 * c * (u_back * cu)))
    turned = rate * t + way * (factor * integral - shift)

    sign = back * u_back
    su, cu = sign * su, sign * cu
    if first == 1.0:
        w_f = (amplitude[0] * cu, amplitude[1] * su, amplitude[2] * du)
    else:
        w_f = (amplitude[0] * du, amplitude[1] * su, amplitude[2] * cu)
    h = upright(times(J_f, w_f), L)
    if first == 1.0:
        # L goes once round the reference in 4K; each time the half turn in `upright` changes sign
        around = times_round(halves + u_halves, su)
        h = (around * h[0], around * h[1], around * h[2], around * h[3])
    h = product((cos(0.5 * turned), sin(0.5 * turned), 0.0, 0.0), h)
    b = to_body(M, (h[1], h[2], h[3]))
    return unit(product(start, (h[0], b[0], b[1], b[2]))), to_body(M, w_f)


@stage
def steady(quat, w):
    """The anchor of a spin that stays as it is: a sphere, a principal axis, or none."""
    one = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    spin = hypot(hypot(w[0], w[1]), w[2])
    none = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return quat, one, w, w, (0.0, spin, spin * spin), none, none, means(1.0)[0]


@jit
def unit(quat):
    """A quaternion divided by its norm."""
    w, x, y, z = quat
    s = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return (s * w, s * x, s * y, s * z)


@jit
def pick(a, i):
    """a[i], without the tuple in memory."""
    return a[0] if i == 0 else (a[1] if i == 1 else a[2])


@stage
def sorted_axes(J):
    """The axes of the lowest, the middle and the highest moment."""
    i, j, k = 0, 1, 2
    if pick(J, i) > pick(J, j):
        i, j = j, i
    if pick(J, j) > pick(J, k):
        j, k = k, j
    if pick(J, i) > pick(J, j):
        i, j = j, i
    return i, j, k


@stage
def half_separation(J, mid, i, w):
    """√(J_i |J_i − J_mid|) |w_i|; equal for the lowest and the highest axis on the separatrix."""
    return sqrt(pick(J, i) * abs(pick(J, i) - pick(J, mid))) * abs(pick(w, i))


@stage
def frame(w, i, j, k):
    """Rotation matrix from body axes to the proper frame (±i, ±j, ±k) in which w_i, w_k >= 0."""
    a = copysign(1.0, pick(w, i))
    c = copysign(1.0, pick(w, k))
    b = a * c if (j - i) % 3 == 1 else -a * c
    return (
        a if i == 0 else 0.0, a if i == 1 else 0.0, a if i == 2 else 0.0,
        b if j == 0 else 0.0, b if j == 1 else 0.0, b if j == 2 else 0.0,
        c if k == 0 else 0.0, c if k == 1 else 0.0, c if k == 2 else 0.0,
    )  # fmt: skip


@jit
def upright(L_f, L):
    """A turn (not of unit norm) that takes L to axis `first`: about the reference, then about axis 2.

    Args:
        L_f: angular momentum in the frame (first, 2, reference), farther than 45° from the reference.
        L: its norm.
    """
    x, y, z = L_f
    across = hypot(x, y)
    if x >= 0.0:
        c, s = across + x, -y
    else:  # without a difference; the half turn's cosine stays positive
        c, s = abs(y), -copysign(across - x, y)
    a, b = L + across, z
    return (a * c, b * s, b * c, a * s)


@jit
def folded(u, period):
    """(rest in ±period/2, whole periods, 1 or −1 if they are odd): u less 2K, 4K, ... (DLMF 22.4)."""
    if period == inf:
        return u, 0.0, 1.0
    n = floor(u / period + 0.5)
    return u - n * period, n, 1.0 - 2.0 * odd(n)


@jit
def odd(n):
    """1 for an odd whole number, else 0."""
    return n - 2.0 * floor(0.5 * n)


@jit
def times_round(halves, sn):
    """−1 if u, nearest to `halves` times 2K, is nearest to an odd multiple of 4K, else 1."""
    if odd(halves) == 1.0:
        halves -= copysign(1.0, sn)
    return 1.0 - 2.0 * odd(0.5 * halves)


@stage
def means(kc):
    """Arithmetic and geometric means from (1, k') on, as pairs, and their limit π/(2K) (DLMF 22.20)."""
    a0, g0 = 1.0, kc
    a1, g1 = 0.5 * (a0 + g0), sqrt(a0 * g0)
    a2, g2 = 0.5 * (a1 + g1), sqrt(a1 * g1)
    a3, g3 = 0.5 * (a2 + g2), sqrt(a2 * g2)
    a4, g4 = 0.5 * (a3 + g3), sqrt(a3 * g3)
    a5, g5 = 0.5 * (a4 + g4), sqrt(a4 * g4)
    a6, g6 = 0.5 * (a5 + g5), sqrt(a5 * g5)
    a7, g7 = 0.5 * (a6 + g6), sqrt(a6 * g6)
    a8, g8 = 0.5 * (a7 + g7), sqrt(a7 * g7)
    mean = 0.5 * (a8 + g8)
    return (a0, g0, a1, g1, a2, g2, a3, g3, a4, g4, a5, g5, a6, g6, a7, g7, a8, g8, mean), mean


@jit
def landen(a, c, dn, am, gm):
    """One step down of Bulirsch's recursion."""
    if am == gm:  # nothing changes
        return a, c, dn
    a, c = a * c, c * dn
    dn = (gm + a) / (am + a)
    return c / am, c, dn


@stage
def sncndn(u, kc, agm):
    """(sn, cn, dn) of |u| <= K (Bulirsch, Numer. Math. 7:78, 1965).

    From k' = √(1 − m), so that cn and dn keep their digits near m = 1.

    Args:
        u: argument.
        kc: k'.
        agm: of `means`; unused for k' = 0.
    """
    if kc == 0.0:
        u = max(-MAX_SECH, min(u, MAX_SECH))
        c = 1.0 / cosh(u)
        return tanh(u), c, c
    if abs(u) < 1e-100:
        return u, 1.0, 1.0
    a0, g0, a1, g1, a2, g2, a3, g3, a4, g4, a5, g5, a6, g6, a7, g7, a8, g8, mean = agm
    s = sin(mean * u)
    a = cos(mean * u) / s
    c, dn = mean * a, 1.0
    a, c, dn = landen(a, c, dn, a8, g8)
    a, c, dn = landen(a, c, dn, a7, g7)
    a, c, dn = landen(a, c, dn, a6, g6)
    a, c, dn = landen(a, c, dn, a5, g5)
    a, c, dn = landen(a, c, dn, a4, g4)
    a, c, dn = landen(a, c, dn, a3, g3)
    a, c, dn = landen(a, c, dn, a2, g2)
    a, c, dn = landen(a, c, dn, a1, g1)
    a, c, dn = landen(a, c, dn, a0, g0)
    a = copysign(1.0 / sqrt(1.0 + c * c), s)
    return a, c * a, dn


@stage
def carlson_f(x, y, z):
    """R_F(x, y, z), one of them may be 0 (Carlson, Numer. Algorithms 10:13, 1995; DLMF 19.36.1)."""
    A = (x + y + z) * (1.0 / 3.0)
    X, Y = A - x, A - y
    Q = 90.0 * max(abs(X), abs(Y), abs(A - z))  # (3 eps)^(−1/8)
    f = 1.0
    while Q * f > A:
        rx, ry, rz = sqrt(x), sqrt(y), sqrt(z)
        lam = rx * ry + rx * rz + ry * rz
        x, y, z, A = 0.25 * (x + lam), 0.25 * (y + lam), 0.25 * (z + lam), 0.25 * (A + lam)
        f *= 0.25
    X, Y = X * f / A, Y * f / A
    Z = -X - Y
    E2, E3 = X * Y - Z * Z, X * Y * Z
    series = 1.0 - E2 / 10.0 + E3 / 14.0 + E2 * E2 / 24.0 - 3.0 * E2 * E3 / 44.0
    series += -5.0 * E2 * E2 * E2 / 208.0 + 3.0 * E3 * E3 / 104.0 + E2 * E2 * E3 / 16.0
    return series / sqrt(A)


@stage
def carlson_j(x, y, z, p):
    """R_J(x, y, z, p) for p >= x, y, z, one of these may be 0 (as `carlson_f`; DLMF 19.36.2)."""
    A = (x + y + z + 2.0 * p) * 0.2
    X, Y, Z = A - x, A - y, A - z
    Q = 108.0 * max(abs(X), abs(Y), abs(Z), abs(A - p))  # (eps/4)^(−1/8)
    delta = (p - x) * (p - y) * (p - z)
    f, total = 1.0, 0.0
    while Q * f > A:
        rx, ry, rz, rp = sqrt(x), sqrt(y), sqrt(z), sqrt(p)
        lam = rx * ry + rx * rz + ry * rz
        d = (rp + rx) * (rp + ry) * (rp + rz)
        e = sqrt(delta * f) * f / d  # R_C(1, 1 + e²) = arctan(e)/e
        total += f / d * (atan(e) / e if e > 0.0 else 1.0)
        x, y, z, p = 0.25 * (x + lam), 0.25 * (y + lam), 0.25 * (z + lam), 0.25 * (p + lam)
        A = 0.25 * (A + lam)
        f *= 0.25
    f /= A
    X, Y, Z = X * f, Y * f, Z * f
    P = -0.5 * (X + Y + Z)
    XYZ, P2 = X * Y * Z, P * P
    E2 = X * Y + X * Z + Y * Z - 3.0 * P2
    E3 = XYZ + 2.0 * E2 * P + 4.0 * P2 * P
    E4 = (2.0 * XYZ + E2 * P + 3.0 * P2 * P) * P
    E5 = XYZ * P2
    series = 1.0 - 3.0 * E2 / 14.0 + E3 / 6.0 + 9.0 * E2 * E2 / 88.0 - 3.0 * E4 / 22.0
    series += -9.0 * E2 * E3 / 52.0 + 3.0 * E5 / 26.0 - E2 * E2 * E2 / 16.0 + 3.0 * E3 * E3 / 40.0
    series += 3.0 * E2 * E4 / 20.0 + 45.0 * E2 * E2 * E3 / 272.0 - 9.0 * (E3 * E4 + E2 * E5) / 68.0
    return f * A / (A * sqrt(A)) * series + 6.0 * total
