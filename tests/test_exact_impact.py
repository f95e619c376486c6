"""One frictional impact as a path (Eq. 12): tiny steps, Routh's plane, Garwin's ball, and its laws."""

from math import cos, hypot, inf, nan, pi, sin, sqrt

import numpy as np
import pytest
from numba import njit

from solver.exact.impact import impact


def random_bodies(rng, n):
    """Eq. 10 for n real bodies of mass 1: any principal inertia with J1 + J2 ≥ J3, any arm and axes."""
    spread = rng.uniform(size=(n, 3)) ** rng.choice([1, 3], (n, 1)) * rng.uniform(0.01, 1, (n, 1))
    J = spread.sum(axis=1, keepdims=True) - spread
    q, N, other = rng.normal(size=(3, n, 3))
    N /= np.linalg.norm(N, axis=1, keepdims=True)
    t1 = np.cross(N, other)
    t1 /= np.linalg.norm(t1, axis=1, keepdims=True)
    arms = np.cross(q[:, None], np.stack([N, t1, np.cross(N, t1)], axis=1))
    return np.eye(3) + np.einsum("nia,na,nja->nij", arms, 1 / J, arms)


def random_velocities(rng, n):
    u = rng.normal(size=(n, 3)) * 10 ** rng.uniform(-3, 1, (n, 3))
    u[:, 0] = -np.abs(u[:, 0])
    return u


def six(K):
    return tuple(float(K[i, j]) for i, j in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)])


def struck(K, mu, e, u):
    """`impact` for one 3 x 3 matrix: p as an array."""
    *p, ok = impact(six(np.asarray(K)), float(mu), float(e), tuple(float(x) for x in u))
    assert ok
    return np.array(p)


@njit
def strike_all(K, mu, e, u, p):
    failed = 0
    for i in range(len(mu)):
        k = (K[i, 0, 0], K[i, 0, 1], K[i, 0, 2], K[i, 1, 1], K[i, 1, 2], K[i, 2, 2])
        p[i, 0], p[i, 1], p[i, 2], ok = impact(k, mu[i], e[i], (u[i, 0], u[i, 1], u[i, 2]))
        failed += not ok
    return failed


def energy_change(K, u, p):
    """Kinetic energy after less before, and the part of it before that an impulse there can change."""
    change = (p * (u + 0.5 * np.einsum("nij,nj->ni", K, p))).sum(axis=1)
    return change, 0.5 * (u * np.linalg.solve(K, u[..., None])[..., 0]).sum(axis=1)


def test_no_impact_gains_energy_or_leaves_the_cone():
    rng = np.random.default_rng(0)
    n = 100_000
    K, u = random_bodies(rng, n), random_velocities(rng, n)
    mu = rng.uniform(0, 3, n)
    e = np.clip(rng.uniform(-0.3, 1.3, n), 0, 1)
    p = np.zeros((n, 3))
    assert strike_all(K, mu, e, u, p) == 0
    change, before = energy_change(K, u, p)
    assert (change <= 1e-12 * before).all()
    assert (p[:, 0] > 0).all()
    assert (np.hypot(p[:, 1], p[:, 2]) <= mu * p[:, 0] * (1 + 1e-14)).all()
    after = u + np.einsum("nij,nj->ni", K, p)
    speed = np.linalg.norm(u, axis=1)
    assert (after[:, 0] >= -1e-10 * speed).all()
    assert (np.abs(after[e == 0, 0]) <= 1e-10 * speed[e == 0]).all()
    # All kinds of path are among them.
    slip = np.hypot(after[:, 1], after[:, 2])
    assert 0.1 < (slip <= 1e-12 * speed).mean() < 0.9
    parts = np.abs(K * p[:, None]).sum(axis=(1, 2))
    assert (slip <= 1e-15 * parts).sum() > 0.99 * (slip <= 1e-10 * speed).sum()
    jams = K[:, 0, 0] * np.hypot(u[:, 1], u[:, 2]) <= mu * (K[:, 0, 1:] * u[:, 1:]).sum(axis=1)
    assert jams.sum() > 5000


