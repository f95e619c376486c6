"""Method "impulse": laws, closed forms, and its promises about energy, rest and penetration."""

import numpy as np
import pytest
from oracle import random_body, random_quat, rotation, touching, turned

from solver import Body, Plane, Scene, State, simulate

UPRIGHT = [1, 0, 0, 0]
ZERO = [0, 0, 0]


@pytest.mark.parametrize("seed", range(40))
def test_no_impact_creates_energy(seed):
    """40 x 250 = 10,000 impacts: one to four points at once, any slip, μ up to 3, any e."""
    rng = np.random.default_rng(seed)
    kind = seed % 4
    if kind == 0:
        body, quats = random_body(rng), [random_quat(rng) for _ in range(250)]
    else:  # a box on a corner, an edge or a face; a rounded one every other time
        body = Body.box(1.0, rng.uniform(0.2, 2.0, 3), radius=0.05 * (seed % 8 < 4))
        tip = [None, None, turned([1, 0, 0], rng.uniform(0.1, 1.4)), UPRIGHT][kind]
        quats = [random_quat(rng) if tip is None else tip for _ in range(250)]
    scene = Scene(
        body,
        gravity=ZERO,
        friction=rng.uniform(0, 3),
        restitution=rng.choice([0, rng.uniform(), 1]),
    )
    x = np.array([touching(scene, quat) for quat in quats])
    v = rng.normal(size=(250, 3)) - [0, 0, 2]
    w = 3 * rng.normal(size=(250, 3))
    state = State(x, np.array(quats), v, w)
    run = simulate(scene, state, 1e-9, dt=1e-9)
    assert (run.energy[1] <= run.energy[0] * (1 + 1e-12)).all()
    struck = (run.v[1] != run.v[0]).any(axis=1)
    assert struck.mean() > 0.5

    # the impulse is inside the cone and its sum pushes (momentum balance)
    p = body.m * (run.v[1] - run.v[0])[struck]
    assert (p[:, 2] > 0).all()
    assert (np.hypot(p[:, 0], p[:, 1]) <= scene.friction * p[:, 2] * (1 + 1e-9) + 1e-12).all()


def test_no_impact_of_a_million_creates_energy():
    """One point, 100 bodies, 10,000 impacts each; Newton's law by itself would gain in one of a hundred."""
    rng = np.random.default_rng(7)
    n = 10_000
    struck = 0
    for _ in range(100):
        scene = Scene(
            random_body(rng), gravity=ZERO, friction=rng.uniform(0.01, 3), restitution=rng.uniform(0.01, 1)
        )
        quats = rng.normal(size=(n, 4))
        quats /= np.linalg.norm(quats, axis=1, keepdims=True)
        x = np.zeros((n, 3))
        x[:, 2] = -scene.gap(State(x, quats, x, x)).min(axis=1)
        state = State(x, quats, rng.normal(size=(n, 3)) - [0, 0, 2], 3 * rng.normal(size=(n, 3)))
        run = simulate(scene, state, 1e-9, dt=1e-9)
        assert (run.energy[1] <= run.energy[0] * (1 + 1e-12)).all()
        struck += (run.v[1] != run.v[0]).any(axis=1).sum()
    assert struck > 500_000


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_restitution_does_not_stack_over_the_points_of_one_touch(e):
    """The same flat drop on 1, 2, 4 and 12 points rebounds at the same speed, without spin."""
    circle = [(np.cos(a), np.sin(a), -0.5) for a in np.arange(12) * np.pi / 6]
    hulls = {
        1: [(0, 0, -0.5)],
        2: [(1, 0, -0.5), (-1, 0, -0.5)],
        4: [(1, 1, -0.5), (1, -1, -0.5), (-1, 1, -0.5), (-1, -1, -0.5)],
        12: circle,
    }
    for hull in hulls.values():
        scene = Scene(Body(1.0, (0.3, 0.4, 0.5), hull), friction=0.6, restitution=e)
        run = simulate(scene, State([0, 0, 1.5], UPRIGHT, ZERO, ZERO), 0.5, dt=1 / 240)
        t_fall = np.sqrt(2 / 9.81)
        after = run.t > t_fall + 1 / 240
        speed = run.v[after, 2] + 9.81 * (run.t[after] - t_fall)
        np.testing.assert_allclose(speed, e * 9.81 * t_fall if e else 9.81 * (run.t[after] - t_fall),
                                   atol=1e-6)  # fmt: skip
        np.testing.assert_allclose(run.w, 0, atol=1e-6)


def test_a_block_slides_to_a_stop():
    scene = Scene(Body.box(2.0, (1, 1, 0.4)), friction=0.3)
    run = simulate(scene, State([0, 0, 0.2], UPRIGHT, [2, 1, 0], ZERO), 2.0)
    place = 5 / (2 * 0.3 * 9.81)
    assert np.linalg.norm(run.x[-1, :2]) == pytest.approx(place, rel=1e-4)
    np.testing.assert_allclose(run.v[-1], 0, atol=1e-10)


