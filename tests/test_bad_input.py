"""Errors at the borders: each names the argument, the value and what is allowed."""

import numpy as np
import pytest

from solver import Body, Plane, Scene, SolverError, State, simulate

BOX = Body.box(1.0, (1, 1, 1))
SCENE = Scene(BOX)
REST = State([0, 0, 0.5], [1, 0, 0, 0], [0, 0, 0], [0, 0, 0])
NAN = float("nan")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Body(-1, (1, 1, 1), [(0, 0, 0)]), ["m must be > 0", "-1"]),
        (lambda: Body(NAN, (1, 1, 1), [(0, 0, 0)]), ["m must be finite", "nan"]),
        (lambda: Body("heavy", (1, 1, 1), [(0, 0, 0)]), ["m must be numbers", "heavy"]),
        (lambda: Body(1, (1, 1), [(0, 0, 0)]), ["J", "(3,) or (3, 3)", "(2,)"]),
        (lambda: Body(1, (1, 1, 2.5), [(0, 0, 0)]), ["J1 + J2 >= J3", "2.5"]),
        (lambda: Body(1, (1, 1, 0), [(0, 0, 0)]), ["J must be positive", "0."]),
        (lambda: Body(1, [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]], [(0, 0, 0)]), ["symmetric"]),
        (lambda: Body(1, (1, 1, 1), [(0, 0)]), ["hull", "(p, 3)", "(1, 2)"]),
        (lambda: Body(1, (1, 1, 1), np.zeros((0, 3))), ["hull", "p >= 1"]),
        (lambda: Body(1, (1, 1, 1), [(0, 0, NAN)]), ["hull must be finite"]),
        (lambda: Body(1, (1, 1, 1), [(0, 0, 0)], radius=-0.1), ["radius", ">= 0", "-0.1"]),
        (lambda: Body(1, (1, 1, 1), [(0, 0, 0)], radius=[1, 2]), ["radius", "(1,)", "(2,)"]),
        (lambda: Body.box(1, (1, 1, 1), radius=0.6), ["size", "2 radius"]),
        (lambda: Body.sphere(1, 0), ["radius must be > 0"]),
        (lambda: Plane((0, 0, 0)), ["normal", "zero"]),
        (lambda: Plane((0, 0, np.inf)), ["normal must be finite"]),
        (lambda: Scene("car"), ["body must be a Body", "car"]),
        (lambda: Scene(BOX, friction=-0.1), ["friction", ">= 0", "-0.1"]),
        (lambda: Scene(BOX, restitution=1.1), ["restitution", "<= 1", "1.1"]),
        (lambda: Scene(BOX, gravity=(0, 0)), ["gravity", "(3,)", "(2,)"]),
        (lambda: State([0, 0], [1, 0, 0, 0], [0] * 3, [0] * 3), ["x", "(3,)"]),
        (lambda: State([0] * 3, [2, 0, 0, 0], [0] * 3, [0] * 3), ["quat", "norm 1", "2"]),
        (lambda: State([0] * 3, [0, 0, 0, 0], [0] * 3, [0] * 3), ["quat", "norm 1", "0"]),
        (lambda: State([0, 0, NAN], [1, 0, 0, 0], [0] * 3, [0] * 3), ["x must be finite"]),
        (lambda: State([[0] * 3] * 2, [1, 0, 0, 0], [0] * 3, [0] * 3), ["quat", "(2, 4)"]),
        (lambda: simulate(SCENE, REST, -1), ["duration", ">= 0", "-1"]),
        (lambda: simulate(SCENE, REST, 1, dt=0), ["dt", "> 0", "0"]),
        (lambda: simulate(SCENE, REST, 1, method="euler"), ["method", "'impulse'", "euler"]),
        (lambda: simulate(SCENE, REST, 1, record_every=0), ["record_every", ">= 1", "0"]),
        (lambda: simulate(SCENE, REST, 1, force=(1, 2)), ["force", "(3,)", "(2,)"]),
        (lambda: simulate(SCENE, REST, 1, torque=lambda t: (NAN, 0, 0)), ["torque(0)", "finite"]),
        (lambda: simulate(SCENE, REST, 1, options={"x": 1}), ["options", "none", "'x'"]),
        (
            lambda: simulate(SCENE, REST, 1, method="acceleration", options={"every_frame": 2}),
            ["every_frame", "True or False", "2"],
        ),
        (
            lambda: simulate(SCENE, REST, 1, method="baumgarte", options={"beta": -1}),
            ["options['beta'] must be >= 0", "-1"],
        ),
        (
            lambda: simulate(SCENE, REST, 1, method="exact", options={"tol": NAN}),
            ["options['tol'] must be finite"],
        ),
        (
            lambda: simulate(SCENE, REST, 1, method="exact", options={"tol": 0.0}),
            ["options['tol'] must be > 0", "0"],
        ),
        (lambda: simulate(SCENE, REST, 1, threads=0), ["threads", ">= 1", "0"]),
        (lambda: simulate(SCENE, "here", 1), ["state must be a State", "here"]),
        (
            lambda: simulate(SCENE, State([0, 0, 0.4], [1, 0, 0, 0], [0] * 3, [0] * 3), 1),
            ["state", "0.1 m deep", "5%", "0.0433"],
        ),
    ],
)
def test_a_value_error_says_what_is_wrong_and_what_is_allowed(call, words):
    with pytest.raises(ValueError) as caught:
        call()
    for word in words:
        assert word in str(caught.value)


def test_a_run_that_cannot_go_on_says_when_where_and_which():
    state = State(
        np.tile([0, 0, 5.0], (2, 1)), np.tile([1.0, 0, 0, 0], (2, 1)),
        np.array([[0, 0, 0], [1e308, 0, 0]]), np.zeros((2, 3)),
    )  # fmt: skip
    with pytest.raises(SolverError, match="no longer finite") as caught:
        simulate(SCENE, state, 1.0, force=(1e300, 0, 0), dt=0.5)
    assert caught.value.index == 1
    assert np.isfinite(caught.value.state.x).all()
    assert caught.value.time >= 0


def test_values_are_kept_from_later_changes():
    x = np.zeros(3)
    state = State(x, [1, 0, 0, 0], x, x)
    x[0] = NAN
    assert np.isfinite(state.x).all()
    with pytest.raises(ValueError, match="read-only"):
        BOX.hull[0, 0] = 2.0
