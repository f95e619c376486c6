"""Method "exact" on problems whose answer is known; dt is but the recording interval."""

from math import asin, cos, sqrt

import numpy as np
import pytest
from oracle import random_body, random_quat, rotation, touching, turned
from scipy.integrate import solve_ivp

from solver import Body, HeightField, Plane, Scene, SolverError, State, simulate
from solver.painleve import critical_friction

ZERO, UPRIGHT = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]


def states(run):
    return State(run.x, run.quat, run.v, run.w)


def angle(a, b):
    """Between two attitudes, rad."""
    return 4 * asin(min(1.0, min(np.linalg.norm(a - b), np.linalg.norm(a + b)) / 2))


@pytest.mark.parametrize("seed", [1e-2, 1e-5, 1e-8])
def test_a_free_spin_does_not_depend_on_how_often_it_is_recorded(seed):
    """A minute of turning over; its attitude against the closed form is in test_exact_flight.py."""
    scene = Scene(Body(1.0, (1e-3, 2e-3, 2.5e-3), [(0, 0, 0.1)]), gravity=ZERO)
    state = State([0, 0, 5.0], UPRIGHT, ZERO, [seed, 10.0, seed])
    often = simulate(scene, state, 60.0, dt=1 / 60, method="exact")
    once = simulate(scene, state, 60.0, dt=60.0, method="exact")
    assert angle(often.state.quat, once.state.quat) < 1e-11
    np.testing.assert_allclose(often.energy, often.energy[0], rtol=1e-14)


def test_the_frictionless_top_keeps_its_constants():
    scene = Scene(Body(1.0, (0.01, 0.01, 0.006), [(0, 0.03, -0.1)]))
    state = State([0, 0, 0.1], UPRIGHT, ZERO, [1, 0.5, 60])
    state = State(state.x, UPRIGHT, [0, 0, -scene.contact(state).v[0]], state.w)
    run = simulate(scene, state, 10.0, dt=1 / 24, method="exact")
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=1e-12)
    np.testing.assert_allclose(run.v[:, :2], 0, atol=1e-12)
    L = scene.angular_momentum(states(run))[:, 2]
    np.testing.assert_allclose(L, L[0], rtol=1e-12)
    assert np.abs(scene.gap(states(run))).max() < 1e-14


def skid(t, y, mu, m, J, off, radius):
    """Eqs. 1, 2, 5 and 11 in world axes, for a sphere whose centre of mass is off its centre."""
    quat, v, w = y[3:7] / np.linalg.norm(y[3:7]), y[7:10], y[10:13]
    N, b = np.array([0, 0, 1.0]), rotation(quat) @ [0, 0, -off]
    q = b - radius * N
    slip = v + np.cross(w, q)
    slip[2] = 0.0
    direction = N - mu * slip / np.linalg.norm(slip)
    l = -9.81 + np.cross(w, np.cross(w, b))[2]
    f = -l / (1 / m + np.cross(q, direction) @ np.cross(q, N) / J)
    e = np.concatenate([[0], w])
    spin = 0.5 * np.array(
        [
            -e[1:] @ quat[1:],
            *(quat[0] * w + np.cross(w, quat[1:])),
        ]
    )
    return np.concatenate([v, spin, [0, 0, -9.81] + f * direction / m, f * np.cross(q, direction) / J])