def test_a_sphere_slides_then_rolls():
    """It rolls after 2v/7μg at 12v²/49μg with 5v/7."""
    mu = 0.2
    scene = Scene(Body.sphere(1.0, 0.1), friction=mu)
    run = simulate(scene, State([0, 0, 0.1], UPRIGHT, [1, 0, 0], ZERO), 1.0)
    assert run.v[-1, 0] == pytest.approx(5 / 7, rel=1e-9)
    assert run.w[-1, 1] == pytest.approx(50 / 7, rel=1e-9)
    t_roll, x_roll = 2 / (7 * mu * 9.81), 12 / (49 * mu * 9.81)
    assert run.x[-1, 0] == pytest.approx(x_roll + 5 / 7 * (1 - t_roll), abs=1e-5)


def test_a_slope_holds_below_the_friction_angle_and_slides_above_it():
    theta = 0.4
    normal = [np.sin(theta), 0, np.cos(theta)]
    quat = turned([0, 1, 0], theta)
    body = Body.box(1.0, (1, 1, 0.4))
    x = 0.2 * np.array(normal)
    for mu, a in [(2 * np.tan(theta), 0.0), (0.3, 9.81 * (np.sin(theta) - 0.3 * np.cos(theta)))]:
        scene = Scene(body, Plane(normal), friction=mu)
        run = simulate(scene, State(x, quat, ZERO, ZERO), 1.0)
        assert np.linalg.norm(run.v[-1]) == pytest.approx(a, rel=1e-6, abs=1e-10)
        np.testing.assert_allclose(scene.gap(run.state)[scene.gap(run.state) < 0.1], 0, atol=1e-8)


def test_lossless_bounces_keep_their_energy():
    for body, w in [(Body.sphere(1.0, 0.1), ZERO), (Body.box(1.0, (0.2, 0.3, 0.4)), [1, 2, 3])]:
        scene = Scene(body, restitution=1.0)
        run = simulate(scene, State([0, 0, 1.1], UPRIGHT, ZERO, w), 20.0)
        np.testing.assert_allclose(run.energy, run.energy[0], rtol=1e-11)


def test_a_ball_comes_to_rest_when_it_should():
    e, h = 0.8, 1.0
    scene = Scene(Body.sphere(1.0, 0.1), restitution=e)
    run = simulate(scene, State([0, 0, 0.1 + h], UPRIGHT, ZERO, ZERO), 5.0)
    still = run.t[np.abs(run.v[:, 2]) > 1e-9].max()
    assert still == pytest.approx(np.sqrt(2 * h / 9.81) * (1 + e) / (1 - e), rel=3e-3)
    assert abs(scene.gap(run.state)[0]) <= 1e-6


def test_spinning_bounce_sticks_as_garwin_says():
    """Superball: P_t = −(2/7) m s when (2/7)|s| ≤ μ(1+e)|v_n| (Garwin 1969)."""
    r, vx, w = 0.1, 1.0, 5.0
    scene = Scene(Body.sphere(1.0, r), friction=1.0, restitution=0.7, gravity=ZERO)
    run = simulate(scene, State([0, 0, r], UPRIGHT, [vx, 0, -2], [0, w, 0]), 1e-9, dt=1e-9)
    s = vx - r * w
    np.testing.assert_allclose(run.v[-1], [vx - 2 / 7 * s, 0, 1.4], rtol=1e-12)


@pytest.mark.parametrize("theta", [0.0, 0.15])
def test_the_car_at_rest_stays_at_rest_for_a_minute(theta):
    """Creep under a millimetre, on level ground and on a slope inside its friction cone."""
    from flipcar_env import car

    normal = [0, np.sin(theta), np.cos(theta)]
    scene = Scene(car.body(), Plane(normal), friction=0.8)
    height = car.CENTRE_OF_MASS_HEIGHT
    state = State(height * np.array(normal), turned([1, 0, 0], -theta), ZERO, ZERO)
    run = simulate(scene, state, 60.0, record_every=240)
    assert np.linalg.norm(run.x - run.x[0], axis=1).max() < 1e-6
    assert np.abs(scene.gap(run.state)[:4]).max() <= 1e-6
    np.testing.assert_allclose(run.f[-1, :4].sum(), 1230 * 9.81 * np.cos(theta), rtol=1e-9)