@njit
def tiny_steps(K, mu, e, v, dp, most):
    """Eq. 12 in explicit steps of dp_n from v, which it changes. How often it compressed; 0: no end."""
    # Without slip: does it stick, else in which of all directions does slip grow along itself?
    det = K[1, 1] * K[2, 2] - K[1, 2] ** 2
    g1 = (K[2, 2] * K[0, 1] - K[1, 2] * K[0, 2]) / det
    g2 = (K[1, 1] * K[0, 2] - K[1, 2] * K[0, 1]) / det
    sticks = hypot(g1, g2) <= mu
    best, c, s = inf, 1.0, 0.0
    for i in range(0 if sticks else 100_000):
        x, y = cos(2 * pi * i / 100_000), sin(2 * pi * i / 100_000)
        a = K[1, 0] - mu * (K[1, 1] * x + K[1, 2] * y)
        b = K[2, 0] - mu * (K[2, 1] * x + K[2, 2] * y)
        if a * x + b * y > 0.0 and abs(b * x - a * y) < best:
            best, c, s = abs(b * x - a * y), x, y
    still = dp * (abs(K[1, 0]) + abs(K[2, 0]) + mu * (K[1, 1] + K[2, 2]))
    store, compressions, closing = 0.0, 1, True
    for _ in range(most):
        r = hypot(v[1], v[2])
        if r > still:
            # the direction half a step on
            m1 = v[1] + dp / 2 * (K[1, 0] - mu * (K[1, 1] * v[1] + K[1, 2] * v[2]) / r)
            m2 = v[2] + dp / 2 * (K[2, 0] - mu * (K[2, 1] * v[1] + K[2, 2] * v[2]) / r)
            r = hypot(m1, m2)
            d1, d2 = -mu * m1 / r, -mu * m2 / r
        elif sticks:  # no slip after the step
            d1 = -g1 - (K[2, 2] * v[1] - K[1, 2] * v[2]) / (det * dp)
            d2 = -g2 - (K[1, 1] * v[2] - K[1, 2] * v[1]) / (det * dp)
        else:
            d1, d2 = -mu * c, -mu * s
        before = v[0]
        for j in range(3):
            v[j] += dp * (K[j, 0] + K[j, 1] * d1 + K[j, 2] * d2)
        work = 0.5 * (before + v[0]) * dp
        store -= work * (e * e if work < 0.0 else 1.0)
        if closing and v[0] >= 0.0:
            closing = False
        elif not closing and v[0] < 0.0:
            closing = True
            compressions += 1
        if not closing and store <= 0.0:
            return compressions
    return 0


def compare_with_tiny_steps(K, mu, e, u, steps=200_000):
    p = struck(K, mu, e, u)
    after = np.array(u, float)
    compressions = tiny_steps(K, mu, e, after, p[0] / steps, 3 * steps)
    assert compressions > 0
    np.testing.assert_allclose(u + K @ p, after, rtol=0, atol=2e-4 * np.linalg.norm(K @ p))
    return compressions, np.array(u) + K @ p


@pytest.mark.parametrize("kind", ["any", "jam", "from rest", "slow", "grips little"])
def test_paths_are_those_of_tiny_steps(kind):
    rng = np.random.default_rng(len(kind))
    sticking = reversing = tried = 0
    for K, u in zip(random_bodies(rng, 2000), random_velocities(rng, 2000), strict=True):
        mu, e = rng.uniform(0.05, 1.5), rng.choice([0.0, rng.uniform(), 1.0])
        if kind == "grips little":  # zero slip cannot hold: it comes back from a stop another way
            mu = rng.uniform(0.2, 0.9) * np.linalg.norm(np.linalg.solve(K[1:, 1:], K[1:, 0]))
            u[1:] *= 0.3 * abs(u[0]) / np.linalg.norm(u[1:])
        if kind == "slow":
            u[1:] *= 1e-3 * abs(u[0]) / np.linalg.norm(u[1:])
        if kind == "from rest":
            u[1:] = 0.0
        if kind == "jam":
            mu = rng.uniform(1.5, 3)
            u[1:] *= 3 * abs(u[0]) / np.linalg.norm(u[1:])
            if K[0, 0] * np.linalg.norm(u[1:]) > mu * K[0, 1:] @ u[1:]:
                continue
        _, after = compare_with_tiny_steps(K, mu, e, u)
        sticking += np.linalg.norm(after[1:]) < 1e-12 * np.linalg.norm(u)
        reversing += after[1:] @ u[1:] < -1e-12 * (u @ u)
        tried += 1
        if tried == 30:
            break
    assert tried == 30
    assert sticking > 2 or kind == "grips little"
    assert reversing > 2 or kind != "grips little"