@pytest.mark.parametrize(("method", "allowed"), [("exact", 1e-10), ("impulse", 1e-3)])
def test_the_curved_skid_agrees_with_an_independent_integration(method, allowed):
    m, J, off, radius, mu = 1.0, 0.004, 0.02, 0.1, 0.1
    scene = Scene(Body(m, (J, J, J), [(0, 0, -off)], radius=radius), friction=mu)
    quat, w = turned([1, 0, 0], 0.6), np.array([20, -5, 10.0])
    q = rotation(quat) @ [0, 0, -off] - [0, 0, radius]
    state = State([0, 0, radius + off * cos(0.6)], quat, [1.0, 0.3, -np.cross(w, q)[2]], w)
    start = np.concatenate([state.x, state.quat, state.v, state.w])
    args = (mu, m, J, off, radius)
    answer = solve_ivp(skid, (0, 0.5), start, "DOP853", args=args, rtol=1e-13, atol=1e-13).y[:, -1]
    end = simulate(scene, state, 0.5, method=method).state
    for mine, theirs in zip((end.x, end.v, end.w), (answer[:3], answer[7:10], answer[10:]), strict=True):
        assert np.linalg.norm(mine - theirs) < allowed * max(1.0, np.linalg.norm(theirs))
    assert angle(end.quat, answer[3:7]) < allowed


@pytest.mark.parametrize(
    ("body", "w"), [(Body.sphere(1.0, 0.1), ZERO), (Body.box(1.0, (0.2, 0.3, 0.4)), [3.0, 2.0, 1.0])]
)
def test_lossless_bounces_keep_the_energy(body, w):
    scene = Scene(body, restitution=1.0)
    run = simulate(scene, State([0, 0, 1.1], UPRIGHT, ZERO, w), 20.0, dt=0.1, method="exact")
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=1e-12)


def test_a_bouncing_ball_comes_to_rest_when_it_should():
    """After √(2h/g)(1 + e)/(1 − e), and infinitely many bounces."""
    e, h = 0.8, 1.0
    scene = Scene(Body.sphere(1.0, 0.1), restitution=e)
    rest = sqrt(2 * h / 9.81) * (1 + e) / (1 - e)
    start = State([0, 0, h + 0.1], UPRIGHT, ZERO, ZERO)
    before = simulate(scene, start, rest * (1 - 1e-10), dt=1.0, method="exact").state
    after = simulate(scene, start, rest * (1 + 1e-10), dt=1.0, method="exact").state
    assert before.v[2] != 0.0
    assert after.v[2] == 0.0


def test_a_block_slides_to_a_stop():
    mu, v = 0.3, 2.0
    scene = Scene(Body.box(1.0, (0.2, 0.2, 0.1)), friction=mu)
    run = simulate(scene, State([0, 0, 0.05], UPRIGHT, [v, 0, 0], ZERO), 1.0, dt=0.1, method="exact")
    assert run.x[-1, 0] == pytest.approx(v**2 / (2 * mu * 9.81), abs=1e-10)
    assert not run.v[-1].any()
    stop = v / (mu * 9.81)
    late = simulate(scene, State([0, 0, 0.05], UPRIGHT, [v, 0, 0], ZERO), stop - 1e-9, dt=1.0, method="exact")
    assert late.state.v[0] == pytest.approx(mu * 9.81 * 1e-9, rel=1e-3)
    np.testing.assert_allclose(run.f[-1].sum(), 9.81, rtol=1e-12)


def test_a_sphere_slides_then_rolls():
    mu, v = 0.2, 2.0
    scene = Scene(Body.sphere(1.0, 0.1), friction=mu)
    run = simulate(scene, State([0, 0, 0.1], UPRIGHT, [v, 0, 0], ZERO), 2.0, dt=0.1, method="exact")
    t, x = 2 * v / (7 * mu * 9.81), 12 * v**2 / (49 * mu * 9.81)
    assert run.v[-1, 0] == pytest.approx(5 * v / 7, abs=1e-12)
    assert run.x[-1, 0] == pytest.approx(x + 5 * v / 7 * (2 - t), abs=1e-10)


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_a_slope_inside_the_friction_cone_does_not_creep_at_all(share):
    """However near to the friction angle: beyond 5/6 of it points cannot all take the same friction."""
    mu = 0.5
    theta = np.arctan(share * mu)
    normal = np.array([np.sin(theta), 0, np.cos(theta)])
    scene = Scene(Body.box(1.0, (1, 1, 0.4)), Plane(normal), friction=mu)
    run = simulate(scene, State(0.2 * normal, turned([0, 1, 0], theta), ZERO, ZERO), 60.0, 0.1, "exact")
    assert not run.v.any()
    assert not np.diff(run.x[1:], axis=0).any()


