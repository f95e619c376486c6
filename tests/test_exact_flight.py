"""The closed form of free flight follows the true motion to rounding; first touches are never missed."""

from fractions import Fraction
from itertools import permutations
from math import cos, isqrt, pi, sin, sqrt

import numpy as np
import pytest
from oracle import random_quat, rotation

from solver import Body
from solver.exact.attitude import anchor, at
from solver.exact.flight import first_touch, fly, march

BITS = 160
HARD = (1e-3, 2e-3, 2.5e-3)
GROUND = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.0)
DOWN = (0.0, 0.0, -9.81)
NONE = (0.0, 0.0, 0.0)


def fixed(x):
    return round(Fraction(x) * 2**BITS)


def turn_slowly(J, quat, w, t, order=40, piece=0.4):
    """Taylor's series of Euler's equations in short steps, in whole numbers of 160 bits."""
    J = [Fraction(float(Ji)) for Ji in J]
    c = [fixed((J[(i + 1) % 3] - J[(i + 2) % 3]) / J[i]) for i in range(3)]
    n = int(t * np.linalg.norm(w) / piece) + 1
    h = fixed(Fraction(t) / n)
    w, quat = [fixed(float(x)) for x in w], [fixed(float(x)) for x in quat]
    W, Q = np.zeros((3, order + 1), object), np.zeros((4, order + 1), object)
    for _ in range(n):
        W[:, 0], Q[:, 0] = w, quat
        for i in range(order):
            x, y, z = back = W[:, i::-1]
            for j in range(3):
                product = W[(j + 1) % 3, : i + 1] @ back[(j + 2) % 3] >> BITS
                W[j, i + 1] = (product * c[j] >> BITS) * h // (i + 1) >> BITS
            o, a, b, d = Q[:, : i + 1]
            rates = (
                -(a @ x) - (b @ y) - (d @ z),
                o @ x + b @ z - d @ y,
                o @ y + d @ x - a @ z,
                o @ z + a @ y - b @ x,
            )
            for j in range(4):
                Q[j, i + 1] = (rates[j] >> BITS) * h // (2 * (i + 1)) >> BITS
        w, quat = W.sum(1), Q.sum(1)
    norm = isqrt(sum(x * x for x in quat))
    return [(x << BITS) // norm / 2**BITS for x in quat], [x / 2**BITS for x in w]


def begin(J, quat, w):
    J = tuple(float(Ji) for Ji in J)
    return anchor(J, tuple(1 / Ji for Ji in J), tuple(map(float, quat)), tuple(map(float, w)))


def angle(a, b):
    a, b = np.array(a), np.array(b)
    return 2 * min(np.linalg.norm(a - b), np.linalg.norm(a + b))


def product(a, b):
    w, v = a[0] * b[0] - np.dot(a[1:], b[1:]), a[0] * np.array(b[1:]) + b[0] * np.array(a[1:])
    return np.array([w, *(v + np.cross(a[1:], b[1:]))])


def turn_about(axis, turn):
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    return np.array([cos(turn / 2), *(sin(turn / 2) * axis)])


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("J", [(1.0, 2.0, 2.5), (2.0, 2.0, 2.0), (1.0, 1.0, 1.5), (1e-6, 1.0, 1.0)])
def test_a_spin_about_a_principal_axis_is_steady(J, axis):
    quat = random_quat(np.random.default_rng(axis))
    w = np.zeros(3)
    w[axis] = -3.0
    end, w_end = at(begin(J, quat, w), 7.0)
    assert angle(end, product(quat, turn_about(w, 21.0))) < 1e-14
    assert w_end == tuple(w)


def test_at_rest_it_stays():
    quat = random_quat(np.random.default_rng(0))
    end, w = at(begin(HARD, quat, NONE), 1e6)
    np.testing.assert_allclose(end, quat, rtol=1e-15)
    assert w == NONE


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("round_J", "spin_J"), [(1.0, 1.7), (2.0, 0.3), (1.0, 1e-6), (1.0, 1 + 1e-9)])
@pytest.mark.parametrize("w_along", [2.0, 1e-9, 0.0])
def test_a_symmetric_top_precesses(axis, round_J, spin_J, w_along):
    rng = np.random.default_rng(axis)
    quat, w = random_quat(rng), rng.normal(size=3)
    w[axis] = w_along
    J = np.full(3, round_J)
    J[axis] = spin_J
    L = rotation(quat) @ (J * w)
    t = 20.0
    along = np.eye(3)[axis]
    swing = turn_about(along, (1 - spin_J / round_J) * w_along * t)
    true = product(product(turn_about(L, np.linalg.norm(L) / round_J * t), quat), swing)
    end, _w = at(begin(J, quat, w), t)
    assert angle(end, true) < 5e-14


