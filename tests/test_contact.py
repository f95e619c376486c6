"""The article's single contact: Eqs. 4-8 against numpy, and the method that steps them."""

from itertools import pairwise

import numpy as np
import pytest
from oracle import Article, random_body, random_quat, touching

from solver import METHODS, Body, Plane, Scene, SolverError, State, simulate

RANDOM = range(60)


def draw(seed, points=1):
    rng = np.random.default_rng(seed)
    scene = Scene(
        random_body(rng, points),
        Plane(rng.normal(size=3), rng.normal(size=3)),
        gravity=rng.normal(size=3) * 5,
        restitution=rng.uniform(),
    )
    quat = random_quat(rng)
    return rng, scene, touching(scene, quat), quat, rng.normal(size=3), rng.normal(size=3) * 3


@pytest.mark.parametrize("seed", RANDOM)
def test_quantities_are_those_of_the_equations(seed):
    rng, scene, x, quat, v, w = draw(seed, points=5)
    force, torque = rng.normal(size=3), rng.normal(size=3)
    contact = scene.contact(State(x, quat, v, w), force, torque)
    for k in range(5):
        a = Article(scene, x, quat, v, w, k, force, torque)
        for name in ("gap", "v", "G", "l", "f", "i"):
            expected = getattr(a, name)
            assert getattr(contact, name)[k] == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", RANDOM)