def test_housners_block():
    """Time of the first impact by quadrature; energy ratio (1 − 1.5 sin²α)² at each (Housner 1963)."""
    b, h, y = 0.1, 0.3, [0.0, 1.0, 0.0]
    R, alpha = np.hypot(b, h), np.arctan2(b, h)
    p2, tilt = 0.75 * 9.81 / R, 0.5 * alpha
    nodes, weights = np.polynomial.legendre.leggauss(40)
    s = 0.5 * np.sqrt(tilt) * (nodes + 1)
    speed = np.sqrt(2 * p2 * np.sin(alpha - tilt + s**2 / 2) * np.sinc(s**2 / 2 / np.pi))
    quarter = 0.5 * np.sqrt(tilt) * (weights * 2 / speed).sum()
    scene = Scene(Body.box(1.0, (2 * b, 0.2, 2 * h)), friction=5.0)
    state = State(-rotation(turned(y, tilt)) @ [b, 0, -h], turned(y, tilt), ZERO, ZERO)
    before = simulate(scene, state, quarter * (1 - 1e-9), dt=1.0, method="exact").state
    after = simulate(scene, state, quarter * (1 + 1e-9), dt=1.0, method="exact").state
    ratio = 1 - 1.5 * np.sin(alpha) ** 2
    assert after.w[1] / before.w[1] == pytest.approx(ratio, abs=1e-9)
    run = simulate(scene, state, 4.0, dt=0.01, method="exact")
    energy = run.energy - 9.81 * h
    # later ones follow each other faster than the records
    levels = energy[np.flatnonzero(np.diff(energy) < -1e-3 * energy[0])] / energy[0]
    np.testing.assert_allclose(levels, ratio ** (2.0 * np.arange(len(levels))), rtol=1e-9)
    assert len(levels) > 10
    assert not run.v[-1].any()  # at rest, after infinitely many


def test_the_tippe_top_turns_over_in_time():
    """Integrated twice as finely it crosses the horizontal at the same time; Jellett's integral is kept."""
    R, m, off, tilt = 0.02, 0.02, 0.3 * 0.02, 0.5
    J = 0.4 * m * R**2
    scene = Scene(Body(m, (J, J, J), [(0, 0, off)], radius=R), friction=0.05)
    quat = turned([1, 0, 0], tilt)
    up = rotation(quat) @ [0, 0, 1]
    run = simulate(scene, State([0, 0, R - off * up[2]], quat, ZERO, 100 * up), 5.0, dt=1e-3, method="exact")
    axis = np.array([rotation(q) @ [0, 0, 1] for q in run.quat])
    jellett = (J * run.w * (off * axis - [0, 0, R])).sum(axis=1)
    np.testing.assert_allclose(jellett, jellett[0], rtol=1e-11)
    k = np.argmax(axis[:, 2] < 0)
    height, fall = axis[k, 2], np.cross(run.w[k], axis[k])[2]
    assert run.t[k] - height / fall == pytest.approx(4.011986, rel=1e-6)
    assert (np.diff(run.energy) <= 1e-12 * run.energy[0]).all()


@pytest.mark.parametrize("dt", [0.5, 1 / 60, 1 / 997])
def test_a_fast_corner_never_sinks_whatever_dt(dt):
    scene = Scene(Body.box(1.0, (0.1, 0.2, 0.3)), friction=0.5, restitution=0.5)
    state = State([0, 0, 1.0], turned([1, 0, 0], 0.3), [0, 0, -100], [800.0, 400.0, 450.0])
    run = simulate(scene, state, 0.5, dt=dt, method="exact")
    assert (np.diff(run.energy) <= 1e-12 * run.energy[0]).all()
    assert scene.gap(states(run)).min() > -1e-12
    assert run.v[-1, 2] > 0