@pytest.mark.parametrize(
    ("J", "w", "t"),
    [
        (HARD, (0.01, 10.0, 0.01), 5.0),
        (HARD, (1e-8, 10.0, 1e-8), 9.0),  # it turns over, after 8.5 s
        (HARD, (-1e-5, -10.0, 1e-5), 5.0),
        ((2.5e-3, 1e-3, 2e-3), (2e-4, 1e-4, 10.0), 4.0),
        ((1.0, 2.0, 3.0), (2 * sqrt(3.0), 1.0, 2.0), 1.5),  # the separatrix, to rounding
        ((1.0, 2.0, 3.0), (-2 * sqrt(3.0), -3.0, 2.0), 1.5),
        ((1.0, 2.0, 2.0 + 1e-8), (1e-9, 5.0, 3.0), 4.0),  # nearly symmetric, spinning across
        ((1.0, 1.0 + 1e-10, 1.0 - 1e-10), (1.0, 2.0, 3.0), 5.0),  # nearly a sphere
        ((1e-6, 1.0, 1.0 + 9e-7), (9.0, 2e-3, 3e-4), 4.0),  # nearly a rod
        ((1.0, 2.0, 3.0), (1e-14, 0.0, -5.0), 4.0),  # nearly steady
        *((J, (0.7, -1.3, 1.1), 9.0) for J in permutations((1.0, 2.0, 2.5))),
    ],
)
def test_hard_motions_follow_a_tiny_step_reference(J, w, t):
    quat = random_quat(np.random.default_rng(1))
    true, w_true = turn_slowly(J, quat, w, t)
    end, w_end = at(begin(J, quat, w), t)
    assert angle(end, true) < 1e-13
    np.testing.assert_allclose(w_end, w_true, atol=1e-13 * np.linalg.norm(w))


def random_moments(rng):
    """Of a real body, in any order; often nearly symmetric, nearly round, or nearly a rod."""
    width = rng.uniform(0.1, 1.0, 3) * 10.0 ** rng.choice([0.0, -1.0, -3.0], 3)
    if rng.random() < 0.4:
        width[0] = width[1] * (1 + rng.choice([0.0, 1e-15, 1e-9, 1e-4]))
    if rng.random() < 0.2:
        width[2] = width[1] * (1 + rng.choice([0.0, 1e-12, 1e-6]))
    return rng.permutation(width.sum() - width)


def random_spin(rng):
    return rng.normal(size=3) * 10.0 ** rng.choice([0, 0, -3, -9, -17], 3) * 10.0 ** rng.uniform(-2, 3)


@pytest.mark.parametrize("seed", range(5))
def test_energy_and_world_momentum_are_kept_and_the_anchor_can_be_moved(seed):
    rng = np.random.default_rng(seed)
    for _ in range(100):
        J, w, quat = random_moments(rng), random_spin(rng), random_quat(rng)
        L, E = rotation(quat) @ (J * w), J @ w**2
        turns = rng.uniform(0, 300)
        t = turns / np.linalg.norm(w)
        start = begin(J, quat, w)
        quat0, w0 = at(start, 0.0)
        assert angle(quat0, quat) < 2e-15
        np.testing.assert_allclose(w0, w, atol=1e-15 * np.linalg.norm(w))
        quat1, w1 = at(start, t)
        assert abs(np.linalg.norm(quat1) - 1) < 5e-16
        assert J @ np.square(w1) == pytest.approx(E, rel=3e-15)
        slip = np.linalg.norm(rotation(quat1) @ (J * w1) - L)
        assert slip < 5e-15 * np.linalg.norm(L)
        # the rest of the motion from there, and the way back
        again, w_again = at(begin(J, quat1, w1), t)
        quat2, w2 = at(start, 2 * t)
        # near the separatrix one rounding of w moves the time at which the body turns over
        loss = 1 + 1e-3 / max(start[5][0], 1e-9) ** 2 if start[5][2] > 0 else 1.0
        stiff = np.linalg.norm(L) / J.min() / np.linalg.norm(w) * 1e-16
        assert angle(again, quat2) < loss * (2e-12 + 1e3 * stiff)
        np.testing.assert_allclose(w_again, w2, atol=loss * (2e-12 + stiff) * np.linalg.norm(w))


def test_re_anchoring_keeps_the_digits_of_a_spin_about_the_middle_axis():
    quat = random_quat(np.random.default_rng(2))
    start = begin(HARD, quat, (1e-8, 10.0, 1e-8))
    middle = at(start, 1.25)
    again = at(begin(HARD, *middle), 50.0)
    true = at(start, 51.25)
    assert angle(again[0], true[0]) < 1e-11
    np.testing.assert_allclose(again[1], true[1], atol=1e-11)