def test_slip_that_turns_is_integrated_to_rounding():
    """Against scipy's DOP853 at rtol 2.3e-14 in (ln r, φ), with the events between steps of at most 0.25."""
    for *case, expected in [
        (
            (12.6, -0.43, 11.9, 56.6, -77.5, 120.0),
            1.93,
            0.5,
            (-0.5, 0.9, -0.01),
            [0.6027279030749798, -0.8043144114695924, -0.5791402411290476],
        ),
        (
            (9.46, -7.28, -7.93, 18.54, -0.7, 13.47),
            1.2,
            0.6,
            (-1.0, -0.5, 0.3),
            [1.0273263890381594, 0.45324681382989346, 0.6060854517263198],
        ),
        (
            (7.51, -0.57, 5.53, 13.48, 2.13, 6.25),
            0.9,
            0.4,
            (-3.0, 0.2, -1.0),
            [1.1426632274992083, 0.1602930407009359, -0.8406101133011148],
        ),
    ]:
        *p, ok = impact(*case)
        assert ok
        np.testing.assert_allclose(p, expected, rtol=1e-12)


def test_slip_that_turns_can_compress_twice():
    """The direction turns from pushing the point out to jamming it in, while it is already opening."""
    for k, mu, u in [
        ((0.076, -0.162, -0.139, 0.542, 0.29, 0.383), 2.72, [-0.24, 0.9806, 0.196]),
        ((0.065, -0.06, -0.006, 0.141, -0.077, 0.794), 2.45, [-0.0094, -0.0332, -0.9994]),
        ((0.122, -0.291, -0.013, 0.744, 0.038, 0.134), 1.75, [-0.0353, -0.0764, -0.9971]),
        ((0.644, 0.387, 0.078, 0.264, 0.006, 0.092), 2.41, [-0.0218, 0.4341, 0.9009]),
    ]:
        nn, n1, n2, a, b, c = k
        K = np.array([[nn, n1, n2], [n1, a, b], [n2, b, c]])
        for e in (0.8, 0.9, 1.0):
            compressions, _ = compare_with_tiny_steps(K, mu, e, u)
            assert compressions == 2


def test_an_impact_is_the_same_in_other_units_and_axes():
    rng = np.random.default_rng(4)
    for K, u in zip(random_bodies(rng, 100), random_velocities(rng, 100), strict=True):
        mu, e, angle = rng.uniform(0, 2), rng.uniform(), rng.uniform(0, 2 * pi)
        p = struck(K, mu, e, u)
        T = np.eye(3)
        T[1:, 1:] = [[cos(angle), -sin(angle)], [sin(angle), cos(angle)]]
        T[2] *= rng.choice([-1, 1])
        scale = np.linalg.norm(p)
        np.testing.assert_allclose(struck(T @ K @ T.T, mu, e, T @ u), T @ p, rtol=0, atol=1e-8 * scale)
        np.testing.assert_allclose(struck(1e3 * K, mu, e, 1e-5 * u), 1e-8 * p, rtol=0, atol=1e-18 * scale)


