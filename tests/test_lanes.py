"""Several bodies in the lanes of a register: the arithmetic, and runs with the bits of bodies alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from oracle import random_body, random_quat
from test_terms import scenes

from solver import Body, Plane, Scene, SolverError, State, simulate
from solver.trace import (
    LANES,
    every,
    filled,
    floor,
    flops,
    fma,
    largest,
    least,
    most,
    no,
    some,
    sqrt,
    traced,
    types,
    where,
)

FIELDS = ("t", "x", "quat", "v", "w", "energy", "f")


@traced
def formula(a, b, c):
    """Everything that tracing knows."""
    lower = where((a < b) & no(c == 0.0) | (a >= 3.0), least(a, b), most(b, c))
    return fma(a, b, -c) + sqrt(abs(lower)) / (1.0 + b * b) - floor(a), filled(a, 2.0) * lower


@traced
def get(array, k):
    """A row of lanes, or a number."""
    return array[k]


@traced
def put(array, k, x):
    """The inverse."""
    array[k] = x


@njit
def apply(numbers, out):
    x, y = formula(get(numbers, 0), get(numbers, 1), get(numbers, 2))
    put(out, 0, x)
    put(out, 1, y)
    return largest(get(numbers, 0)), some(x > y), every(x > y)


@settings(deadline=None)
@given(st.lists(st.floats(-4, 4), min_size=3 * LANES, max_size=3 * LANES))
def test_a_lane_has_the_bits_of_a_number_alone(values):
    numbers = np.array(values).reshape(3, LANES)
    out, one = np.zeros((2, LANES)), np.zeros(2)
    top, any_larger, all_larger = apply(numbers, out)
    for lane in range(LANES):
        apply(np.ascontiguousarray(numbers[:, lane]), one)
        np.testing.assert_array_equal(out[:, lane], one)
    assert top == numbers[0].max()
    assert any_larger == (out[0] > out[1]).any()
    assert all_larger == (out[0] > out[1]).all()


def test_a_traced_function_can_be_called_from_python():
    x, y = formula(2.0, 1.0, 0.5)
    assert x == pytest.approx(2.0 * 1.0 - 0.5 + np.sqrt(1.0) / 2.0 - 2.0)
    assert y == 2.0


def test_a_branch_on_a_number_is_refused():
    @traced
    def branches(a):
        """A branch."""
        return a if a > 0.0 else -a

    with pytest.raises(Exception, match="where"):
        njit(lambda a: branches(a))(1.0)


def test_operations_are_counted():
    vector = types.UniTuple(types.float64, 3)
    assert flops(traced(lambda a, b: a[0] * b[0] + fma(a[1], b[1], sqrt(a[2]))), vector, vector) == 5
    assert flops(traced(lambda a: where(a > 0.0, -a, a)), types.float64) == 0


def batch(rng, scene, n):
    """Bodies in the air and on the ground, some spinning fast."""
    quat = np.array([random_quat(rng) for _ in range(n)])
    zero = np.zeros((n, 3))
    x = np.zeros((n, 3))
    gaps = scene.gap(State(x, quat, zero, zero)).min(axis=-1)
    heights = rng.choice([0.0, 0.3, 3.0], n) * scene.body.bounding_radius
    x += (heights - gaps)[:, None] * scene.surface.normal
    fast = rng.choice([0.0, 3.0, 200.0], n)[:, None]
    return State(x, quat, rng.normal(size=(n, 3)), fast * rng.normal(size=(n, 3)))


def one_by_one(scene, state, *args, **more):
    """The runs of every body alone, stacked."""
    runs = [
        simulate(scene, State(*(getattr(state, name)[i] for name in ("x", "quat", "v", "w"))), *args, **more)
        for i in range(len(state.x))
    ]
    return {name: np.stack([getattr(run, name) for run in runs], axis=1) for name in FIELDS[1:]}


@pytest.mark.parametrize("term", ["friction", "restitution", "gyroscopic", "centripetal", "several"])
def test_a_batch_has_the_bits_of_its_bodies_alone(term):
    rng = np.random.default_rng(len(term))
    if term == "several":
        scene = Scene(
            random_body(rng), Plane([0.1, 0.2, 1]), friction=0.6, restitution=0.3, blow_friction=0.2
        )
    else:
        scene = scenes(rng)[term]
    state = batch(rng, scene, 21)
    torque = 0.02 * scene.body.m * rng.normal(size=3)
    for threads in (1, 3):
        together = simulate(scene, state, 0.7, torque=torque, record_every=7, threads=threads)
        alone = one_by_one(scene, state, 0.7, torque=torque, record_every=7)
        assert (together.f > 0).any()
        for name, values in alone.items():
            np.testing.assert_array_equal(getattr(together, name), values, err_msg=name)


def test_the_body_that_fails_is_named():
    scene = Scene(Body.box(1.0, (1, 2, 3)), friction=0.5)
    state = batch(np.random.default_rng(0), scene, 12)
    state.w[7] = 1e200  # faster than any step can follow
    with pytest.raises(SolverError) as caught:
        simulate(scene, state, 1.0)
    assert caught.value.index == 7
    assert np.isfinite(caught.value.state.x).all()