@pytest.mark.parametrize("J", list(permutations((1.0, 2.0, 2.5))))
def test_the_quaternion_never_jumps(J):
    rng = np.random.default_rng(3)
    for _ in range(4):
        w = rng.normal(size=3)
        start = begin(J, random_quat(rng), w)
        quats = np.array([at(start, t)[0] for t in np.linspace(0.0, 60 / np.linalg.norm(w), 400)])
        assert ((quats[1:] * quats[:-1]).sum(1) > 0.99).all()


def kernel(body):
    """(body, hull) as the kernels take them, for a body whose own axes are principal."""
    J = tuple(body.principal_J)
    hull = np.column_stack([body.hull, body.radius])
    return (body.m, 1 / body.m, J, tuple(1 / Ji for Ji in J), body.bounding_radius), hull


def touch(body, hull, start, a, x, v, t_max):
    """(t, k, evaluations), with floats only: each other type would compile another kernel."""
    a, x, v = (tuple(map(float, u)) for u in (a, x, v))
    return march(body, hull, GROUND, start, a, x, v, 0.0, t_max)


def gaps(hull, pose):
    x, quat, _v, _w = pose
    return x[2] + (hull[:, :3] @ rotation(quat).T)[:, 2] - hull[:, 3]


@pytest.mark.parametrize(
    ("speed", "spin", "span"),
    [(0.5, 3.0, 0.6), (3.0, 30.0, 0.2), (0.05, 1000.0, 0.02), (100.0, 1000.0, 0.02)],
)
def test_first_touch_agrees_with_a_dense_scan(speed, spin, span):
    rng = np.random.default_rng(int(spin))
    body, hull = kernel(Body.box(1.0, (1.0, 0.6, 0.4), radius=0.05))
    touches = 0
    for _ in range(8):
        quat = random_quat(rng)
        w = rng.normal(size=3)
        start = begin(body[2], quat, spin * w / np.linalg.norm(w))
        low = -gaps(hull, ((0.0, 0.0, 0.0), quat, None, None)).min()
        x = (0.0, 0.0, low + 0.5 * speed * span * rng.uniform())
        v = (1.0, 2.0, -speed * rng.uniform(-0.5, 1.0))
        t, k, evaluations = touch(body, hull, start, DOWN, x, v, span)
        assert evaluations < 200
        times = np.linspace(0.0, span, 400)[1:]
        inside = [s for s in times if gaps(hull, fly(body, start, DOWN, x, v, s)).min() < 0]
        assert all(s >= t for s in inside)
        if k < 0:
            assert t == span
            continue
        touches += 1
        z = gaps(hull, fly(body, start, DOWN, x, v, t))
        assert z.argmin() == k
        assert abs(z[k]) <= 1.1e-13
        after = gaps(hull, fly(body, start, DOWN, x, v, t + 1e-7))
        assert after[k] < 0
    assert touches >= 3
    assert first_touch(body, hull, GROUND, start, DOWN, x, v, 0.0, span) == (t, k)


def test_a_rod_that_spins_at_1000_rad_per_second_touches_only_if_it_reaches():
    body, hull = kernel(Body.rod(1.0, 2.0))
    for inertia in ((1e-3, 1.0, 1.0), body[2]):
        start = begin(inertia, (1, 0, 0, 0), (0.0, 1000.0, 0.0))
        rod = (*body[:2], inertia, body[3], 1.5)
        # both ends sweep a circle of 1 m; from below 1 m the first to come down touches
        for height, k in ((1 + 1e-11, -1), (1 - 1e-11, 0), (0.5, 0)):
            t, touched, evaluations = touch(rod, hull, start, NONE, (0, 0, height), NONE, 0.1)
            assert touched in ((k, 1) if k == 0 else (k,))
            assert evaluations < 20_000
            if k == 0:
                assert 1000 * t == pytest.approx(np.arcsin(height), abs=1e-9)


@pytest.mark.parametrize("height", [0.999, 0.9, 0.3])
def test_a_fast_point_that_dips_briefly_is_not_missed(height):
    body, hull = kernel(Body(1.0, (0.5, 1.0, 0.8), [(0.0, 0.0, 1.0)]))
    spin, dip = 1000.0, np.arccos(height)  # it is below the surface for 2 dip rad a turn
    for phase in np.append(np.linspace(0.0, pi - dip - 1e-3, 12), [-(pi - dip), -(pi - dip) / 2]):
        quat = (cos(phase / 2), 0.0, sin(phase / 2), 0.0)
        t, k, evaluations = touch(
            body, hull, begin(body[2], quat, (0.0, spin, 0.0)), NONE, (0, 0, height), NONE, 0.1
        )
        assert k == 0
        assert spin * t == pytest.approx(pi - dip - phase, abs=1e-9)
        assert evaluations < 60