def test_the_frictionless_top_is_second_order_and_keeps_its_constants():
    scene = Scene(Body(1.0, (0.01, 0.01, 0.006), [(0, 0.03, -0.1)]))
    state = State([0, 0, 0.1], UPRIGHT, ZERO, [1, 0.5, 60])
    state = State(state.x, UPRIGHT, [0, 0, -scene.contact(state).v[0]], state.w)
    errors = []
    for hz in (120, 240, 480, 960):
        run = simulate(scene, state, 10.0, dt=1 / hz, record_every=hz // 4)
        errors.append(np.abs(run.energy / run.energy[0] - 1).max())
        assert abs(scene.gap(run.state)[0]) < (1e-12 if hz >= 240 else 1e-10)
        L = scene.angular_momentum(run.state)[2]
        assert L == pytest.approx(scene.angular_momentum(state)[2], rel=1e-12)
        np.testing.assert_allclose(run.v[-1, :2], 0, atol=1e-12)
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders.min() > 1.9, (errors, orders)
    assert errors[1] < 2e-4


def test_the_curved_skid_is_second_order():
    """A spinning off-centre sphere skids along a curve; without the mean slip it is first order."""
    body = Body(1.0, (0.004, 0.004, 0.004), [(0, 0, -0.02)], radius=0.1)
    scene = Scene(body, friction=0.1)
    quat = turned([1, 0, 0], 0.6)
    state = State([0, 0, 0.1 + 0.02 * np.cos(0.6)], quat, [1.0, 0.3, 0], [20, -5, 10])
    state = State(state.x, quat, [1.0, 0.3, -scene.contact(state).v[0]], state.w)
    ends = [simulate(scene, state, 0.25, dt=1 / hz).state for hz in (120, 240, 480, 7680)]
    errors = [np.linalg.norm(np.r_[e.x - ends[-1].x, e.v - ends[-1].v]) for e in ends[:-1]]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders.min() > 1.8, (errors, orders)


@pytest.mark.parametrize("seed", range(12))
def test_a_tossed_box_neither_sinks_nor_gains_energy(seed):
    rng = np.random.default_rng(seed)
    scene = Scene(Body.box(1.0, rng.uniform(0.2, 0.6, 3)), friction=rng.uniform(), restitution=rng.uniform())
    n = 20
    quats = np.array([random_quat(rng) for _ in range(n)])
    state = State(np.tile([0, 0, 1.0], (n, 1)), quats, rng.normal(size=(n, 3)), 5 * rng.normal(size=(n, 3)))
    run = simulate(scene, state, 3.0)
    energy = run.energy / run.energy[0]
    assert np.diff(energy, axis=0).max() <= 1e-6, "energy rose in a step"
    assert (energy - np.minimum.accumulate(energy, axis=0)).max() <= 4e-6, "energy crept up"
    past = State(run.x.reshape(-1, 3), run.quat.reshape(-1, 4), run.v.reshape(-1, 3), run.w.reshape(-1, 3))
    assert scene.gap(past).min() > -2e-7


def test_a_toss_that_comes_to_rest_lies_still():
    scene = Scene(Body.box(1.0, (0.2, 0.3, 0.4)), friction=0.5)
    run = simulate(scene, State([0, 0, 1], UPRIGHT, [1, 0, 0], [1, 2, 3]), 10.0)
    np.testing.assert_allclose(np.r_[run.v[-1], run.w[-1]], 0, atol=1e-9)
    gap = scene.gap(run.state)
    assert (np.abs(np.sort(gap)[:4]) <= 1e-6).all()
    assert run.f[-1].sum() == pytest.approx(9.81, rel=1e-6)


def test_a_shallow_overlap_is_pushed_out_without_adding_speed():
    scene = Scene(Body.box(1.0, (1, 1, 1)))
    run = simulate(scene, State([0, 0, 0.49], UPRIGHT, ZERO, ZERO), 1.0)
    assert run.x[-1, 2] == pytest.approx(0.5, abs=1e-6)
    assert np.abs(run.v).max() < 1e-6


def test_the_plane_may_be_anywhere_and_the_body_in_any_axes():
    """The same toss in turned axes, with a turned J, is the same toss."""
    rng = np.random.default_rng(3)
    box = Body.box(1.0, (0.5, 0.3, 0.2))
    A, B = rotation(random_quat(rng)), random_quat(rng)
    offset = rng.normal(size=3)
    turned_box = Body(1.0, A @ box.J @ A.T, box.hull @ A.T)
    plane = Plane(rotation(B) @ [0, 0, 1], offset)
    kwargs = {"friction": 0.4, "restitution": 0.2}
    first = Scene(box, **kwargs)
    second = Scene(turned_box, plane, gravity=rotation(B) @ [0, 0, -9.81], **kwargs)
    from solver.rotation import from_matrix

    quat, v, w = random_quat(rng), np.array([1.0, 0, -1]), np.array([1.0, 2, -1])
    R = rotation(B)
    other = from_matrix(R @ rotation(quat) @ A.T)
    a = simulate(first, State([0, 0, 0.6], quat, v, w), 0.6)
    b = simulate(second, State(R @ [0, 0, 0.6] + offset, other, R @ v, R @ w), 0.6)
    np.testing.assert_allclose(b.x, a.x @ R.T + offset, atol=1e-6)
