"""What a scene leaves out changes no bit; what it keeps, and why, it can tell."""

import os
import subprocess
import sys

import numpy as np
import pytest
from numba.core import config
from oracle import random_body, random_quat

from solver import Body, Plane, Scene, State, impulse, simulate, terms
from solver.chart import ladder
from solver.model import MEMORY, load, unpack
from solver.scene import to_kernel
from solver.sweep import WIDTH

UPRIGHT, ZERO = [1, 0, 0, 0], [0, 0, 0]
compiled = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="about what is compiled")


def scenes(rng):
    """A random scene for each term that may be zero, and one in which all are."""
    box, tilted = Body.box(1.0, rng.uniform(0.2, 0.6, 3)), Plane([0.1, 0.2, 1.0])
    mu, e = rng.uniform(0.1, 1.0), rng.uniform(0.1, 1.0)
    cube = Body.box(1.0, [0.3, 0.3, 0.3], radius=0.02)
    central = Body(1.0, [1e-3, 2e-3, 2.5e-3], np.zeros((2, 3)), radius=[0.1, 0.12])
    return {
        "friction": Scene(box, tilted, restitution=e),
        "restitution": Scene(box, tilted, friction=mu),
        "gyroscopic": Scene(cube, tilted, friction=mu, restitution=e),
        "centripetal": Scene(central, tilted, friction=mu, restitution=e),
        "sweep": Scene(random_body(rng), tilted, friction=mu, restitution=e),
        "all": Scene(Body.sphere(1.0, 0.1), tilted),
    }


def toss(rng, scene, n):
    height = 1.2 * scene.body.bounding_radius
    return State(
        np.tile([0, 0, height], (n, 1)),
        np.array([random_quat(rng) for _ in range(n)]),
        rng.normal(size=(n, 3)),
        3 * rng.normal(size=(n, 3)),
    )


@pytest.mark.parametrize("term", ["friction", "restitution", "gyroscopic", "centripetal", "sweep", "all"])
def test_leaving_a_zero_term_out_changes_no_bit(term):
    rng = np.random.default_rng(len(term))
    for _ in range(3):
        scene = scenes(rng)[term]
        state = toss(rng, scene, 4)  # few enough to run one by one: lanes leave nothing out
        lean = simulate(scene, state, 1.5, record_every=5)
        assert (lean.f > 0).any()
        assert None in scene.law
        scene.law = terms.full(scene.friction, scene.restitution)
        full = simulate(scene, state, 1.5, record_every=5)
        for name in ("x", "quat", "v", "w", "f", "energy"):
            np.testing.assert_array_equal(getattr(lean, name), getattr(full, name))


def test_without_sweeps_the_deepest_point_alone_touches():
    """Against a body that in each step has only its deepest hull point, the one of the article."""
    box = Body.box(1.0, (0.3, 0.4, 0.5), radius=0.01)
    scene = Scene(box, Plane([0.1, 0, 1]), friction=0.5, restitution=0.4)
    start = State([0, 0, 0.5], [0.6, 0, 0.8, 0], [1, 0, -1], [4, 3, 2])
    body, hull, ground, _law = scene.parameters
    law = (0.5, 0.4, True, None, True, None)
    what = scene.gravity, np.zeros(3)
    row, memory, f = to_kernel(box, start)[0], np.zeros((8, MEMORY)), np.zeros(8)
    state, held, one = row.copy(), -1, np.zeros((1, MEMORY))
    for _ in range(240):
        x, quat, v, w = np.split(state, [3, 7, 10])
        k = scene.gap(State(x, quat, v, w)).argmin()
        if k != held:
            held, one = k, np.zeros((1, MEMORY))
        impulse.run(body, hull[k : k + 1], ground, law, *what, state, one, f[:1], np.zeros(1), 1 / 240, 1)
    assert impulse.run(body, hull, ground, law, *what, row, memory, f, np.zeros(1), 1 / 240, 240) == 0
    np.testing.assert_array_equal(row, state)
    assert (memory[:, 0] > 0).sum() <= 1


@compiled
@pytest.mark.parametrize("case", ladder.cases(), ids=lambda case: case.name.replace(" ", "-"))
def test_what_a_scene_says_is_out_costs_no_accuracy(case):
    """`explain` and the model ladder agree; and each scene has a term that matters."""
    if case.scene.surface.field is not None:
        pytest.skip("another kernel, for the same terms")
    errors = {term: ladder.model_error(case, (term,)) for term in ladder.TERMS}
    out = [term for term in ladder.TERMS if not ladder.in_explain(case, term)]
    assert [errors[term] for term in out] == [0.0] * len(out)
    assert max(errors.values()) > 1e-3
    assert set(ladder.order(case)[: ladder.idle(case)]) == set(out)


@compiled
def test_the_lean_kernel_is_another_specialisation_and_stays_on_disk():
    scene, state = Scene(Body.sphere(1.0, 0.1)), State([0, 0, 0.1], UPRIGHT, ZERO, ZERO)
    assert scene.law == (None,) * 6
    simulate(scene, state, 0.01)
    scene.law = terms.full(0.0, 0.0)
    simulate(scene, state, 0.01)
    laws = [str(signature[3]) for signature in impulse.run.signatures]
    assert "UniTuple(none x 6)" in laws
    assert "Tuple(float64, float64, bool, bool, bool, float64)" in laws

    again = (
        "from solver import Body, Scene, State, impulse, simulate\n"
        "state = State([0, 0, 0.3], [1, 0, 0, 0], [0, 0, 0], [0, 0, 0])\n"
        "simulate(Scene(Body.sphere(2.0, 0.3)), state, 0.01)\n"
        "print(sum(impulse.run.stats.cache_hits.values()), sum(impulse.run.stats.cache_misses.values()))"
    )
    told = subprocess.run(
        [sys.executable, "-c", again], env=os.environ, capture_output=True, text=True, check=True
    )
    assert told.stdout.split() == ["1", "0"]