def ball():
    body, hull = kernel(Body.sphere(1.0, 0.1))
    return body, hull, begin(body[2], (1, 0, 0, 0), (1.0, 2.0, 3.0))


@pytest.mark.parametrize("up", [1.0, 2e-9, 0.0])
def test_a_point_that_leaves_is_found_when_it_returns(up):
    body, hull, start = ball()
    for gap in (-9e-10, 0.0, 9e-10):
        x, v = (0.0, 0.0, 0.1 + gap), (0.0, 0.0, up)
        t, k, _n = touch(body, hull, start, DOWN, x, v, 10.0)
        if up == 0.0:
            assert (t, k) == (0.0, 0)  # pressed on
        else:
            assert k == 0
            assert 0.1 + gap + t * up - 4.905 * t * t == pytest.approx(0.1, abs=1.1e-9)
            assert t > up / 9.81
        t, k, _n = touch(body, hull, start, (0, 0, 5.0), x, v, 10.0)
        assert (t, k) == (10.0, -1)


@pytest.mark.parametrize(
    ("gap", "down", "first"), [(9e-10, 1e-8, 0.0), (-9e-10, 2.0, 0.0), (1e-8, 1e-3, 1e-5)]
)
def test_a_point_that_closes_touches_at_once_only_within_1e_9(gap, down, first):
    body, hull, start = ball()
    t, k, _n = touch(body, hull, start, NONE, (0, 0, 0.1 + gap), (0, 0, -down), 1.0)
    assert k == 0
    assert t == pytest.approx(first, rel=1e-4)


def test_a_corner_that_leaves_and_one_that_spins_back():
    body, hull = kernel(Body.box(1.0, (2.0, 2.0, 2.0)))
    start = begin(body[2], (1, 0, 0, 0), (0.5, 0.0, 0.0))
    # two corners leave, two close
    t, k, _n = touch(body, hull, start, NONE, (0, 0, 1.0), NONE, 10.0)
    assert t == 0.0
    assert hull[k, 1] < 0
    # lifted as fast as those close, they accelerate away: the next to come down is another edge
    t, k, _n = touch(body, hull, start, NONE, (0, 0, 1.0), (0, 0, 0.5), 10.0)
    assert (t, k) == (10.0, -1)
    t, k, _n = touch(body, hull, start, DOWN, (0, 0, 1.0), (0, 0, 9.0), 10.0)
    turned = rotation(turn_about((1, 0, 0), 0.5 * t))
    assert k >= 0
    assert 1 + 9 * t - 4.905 * t * t + (hull[:, :3] @ turned.T)[:, 2].min() == pytest.approx(0, abs=2e-13)
    assert 1.5 < t < 2.0


@pytest.mark.parametrize("above", [1e-12, 3e-13, 0.0, -1e-12])
def test_grazing_ends_and_is_decided_at_1e_13(above):
    body, hull, start = ball()
    x, v = (0.0, 0.0, 0.1 + 0.25 + above), (0.0, 0.0, -1.0)
    t, k, evaluations = touch(body, hull, start, (0, 0, 2.0), x, v, 5.0)
    assert evaluations < 100
    assert (t, k) == (5.0, -1) if above > 2e-13 else k == 0
    if k == 0:
        assert t == pytest.approx(0.5, abs=2e-6)
    # the same by a corner at the bottom of its swing
    body, hull = kernel(Body.box(1.0, (1.0, 1.0, 1.0)))
    start = begin(body[2], (1, 0, 0, 0), (0.0, 20.0, 0.0))
    height = (0.0, 0.0, sqrt(0.5) + above)
    t, k, evaluations = touch(body, hull, start, NONE, height, NONE, pi / 20)
    assert evaluations < 5000
    assert (k == -1) == (above > 2e-13)


@pytest.mark.parametrize("gap", [0.0, 1e-12, -1e-9])
def test_a_box_that_hovers_on_the_surface_ends(gap):
    body, hull = kernel(Body.box(1.0, (1.0, 1.0, 1.0)))
    start = begin((1.0, 1.0, 1.3), (0.6, 0, 0, 0.8), (0.0, 0.0, 7.0))
    t, k, evaluations = touch(body, hull, start, NONE, (0, 0, 0.5 + gap), NONE, 1.0)
    assert (t, k) == (1.0, -1)
    assert evaluations < 50_000


def test_what_is_not_a_number_ends():
    body, hull, start = ball()
    assert touch(body, hull, start, DOWN, (0, 0, np.nan), NONE, 1.0)[1] == -1
    start = begin(body[2], (1, 0, 0, 0), (np.nan, 0, 0))
    assert touch(body, hull, start, DOWN, (0, 0, 0.1), NONE, 1.0)[1] == -1