def routh(K, mu, e, u):
    """Routh's construction in the plane: (mode, p_n, p_t), by Wang & Mason's (1992) names of the modes."""
    nn, nt, tt = K[0][0], K[0][1], K[1][1]
    u_n, u_t = u[:2]
    sense = np.sign(u_t)
    # The lines of the path: slip, then what follows it
    first = -mu * sense
    stop = u_t / -(nt + tt * first) if u_t * (nt + tt * first) < 0 else (0.0 if u_t == 0 else inf)
    if abs(nt) <= mu * tt:
        after, then = -nt / tt, "sticks"
    else:
        after, then = -mu * np.sign(nt), "reverses"
    D1, D2 = nn + nt * first, nn + nt * after

    def path(p):
        """u_n and the work done at p."""
        if p <= stop:
            return u_n + D1 * p, u_n * p + D1 * p * p / 2
        v, w = u_n + D1 * stop, u_n * stop + D1 * stop * stop / 2
        return v + D2 * (p - stop), w + v * (p - stop) + D2 * (p - stop) ** 2 / 2

    def root(f, low):
        high = low + 1e-3
        while f(high) < 0:
            high = low + 2 * (high - low)
        for _ in range(200):
            middle = (low + high) / 2
            low, high = (low, middle) if f(middle) >= 0 else (middle, high)
        return high

    compressed = root(lambda p: path(p)[0], 0.0)
    most = path(compressed)[1]
    end = root(lambda p: path(p)[1] - (1 - e * e) * most, compressed) if e > 0 else compressed
    mode = "slides" if stop >= end else then + (" in compression" if stop < compressed else " in restitution")
    return mode, end, min(stop, end) * first + max(0.0, end - stop) * after


def rod(theta, mass=1.0, length=1.0):
    """K of a slender rod's end that is down, theta above the ground; it lies along (−cosθ, sinθ)."""
    x, y = length / 2 * cos(theta), -length / 2 * sin(theta)
    J = mass * length**2 / 12
    return np.array(
        [
            [1 / mass + x * x / J, -x * y / J, 0],
            [-x * y / J, 1 / mass + y * y / J, 0],
            [0, 0, 1 / mass],
        ]
    )


def test_a_rod_at_45_degrees_is_rouths_and_never_gains():
    """All μ, e and slip; also with tangents that are not in the plane, where nothing is exactly zero."""
    rng = np.random.default_rng(5)
    K = rod(pi / 4)
    modes = {}
    for mu in [0.0, 0.1, 0.3, 0.59, 0.61, 1.0, 1.66, 1.67, 2.0, 3.0]:
        for e in [0.0, 0.3, 0.7, 1.0]:
            for slip in [-20, -3, -1.0, -0.3, -1e-6, 0.0, 1e-6, 0.3, 1.0, 3.0, 20]:
                u = np.array([-1.0, slip, 0.0])
                p = struck(K, mu, e, u)
                mode, p_n, p_t = routh(K, mu, e, u)
                np.testing.assert_allclose(p, [p_n, p_t, 0.0], rtol=1e-9, atol=1e-9)
                modes[mode] = modes.get(mode, 0) + 1
                change, before = energy_change(K[None], u[None], p[None])
                assert change[0] <= 1e-14 * before[0]
                angle = rng.uniform(0, 2 * pi)
                T = np.eye(3)
                T[1:, 1:] = [[cos(angle), -sin(angle)], [sin(angle), cos(angle)]]
                if slip != 0.0:
                    np.testing.assert_allclose(struck(T @ K @ T.T, mu, e, T @ u), T @ p, atol=1e-8)
    assert set(modes) == {
        "slides",
        "sticks in compression",
        "sticks in restitution",
        "reverses in compression",
        "reverses in restitution",
    }


def test_newtons_law_would_gain_on_the_rod_and_the_path_does_not():
    """Jam: e = 1, u_n falls first. The energy is never more than before, and friction has taken some."""
    K = rod(1.0)
    u = np.array([-1.0, 4.0, 0.0])
    mu = 2.5
    assert K[0, 0] - mu * K[0, 1] < 0
    p = struck(K, mu, 1.0, u)
    after = u + K @ p
    assert after[0] > 1.0  # Newton's e would have said 1
    assert p @ (u + after) < 0
    assert after[1] == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("e", [0.0, 0.6, 1.0])
