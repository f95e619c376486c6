"""Problems of one body on one surface whose answer is known, at 240 Hz unless said."""

import numpy as np
import pytest
from oracle import rotation, turned

from solver import Body, Plane, Scene, State, simulate

ZERO = [0.0, 0.0, 0.0]


def test_a_minute_of_turning_over_agrees_with_the_closed_form():
    scene = Scene(Body(1.0, (1e-3, 2e-3, 2.5e-3), [(0, 0, 0.1)]), gravity=ZERO)
    state = State([0, 0, 5.0], [1, 0, 0, 0], ZERO, [0.01, 10.0, 0.01])
    answer = simulate(scene, state, 60.0, dt=60.0, method="exact").state.quat
    run = simulate(scene, state, 60.0, record_every=240)
    assert 2 * np.linalg.norm(run.state.quat - answer * np.sign(run.state.quat @ answer)) < 1e-4
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=1e-11)
    L = scene.angular_momentum(State(run.x, run.quat, run.v, run.w))
    np.testing.assert_allclose(L, np.tile(L[0], (len(L), 1)), atol=1e-11 * np.linalg.norm(L[0]))


def test_a_bouncing_ball_comes_to_rest():
    """After √(2h/g)(1 + e)/(1 − e)."""
    e = 0.8
    scene = Scene(Body.sphere(1.0, 0.1), restitution=e)
    run = simulate(scene, State([0, 0, 1.1], [1, 0, 0, 0], ZERO, ZERO), 6.0)
    moving = np.flatnonzero(np.abs(run.v[:, 2]) > 1e-9)
    first_at_rest = run.t[moving[-1] + 1]
    assert first_at_rest == pytest.approx(np.sqrt(2 / 9.81) * (1 + e) / (1 - e), rel=1e-3)
    assert abs(run.x[-1, 2] - 0.1) < 1e-6


def test_housners_block_rocks_as_long_and_loses_as_much_as_he_says():
    """Quarter period by quadrature of θ̈ = −p² sin(α − θ); energy ratio (1 − 1.5 sin²α)² (Housner 1963)."""
    b, h, y = 0.1, 0.3, np.array([0.0, 1.0, 0.0])
    R, alpha = np.hypot(b, h), np.arctan2(b, h)
    p2, tilt = 0.75 * 9.81 / R, 0.5 * alpha
    # with θ = tilt − s² the integrand of dt is smooth
    nodes, weights = np.polynomial.legendre.leggauss(40)
    s = 0.5 * np.sqrt(tilt) * (nodes + 1)
    speed = np.sqrt(2 * p2 * np.sin(alpha - tilt + s**2 / 2) * np.sinc(s**2 / 2 / np.pi))
    quarter = 0.5 * np.sqrt(tilt) * (weights * 2 / speed).sum()

    scene = Scene(Body.box(1.0, (2 * b, 0.2, 2 * h)), friction=5.0)
    state = State(-rotation(turned(y, tilt)) @ [b, 0, -h], turned(y, tilt), ZERO, ZERO)
    run = simulate(scene, state, 0.6)
    energy = run.energy - 9.81 * h
    k = np.flatnonzero(np.diff(energy) < -1e-3 * energy[0])[0]  # the impact is in the step after k
    theta = 2 * np.arcsin(run.quat[k, 2])
    left = np.roots([-0.5 * p2 * np.sin(alpha - theta), run.w[k, 1], theta])
    assert run.t[k] + left[left >= 0].min() == pytest.approx(quarter, rel=2e-4)
    assert energy[k + 2] / energy[0] == pytest.approx((1 - 1.5 * np.sin(alpha) ** 2) ** 2, rel=2e-4)
    later = simulate(scene, state, 3.0)
    assert (np.diff(later.energy) <= 1e-6 * later.energy[0]).all()


def test_a_slope_inside_the_friction_cone_does_not_creep():
    mu = 0.8
    theta = np.arctan(mu / 2)
    normal = np.array([np.sin(theta), 0, np.cos(theta)])
    scene = Scene(Body.box(1.0, (1, 1, 0.4)), Plane(normal), friction=mu)
    state = State(0.2 * normal, turned([0, 1, 0], theta), ZERO, ZERO)
    run = simulate(scene, state, 60.0, record_every=240)
    assert np.abs(run.v).max() < 1e-15
    assert np.abs(run.x - run.x[0]).max() < 1e-10


def test_the_tippe_top_turns_over():
    """A sphere whose centre of mass is off its centre; it crosses the horizontal at 4.012 s.

    Jellett's integral L·q is kept by any contact force, and by every step.
    """
    R, m, off, tilt, x_axis = 0.02, 0.02, 0.3 * 0.02, 0.5, [1.0, 0.0, 0.0]
    J = 0.4 * m * R**2
    scene = Scene(Body(m, (J, J, J), [(0, 0, off)], radius=R), friction=0.05)
    up = rotation(turned(x_axis, tilt)) @ [0, 0, 1]
    state = State([0, 0, R - off * up[2]], turned(x_axis, tilt), ZERO, 100 * up)
    run = simulate(scene, state, 5.0)
    w, x, y, z = run.quat.T
    axis = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x**2 + y**2)], axis=1)
    jellett = (J * run.w * (off * axis - [0, 0, R])).sum(axis=1)
    np.testing.assert_allclose(jellett, jellett[0], rtol=1e-11)
    assert run.t[np.argmax(axis[:, 2] < 0)] == pytest.approx(4.012, rel=0.03)


@pytest.mark.parametrize("dt", [1 / 60, 1 / 240])
def test_a_fast_spinning_corner_neither_gains_energy_nor_sinks(dt):
    """ω dt is up to 17: the step is split, or contacts between its ends would be missed."""
    scene = Scene(Body.box(1.0, (0.1, 0.2, 0.3)), friction=0.5, restitution=0.5)
    state = State([0, 0, 1.0], turned([1, 0, 0], 0.3), [0, 0, -100], [800.0, 400.0, 450.0])
    run = simulate(scene, state, 0.5, dt=dt)
    assert (run.energy <= run.energy[0] * (1 + 1e-6)).all()
    gaps = scene.gap(State(run.x, run.quat, run.v, run.w))
    assert gaps.min() > -1e-6
    assert run.v[-1, 2] > 0  # it has bounced
