"""The restarts of scenes without a closed form, and the independent integration that certifies them."""

import numpy as np
import pytest

from flipcar_env import car
from solver import Body, Scene, State
from solver.chart import reference
from solver.chart.coulomb import STICKS, Undetermined, contacts
from solver.chart.engine import Ours
from solver.chart.path import strike
from solver.chart.restarts import ROUNDED, TITLES, error, problems
from solver.exact.impact import impact

ZERO, UPRIGHT = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
PROBLEMS = {problem.name: problem for problem in problems()}


@pytest.mark.parametrize(("name", "k"), [("box", 7), ("roof", 7), ("crash", 7)])
def test_stored_answers_are_those_of_an_independent_integration(name, k):
    row = reference.certify(PROBLEMS[name], k)
    assert max(row[key] for key in ("x_m", "attitude_rad", "v_m_s", "w_rad_s")) < 1e-9
    assert row["other_impact_law"] < 1e-9
    assert row["sticks"] > 0


def test_the_stored_body_is_the_car_with_its_sharp_points_rounded():
    assert list(PROBLEMS) == list(TITLES)
    body = car.body()
    for name in ("roof", "crash"):
        scene = PROBLEMS[name].scene
        assert scene.body.m == body.m
        np.testing.assert_array_equal(scene.body.J, body.J)
        np.testing.assert_array_equal(scene.body.hull, body.hull)
        np.testing.assert_array_equal(scene.body.radius, np.where(body.radius > 0, body.radius, ROUNDED))
        assert (scene.friction, scene.restitution) == (car.FRICTION, car.RESTITUTION)


@pytest.mark.parametrize("name", TITLES)
def test_impulse_converges_to_the_stored_answers(name):
    problem = PROBLEMS[name]

    def median(steps):
        run = Ours("impulse").play(
            problem.scene, problem.starts, problem.duration, problem.records, steps, problem.torque
        )
        return np.median(error(problem, run.at(-1)))

    errors = [median(steps) for steps in (10, 100, 1000)]
    assert np.log10(errors[0] / errors[2]) / 2 > 1.5
    assert errors[2] < 1e-7


def test_the_path_of_an_impact_is_the_same_by_another_integration():
    rng = np.random.default_rng(3)
    for e in (0.0, 0.0, 0.4, 0.8):
        body = Body.box(1.0, rng.uniform(0.2, 1.0, 3))
        quat = rng.normal(size=4)
        scene = Scene(body, friction=0.5)
        y = np.concatenate([ZERO, quat / np.linalg.norm(quat), rng.normal(size=6)])
        pose = reference.Pose(scene, y, ZERO)
        K, u = pose.K([0]), pose.u[0] * [0, 1, 1] - [np.abs(pose.u[0, 0]), 0, 0]
        six = (K[0, 0], K[0, 1], K[0, 2], K[1, 1], K[1, 2], K[2, 2])
        *p, ok = impact(six, 0.5, e, tuple(u))
        assert ok
        np.testing.assert_allclose(strike(K, u, 0.5, e), p, atol=1e-10 * np.linalg.norm(u))


def test_a_point_whose_slip_would_end_up_reversed_sticks():
    """m = 1, u = (−1, .3, 0), μ = .5: sliding all the way leaves −.2, against the mean slip .05."""
    u = np.array([[-1.0, 0.3, 0.0]])
    p, modes = contacts(np.eye(3), u, 2 * u[:, 1:], 0.5, [None])
    assert modes == [STICKS]
    np.testing.assert_allclose(p, -u, atol=1e-15)


def test_a_sphere_slides_then_rolls():
    """Closed form: it rolls after 2v/7μg at 12v²/49μg, with 5v/7."""
    mu, v = 0.2, 1.0
    scene = Scene(Body.sphere(1.0, 0.1), friction=mu)
    end, seen = reference.play(scene, State(np.array([0, 0, 0.1]), UPRIGHT, np.array([v, 0, 0]), ZERO), 0.5)
    t, x = 2 * v / (7 * mu * 9.81), 12 * v**2 / (49 * mu * 9.81)
    assert end.v[0] == pytest.approx(5 * v / 7, abs=1e-12)
    assert end.x[0] == pytest.approx(x + 5 * v / 7 * (0.5 - t), abs=1e-12)
    assert (seen["slides"], seen["sticks"]) == (1, 1)


def test_a_ball_bounces_as_it_should():
    e, h = 0.5, 0.2
    scene = Scene(Body.sphere(1.0, 0.1), friction=0.3, restitution=e)
    fall = np.sqrt(2 * h / 9.81)
    end, seen = reference.play(scene, State(np.array([0, 0, h + 0.1]), UPRIGHT, ZERO, ZERO), fall * (1 + e))
    assert end.x[2] == pytest.approx(0.1 + e**2 * h, abs=1e-12)
    assert seen["impacts"] == 1


def test_what_mechanics_does_not_determine_is_refused():
    """Four points slide as the body spins on them: friction depends on how they share the weight."""
    scene = Scene(Body.box(1.0, (0.4, 0.3, 0.2)), friction=0.3)
    spins = State(np.array([0, 0, 0.1]), UPRIGHT, np.array([0.3, 0, 0]), np.array([0, 0, 2.0]))
    with pytest.raises(Undetermined, match="not unique"):
        reference.play(scene, spins, 0.1)