def test_tossed_boxes_never_gain_energy_nor_sink():
    rng = np.random.default_rng(5)
    for _ in range(25):
        scene = Scene(
            Body.box(1.0, rng.uniform(0.1, 0.5, 3), radius=rng.choice([0.0, 0.02])),
            friction=rng.choice([0.0, 0.1, 0.5, 1.0, 2.0]), restitution=rng.choice([0.0, 0.2, 0.5, 0.8]),
        )  # fmt: skip
        state = State([0, 0, 1.0], random_quat(rng), rng.normal(size=3) * 2, rng.normal(size=3) * 8)
        run = simulate(scene, state, 2.5, dt=1 / 60, method="exact")
        assert (run.energy <= np.minimum.accumulate(run.energy) + 1e-12 * run.energy[0]).all()
        assert scene.gap(states(run)).min() > -1e-12


def test_painleves_rod_is_resolved_by_an_impulse():
    """Beyond the critical friction a sliding rod's contact force has no solution: it is dealt an impulse."""
    scene = Scene(Body.rod(1.0, 2.0), friction=3.0)
    for tilt in (0.9, 1.0, 1.1):
        # it slides towards its raised end, turning into the ground
        quat = turned([0, 1, 0], tilt)
        ends = np.array([rotation(quat) @ r for r in scene.body.hull])
        low = ends[np.argmin(ends[:, 2])]
        for speed in (-3.0, 3.0):
            state = State(-low, quat, [speed, 0, 0], ZERO)
            run = simulate(scene, state, 1.0, dt=0.01, method="exact")
            assert np.isfinite(run.w).all()
            assert (np.diff(run.energy) <= 1e-12 * run.energy[0]).all()
            assert scene.gap(states(run)).min() > -1e-12


def test_random_bodies_beyond_the_painleve_guard_are_resolved():
    rng = np.random.default_rng(3)
    for points in (1, 1, 1, 2, 2, 3, 3):
        body = random_body(rng, points)
        critical = critical_friction(body).min()
        scene = Scene(body, friction=min(1.3 * critical, 8.0), restitution=rng.choice([0.0, 0.5]))
        for _ in range(3):
            quat = random_quat(rng)
            state = State(touching(scene, quat), quat, 2 * rng.normal(size=3), 4 * rng.normal(size=3))
            run = simulate(scene, state, 0.5, dt=0.02, method="exact")
            gain = run.energy - np.minimum.accumulate(run.energy)
            assert gain.max() <= 1e-12 * max(1.0, abs(run.energy[0]))
            assert scene.gap(states(run)).min() > -1e-12


def test_a_torque_in_flight_is_integrated_and_still_no_touch_is_missed():
    body = Body(1.0, (0.01, 0.02, 0.025), [(0.3, 0, 0), (-0.3, 0, 0), (0, 0, 0.2)])
    torque = np.array([0.05, -0.02, 0.03])

    def euler(t, y):
        w = y[:3]
        spin = 0.5 * np.array([-w @ y[4:7], *(y[3] * w + np.cross(y[4:7], w))])
        return np.concatenate([(torque - np.cross(w, body.J @ w)) / np.diag(body.J), spin])

    start = np.array([1.0, 5.0, 1.0, 1.0, 0, 0, 0])
    answer = solve_ivp(euler, (0, 1), start, "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    run = simulate(
        Scene(body), State([0, 0, 20.0], UPRIGHT, ZERO, start[:3]), 1.0, dt=1.0, method="exact", torque=torque
    )
    assert angle(run.state.quat, answer[3:]) < 1e-10
    np.testing.assert_allclose(rotation(answer[3:]) @ answer[:3], run.state.w, rtol=1e-10)
    scene = Scene(body, restitution=0.9, friction=0.3)
    low = simulate(
        scene, State([0, 0, 1.0], UPRIGHT, [0, 0, -20.0], [0, 0, 90.0]), 1.0, dt=0.01, method="exact",
        torque=torque,
    )  # fmt: skip
    assert scene.gap(states(low)).min() > -1e-12