def test_velocity_jumps_by_eq_8(method, seed):
    _, scene, x, quat, v, w = draw(seed)
    a = Article(scene, x, quat, v, w)
    if a.v > 0:
        v = v - 2 * a.v * scene.surface.normal
    a = Article(scene, x, quat, v, w)
    run = simulate(scene, State(x, quat, v, w), 1e-12, dt=1e-12, method=method)
    measured = np.concatenate([run.v[1] - v, run.w[1] - w])
    np.testing.assert_allclose(measured, a.jump(a.i), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", RANDOM)
def test_acceleration_is_that_of_eqs_6_and_7(method, seed):
    rng, scene, x, quat, v, w = draw(seed)
    v = v - Article(scene, x, quat, v, w).v * scene.surface.normal  # it slides: v = 0
    force, torque = rng.normal(size=3), rng.normal(size=3)
    a = Article(scene, x, quat, v, w, 0, force, torque)
    expected = a.acceleration(a.f)
    state = State(x, quat, v, w)

    def measured(dt):
        run = simulate(scene, state, dt, dt=dt, method=method, force=force, torque=torque)
        assert run.f[1, 0] == pytest.approx(a.f, rel=100 * dt + 1e-9, abs=100 * dt)
        return np.concatenate([run.v[1] - v, run.w[1] - w]) / dt

    if method in ("acceleration", "baumgarte"):  # explicit: exact at any step
        np.testing.assert_allclose(measured(1e-4), expected, rtol=1e-9, atol=1e-9)
    else:  # extrapolated to a step of none
        h = 1e-3
        estimates = [measured(h / 2**k) for k in range(5)]
        for order in range(1, 5):
            estimates = [(2**order * fine - coarse) / (2**order - 1) for coarse, fine in pairwise(estimates)]
        scale = np.abs(expected).max()
        np.testing.assert_allclose(estimates[0], expected, rtol=0, atol=1e-7 * scale)


def test_force_never_pulls():
    scene = Scene(Body.sphere(1.0, 0.1), gravity=(0, 0, 5.0))
    state = State([0, 0, 0.1], [1, 0, 0, 0], [0, 0, 0], [0, 0, 0])
    for method in METHODS:
        run = simulate(scene, state, 0.1, method=method)
        assert (run.f == 0).all()
        assert run.v[-1, 2] == pytest.approx(0.5)


def test_acceleration_drifts_off_the_surface_and_impulse_does_not():
    scene = Scene(Body(1.0, (0.01, 0.01, 0.006), [(0, 0.03, -0.1)]))
    state = State([0, 0, 0.1], [1, 0, 0, 0], [0, 0, 0], [0, 0.5, 20])
    state = State(state.x, state.quat, [0, 0, -scene.contact(state).v[0]], state.w)
    drift = [
        abs(scene.gap(simulate(scene, state, 0.05, dt=dt, method="acceleration").state)[0])
        for dt in (2e-4, 1e-4)
    ]
    assert drift[0] / drift[1] == pytest.approx(2.0, rel=0.1)  # first order
    held = simulate(scene, state, 0.05, dt=2e-4, method="impulse")
    assert abs(scene.gap(held.state)[0]) < 1e-12
    assert drift[1] > 1e-7


def test_baumgarte_pulls_the_gap_back_until_its_step_is_too_long():
    """Eq. 9: a gap of −c/β² is left, and the semi-implicit step is stable for βh < 2 √(1 − αh)."""
    scene = Scene(Body(1.0, (0.01, 0.01, 0.006), [(0, 0.03, -0.1)]))
    state = State([0, 0, 0.1], [1, 0, 0, 0], [0, 0, 0], [0, 0.5, 20])
    state = State(state.x, state.quat, [0, 0, -scene.contact(state).v[0]], state.w)
    h = 5e-4

    def worst(**kwargs):
        run = simulate(scene, state, 1.0, dt=h, **kwargs)
        return np.abs(scene.gap(State(run.x, run.quat, run.v, run.w))).max()

    def pulled(stiffness):
        return worst(method="baumgarte", options={"alpha": stiffness / h, "beta": stiffness / h})

    drift = worst(method="acceleration")
    assert pulled(0.0) == pytest.approx(drift, rel=1e-3)  # no spring: Eq. 7
    assert worst(method="baumgarte") < 0.6 * drift
    assert pulled(0.8) < 0.01 * drift  # below the limit of 2 √2 − 2 = 0.83
    assert pulled(1.2) > 10 * pulled(0.8)


def test_acceleration_fails_as_told_on_several_points():
    """Four corners of an upright a x a x c box, each pushing as if alone: together 4/(mG) weights."""
    scene = Scene(Body.box(1.0, (0.3, 0.3, 1.0)))
    state = State([0, 0, 0.5], [1, 0, 0, 0], [0, 0, 0], [0, 0, 0])
    thrown = simulate(scene, state, 0.1, method="acceleration")
    mG = 1 + 6 * 0.3**2 / (0.3**2 + 1.0**2)
    assert thrown.f[0].sum() == pytest.approx(4 / mG * 9.81)
    assert thrown.v[1, 2] == pytest.approx((4 / mG - 1) * 9.81 / 240)
    assert thrown.energy.max() > thrown.energy[0] + 0.01
    held = simulate(scene, state, 0.1, method="impulse")
    np.testing.assert_allclose(held.energy, held.energy[0], atol=1e-12)


def test_painleve_is_an_error_without_impulses():
    """A rod that slides with μ above (tan²θ + 4)/(3 tanθ) has no contact force (Eq. 11)."""
    theta = np.arctan(2.0)  # μ must be at least 4/3 there
    scene = Scene(Body.rod(1.0, 1.0), friction=1.5)
    quat = [np.cos(theta / 2), 0, np.sin(theta / 2), 0]  # the +x end is down
    x = [0, 0, 0.5 * np.sin(theta)]
    for direction in (1.0, -1.0):
        state = State(x, quat, [direction, 0, 0], [0, 0, 0])
        try:
            simulate(scene, state, 0.01, dt=1e-3, method="acceleration")
        except SolverError as error:
            assert "Painlevé" in error.reason
            assert error.time == 0.0
            break
    else:
        pytest.fail("neither direction of slip is paradoxical")
    assert np.isfinite(simulate(scene, state, 0.1, dt=1e-3, method="impulse").energy).all()