def test_a_spinning_ball_bounces_as_garwin_says(e):
    """K = diag(1, 7/2, 7/2)/m: P_t = −(2/7) m s where (2/7)|s| ≤ μ(1+e)|v_n|, else −μ P_n."""
    m, mu = 0.3, 0.2
    K = np.diag([1.0, 3.5, 3.5]) / m
    for slip in np.linspace(0, 4, 23):
        for angle in (0.0, 1.0):
            s = slip * np.array([cos(angle), sin(angle)])
            p = struck(K, mu, e, [-1.0, *s])
            P_n = (1 + e) * m
            P_t = min(2 / 7 * m * slip, mu * P_n) * -np.array([cos(angle), sin(angle)])
            np.testing.assert_allclose(p, [P_n, *P_t], rtol=1e-12, atol=1e-13)


def test_without_friction_it_is_eq_8_and_keeps_energy():
    rng = np.random.default_rng(6)
    for K, u in zip(random_bodies(rng, 200), random_velocities(rng, 200), strict=True):
        p = struck(K, 0.0, 1.0, u)
        change, before = energy_change(K[None], u[None], p[None])
        assert abs(change[0]) <= 1e-14 * before[0]
        np.testing.assert_allclose(struck(K, 0.0, 0.3, u), [-1.3 * u[0] / K[0, 0], 0, 0], rtol=1e-15)
        # and friction that vanishes changes nothing
        np.testing.assert_allclose(struck(K, 1e-14, 1.0, u), p, rtol=0, atol=1e-9 * p[0])
    for theta in (0.3, 1.0):  # references.md: P = (1 + e) m |v_n| / (1 + 3 cos²θ)
        p = struck(rod(theta, 2.0), 0.0, 0.5, [-3.0, 1.0, 0.0])
        assert p[0] == pytest.approx(1.5 * 2.0 * 3.0 / (1 + 3 * cos(theta) ** 2))


def test_what_sticks_has_no_slip_and_what_barely_slips_does_as_zero_slip():
    rng = np.random.default_rng(7)
    stuck = 0
    for K in random_bodies(rng, 300):
        mu, e, angle = rng.uniform(0, 2), rng.uniform(), rng.uniform(0, 2 * pi)
        p = struck(K, mu, e, [-1.0, 0.0, 0.0])
        after = K[1:] @ p
        if np.linalg.norm(np.linalg.solve(K[1:, 1:], K[1:, 0])) < mu:
            stuck += 1
            np.testing.assert_allclose(after, 0.0, atol=1e-14 * np.abs(K[1:] * p).sum())
        else:
            assert sqrt(p[1] ** 2 + p[2] ** 2) == pytest.approx(mu * p[0], rel=1e-14)
            assert after @ p[1:] == pytest.approx(-sqrt(after @ after) * mu * p[0], rel=1e-9)
        for slip in (1e-20, 1e-12):
            near = struck(K, mu, e, [-1.0, slip * cos(angle), slip * sin(angle)])
            np.testing.assert_allclose(near, p, rtol=0, atol=1e-9 * p[0])
    assert 50 < stuck < 290


def test_an_open_contact_gets_nothing_and_nonsense_is_not_answered():
    k = six(rod(0.7))
    for u in [(0.0, 1.0, 0.0), (1.0, 1.0, 2.0), (0.0, 0.0, 0.0)]:
        assert impact(k, 0.5, 0.5, u) == (0.0, 0.0, 0.0, True)
    for K, mu, e, u in [
        (k, 0.5, 0.5, (nan, 0.0, 0.0)),
        (k, 0.5, 0.5, (-1.0, nan, 0.0)),
        (k, nan, 0.5, (-1.0, 1.0, 0.0)),
        (k, 0.5, nan, (-1.0, 1.0, 0.0)),
        ((nan, *k[1:]), 0.5, 0.5, (-1.0, 1.0, 0.0)),
        ((1.0, 2.0, 0.0, 1.0, 0.0, 1.0), 3.0, 0.5, (-1.0, 1.0, 0.3)),  # not positive definite
        ((1.0, 1.0, 0.0, 1.0, 0.0, 1.0), 3.0, 0.5, (-1.0, 1.0, 0.0)),
    ]:
        assert impact(K, mu, e, u) == (0.0, 0.0, 0.0, False)