def test_the_bits_do_not_depend_on_the_batch_or_the_threads():
    scene = Scene(Body.box(1.0, (0.2, 0.3, 0.4)), friction=0.4, restitution=0.3)
    rng = np.random.default_rng(2)
    start = State(
        np.tile([0, 0, 1.0], (3, 1)), np.array([random_quat(rng) for _ in range(3)]),
        rng.normal(size=(3, 3)), rng.normal(size=(3, 3)) * 5,
    )  # fmt: skip
    together = simulate(scene, start, 1.0, dt=0.05, method="exact", threads=2)
    for i in range(3):
        alone = State(start.x[i], start.quat[i], start.v[i], start.w[i])
        run = simulate(scene, alone, 1.0, dt=0.05, method="exact")
        assert run.w.tobytes() == together.w[:, i].tobytes()
        assert run.f.tobytes() == together.f[:, i].tobytes()


def test_a_start_below_the_surface_is_refused():
    scene = Scene(Body.sphere(1.0, 0.1))
    with pytest.raises(ValueError, match="1e-05 m deep in the ground; at most 1e-09 m"):
        simulate(scene, State([0, 0, 0.1 - 1e-5], UPRIGHT, ZERO, ZERO), 1.0, method="exact")
    simulate(scene, State([0, 0, 0.1 - 5e-10], UPRIGHT, ZERO, ZERO), 1.0, method="exact")


def test_a_run_that_cannot_go_on_says_so():
    scene = Scene(Body.sphere(1.0, 0.1))
    with pytest.raises(SolverError):
        simulate(
            scene, State([0, 0, 5.0], UPRIGHT, [1e308, 0, 0], ZERO), 1.0, method="exact", force=(1e300, 0, 0)
        )


def test_over_a_height_field_it_flies_bounces_and_rolls():
    ditch = HeightField.named("ditch")
    scene = Scene(Body.sphere(1.0, 0.05), surface=ditch, friction=0.8)
    x = np.array([0.1, 0.0, 1.0])
    for _ in range(60):  # down to the surface, along the vertical
        x[2] -= scene.gap(State(x, UPRIGHT, ZERO, ZERO))[0]
    start = State(x, UPRIGHT, ZERO, ZERO)
    rolls = simulate(scene, start, 1.0, dt=0.1, method="exact")
    np.testing.assert_allclose(rolls.energy, rolls.energy[0], rtol=1e-13)
    assert np.abs(scene.gap(states(rolls))).max() < 1e-14
    fine = simulate(scene, start, 1.0, dt=1 / 2000)
    np.testing.assert_allclose(rolls.state.x, fine.state.x, atol=1e-7)
    scene = Scene(Body.sphere(1.0, 0.05), HeightField.named("bumpy"), friction=0.3, restitution=0.7)
    falls = State([0.1, 0.3, 2.0], UPRIGHT, [1, 0.5, 0], [1, 2, 3])
    bounces = simulate(scene, falls, 2.0, dt=0.05, method="exact")
    assert (bounces.energy <= np.minimum.accumulate(bounces.energy) * (1 + 1e-12)).all()
    assert scene.gap(states(bounces)).min() > -1e-12
    fine = simulate(scene, falls, 2.0, dt=1 / 4000)
    np.testing.assert_allclose(bounces.state.x, fine.state.x, atol=5e-3)


def test_over_a_height_field_it_takes_one_contact_only():
    scene = Scene(
        Body.box(1.0, (0.2, 0.2, 0.1)), HeightField(np.zeros((8, 8)), 0.5, (-2, -2, 0)), friction=0.5
    )
    with pytest.raises(SolverError, match="one touching point at a time"):
        simulate(scene, State([0, 0, 0.06], UPRIGHT, ZERO, ZERO), 1.0, method="exact")
