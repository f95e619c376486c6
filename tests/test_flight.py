"""Free flight keeps what it must, and follows the true motion to fourth order."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import random_body, random_quat

from solver import Body, Scene, State, simulate


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_energy_and_angular_momentum_are_kept(seed):
    rng = np.random.default_rng(seed)
    scene = Scene(random_body(rng))
    state = State([0, 0, 1e4], random_quat(rng), rng.normal(size=3), 5 * rng.normal(size=3))
    run = simulate(scene, state, 10.0, record_every=240)
    L0 = scene.angular_momentum(state)
    kinetic = scene.energy(state) - 9.81 * scene.body.m * 1e4
    fall = run.energy[-1] - 9.81 * scene.body.m * run.x[-1, 2]
    spin = kinetic - 0.5 * scene.body.m * state.v @ state.v
    spin_end = fall - 0.5 * scene.body.m * run.v[-1] @ run.v[-1]
    assert spin_end == pytest.approx(spin, rel=1e-8)
    np.testing.assert_allclose(scene.angular_momentum(run.state), L0, atol=1e-10 * np.linalg.norm(L0))
    np.testing.assert_allclose(run.x[-1], state.x + 10 * state.v + [0, 0, -490.5], rtol=1e-12)


def test_ten_seconds_of_the_hard_spin_at_240_hz():
    scene = Scene(Body(1.0, (1e-3, 2e-3, 2.5e-3), [(0, 0, 0)]), gravity=(0, 0, 0))
    state = State([0, 0, 1], [1, 0, 0, 0], [0, 0, 0], [0.01, 10, 0.01])
    run = simulate(scene, state, 10.0, record_every=24)
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=1e-11)


def test_attitude_is_fourth_order():
    scene = Scene(Body(1.0, (1.0, 2.0, 2.5), [(0, 0, 0)]), gravity=(0, 0, 0))
    state = State([0, 0, 1], [1, 0, 0, 0], [0, 0, 0], [0.7, 1.3, -0.9])

    def attitude(steps):
        return simulate(scene, state, 2.0, dt=2.0 / steps).state.quat

    exact = attitude(4800)
    # steps that are not split
    errors = [np.linalg.norm(attitude(n) - exact) for n in (300, 600)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.15)


def test_a_sphere_spins_steadily():
    scene = Scene(Body.sphere(1.0, 0.1), gravity=(0, 0, 0))
    state = State([0, 0, 1], [1, 0, 0, 0], [0, 0, 0], [1.0, 2.0, 3.0])
    run = simulate(scene, state, 1.0)
    np.testing.assert_allclose(run.w, np.tile(state.w, (len(run.t), 1)), rtol=1e-12)
    angle = np.linalg.norm(state.w)
    assert run.quat[-1, 0] == pytest.approx(np.cos(angle / 2), abs=1e-9)


def test_torque_and_force_accelerate_as_they_must():
    scene = Scene(Body.sphere(2.0, 0.5), gravity=(0, 0, 0))
    state = State([0, 0, 9], [1, 0, 0, 0], [0, 0, 0], [0, 0, 0])
    run = simulate(scene, state, 1.0, force=(4, 0, 0), torque=lambda t: (0, 0.2, 0))
    np.testing.assert_allclose(run.x[-1], [1, 0, 9], atol=1e-12)
    np.testing.assert_allclose(run.w[-1], [0, 1, 0], atol=1e-9)


def test_a_run_can_be_cut_anywhere_and_batches_run_alike():
    rng = np.random.default_rng(0)
    scene = Scene(Body.box(1.0, (1.0, 0.6, 0.4)), friction=0.5, restitution=0.3)
    quats = np.array([random_quat(rng) for _ in range(3)])
    state = State(np.tile([0, 0, 1.5], (3, 1)), quats, np.zeros((3, 3)), rng.normal(size=(3, 3)))
    run = simulate(scene, state, 1.0)
    assert run.x.shape == (241, 3, 3)
    assert run.f.shape == (241, 3, 8)
    alone = [
        simulate(scene, State(*(getattr(state, n)[i] for n in ("x", "quat", "v", "w"))), 1.0)
        for i in range(3)
    ]
    for i in range(3):
        assert (alone[i].x == run.x[:, i]).all()
        assert (alone[i].quat == run.quat[:, i]).all()
    shared = simulate(scene, state, 1.0, threads=2)
    assert (shared.x == run.x).all()
    assert (shared.f == run.f).all()
    coarse = simulate(scene, state, 1.0, record_every=60)
    assert (coarse.x == run.x[::60]).all()


def test_record_rows_and_the_shorter_last_step():
    scene = Scene(Body.sphere(1.0, 0.1))
    state = State([0, 0, 50], [1, 0, 0, 0], [0, 0, 0], [0, 0, 0])
    run = simulate(scene, state, 1.0, dt=0.3)
    np.testing.assert_allclose(run.t, [0, 0.3, 0.6, 0.9, 1.0])
    assert run.x[-1, 2] == pytest.approx(50 - 4.905)
    run = simulate(scene, state, 1.0, dt=0.3, record_every=3)
    np.testing.assert_allclose(run.t, [0, 0.9])
    assert run.state.x[2] == pytest.approx(50 - 4.905)
    assert len(simulate(scene, state, 0.0).t) == 1
    assert len(simulate(scene, state, 1.0).t) == 241