def test_a_body_asleep_has_the_bits_of_one_that_is_stepped():
    """`run`, which stops stepping, against as many steps."""
    scene = Scene(Body.box(1.0, (0.2, 0.3, 0.4)), friction=0.5)
    state = State([0.3, 0.2, 0.21], UPRIGHT, [0.1, 0, 0], [0.1, 0.2, 0.3])
    settled = simulate(scene, state, 5.0, record_every=1200).state
    row = to_kernel(scene.body, settled)[0]
    body, hull, ground, _law = scene.parameters
    a, torque, h, n = scene.gravity, np.zeros(3), 1 / 240, 1000

    asleep, memory, f = row.copy(), np.zeros((8, MEMORY)), np.zeros(8)
    assert impulse.run(body, hull, ground, scene.law, a, torque, asleep, memory, f, np.zeros(1), h, n) == 0

    contacts, rows, push = np.zeros((8, MEMORY)), np.zeros((8, WIDTH)), np.zeros((8, 3))
    what = unpack(body, ground)
    x, quat, v, w = load(row)
    clear, unchanged = 0.0, 0
    for _ in range(n):
        before = (x, quat, v, w)
        x, quat, v, w, clear, still = impulse.step(
            what[0], hull, what[1], scene.law, tuple(a), (0.0, 0.0, 0.0),
            x, quat, v, w, contacts, rows, push, h, clear,
        )  # fmt: skip
        unchanged += still > 0 and (x, quat, v, w) == before
    assert unchanged > n / 2, "it never fell asleep"
    assert v == w == (0.0, 0.0, 0.0)
    np.testing.assert_array_equal(asleep, np.concatenate([x, quat, v, w]))
    np.testing.assert_array_equal(memory, contacts)
    np.testing.assert_array_equal(f, push[:, 2] / (n * h))
    assert f.sum() == pytest.approx(9.81, rel=1e-9)


def test_blows_have_a_friction_of_their_own():
    """A ball thrown without spin slips along; its blow takes μ(1 + e) |v_n| of speed, and no more later."""
    ball, slow, fast = Body.sphere(1.0, 0.1), 0.05, 0.4
    state = State([0, 0, 0.11], UPRIGHT, [5.0, 0, -2.0], ZERO)

    def lost(**law):
        return 5.0 - simulate(Scene(ball, gravity=(0, 0, 0), restitution=0.5, **law), state, 0.1).v[-1, 0]

    assert lost(friction=slow, blow_friction=fast) == pytest.approx(fast * 1.5 * 2.0, rel=1e-12)
    assert lost(friction=fast, blow_friction=slow) == pytest.approx(slow * 1.5 * 2.0, rel=1e-12)
    assert lost(friction=slow, blow_friction=0.0) == 0.0
    slides = Scene(Body.box(1.0, (0.2, 0.2, 0.2)), friction=slow, blow_friction=fast)
    run = simulate(slides, State([0, 0, 0.1], UPRIGHT, [1.0, 0, 0], ZERO), 0.2)
    assert run.v[-1, 0] == pytest.approx(1.0 - slow * 9.81 * 0.2, rel=1e-9)
    with pytest.raises(ValueError, match="method must be 'impulse'"):
        simulate(slides, state, 0.1, method="exact")
    told = {line.split()[0]: line.split()[1] for line in slides.explain().splitlines()[1:]}
    assert told["blows"] == "in"


def test_a_torque_wakes_a_sleeper():
    scene = Scene(Body.box(1.0, (0.4, 0.4, 0.4)), friction=1.0)
    state = State([0, 0, 0.2], UPRIGHT, ZERO, ZERO)
    run = simulate(scene, state, 2.0, record_every=120, torque=lambda t: (0, 3.0 * (t >= 1.0), 0))
    np.testing.assert_array_equal(run.x[1], run.x[2])
    np.testing.assert_array_equal(run.v[1:3], 0)
    assert np.linalg.norm(run.w[-1]) > 1.0


@pytest.mark.parametrize("term", ["friction", "restitution", "gyroscopic", "centripetal", "sweep", "all"])
def test_a_scene_explains_what_is_in_and_what_is_out(term):
    scene = scenes(np.random.default_rng(1))[term]
    told = {line.split()[0]: line.split()[1] for line in scene.explain().splitlines()[1:]}
    parts = ("friction", "restitution", "gyroscopic", "sweep", "centripetal", "blows")
    assert [told[part] for part in parts] == ["out" if value is None else "in" for value in scene.law]
    assert told["rounding"] == ("in" if scene.body.radius.any() else "out")
    assert told["curvature"] == "out"
    assert told[term] == "out" if term in parts else {told[part] for part in parts} == {"out"}
    assert {"contact", "steps", "Painlevé"} <= set(told)


@pytest.mark.parametrize(("mu", "answer"), [(1.3, "cannot occur"), (1.4, "can occur")])
def test_a_scene_explains_whether_painleves_paradox_can_occur(mu, answer):
    scene = Scene(Body.rod(1.0, 1.0), friction=mu)
    assert answer in scene.explain()
    assert "from μ = 1.333" in scene.explain()
