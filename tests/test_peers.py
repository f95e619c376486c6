"""Other engines get the same scene as ours: frames, units, laws; and refuse what they cannot play."""

import numpy as np
import pytest

from solver import Body, HeightField, Plane, Scene, State
from solver.chart import peers
from solver.chart.engine import EngineError
from solver.chart.peers import PEERS, SWEEPS, make, peer, shapes
from solver.rotation import product, to_matrix

ABSENT = peers.missing()
NAMES = [
    pytest.param(name, marks=pytest.mark.skipif(name in ABSENT, reason=ABSENT.get(name, "")))
    for name in PEERS
]
every_engine = pytest.mark.parametrize("name", NAMES)


@pytest.fixture(autouse=True)
def _untimed(monkeypatch):
    """No run is repeated for the sake of its time."""
    monkeypatch.setattr(peer, "TIMED_SECONDS", 0.0)


def start(x, quat=(1, 0, 0, 0), v=(0, 0, 0), w=(0, 0, 0)):
    return State([x], [quat], [v], [w])


def angle(a, b):
    return 2 * np.arccos(np.minimum(1, np.abs((a * b).sum(-1))))


def flight(scene, starts, interval, torque, n=50):
    """Newton and Euler as they stand, by RK4: (x, quat, v, w) at the start, then after each torque."""
    J, h = scene.body.J, interval / n

    def rate(y, tau):
        quat, v, w = y[3:7], y[7:10], y[10:]
        R = to_matrix(quat)
        J_world = R @ J @ R.T
        dw = np.linalg.solve(J_world, R @ tau - np.cross(w, J_world @ w))  # Eq. 2
        return np.concatenate([v, 0.5 * product(np.array([0.0, *w]), quat), scene.gravity, dw])

    rows = []
    for y in np.column_stack([starts.x, starts.quat, starts.v, starts.w]):
        rows.append([y])
        for tau in torque:
            for _ in range(n):
                a = rate(y, tau)
                b = rate(y + h / 2 * a, tau)
                c = rate(y + h / 2 * b, tau)
                y = y + h / 6 * (a + 2 * b + 2 * c + rate(y + h * c, tau))
            rows[-1].append(y)
    return np.split(np.swapaxes(rows, 0, 1), [3, 7, 10], -1)


RNG = np.random.default_rng(3)
AXES = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
J = AXES @ np.diag([0.02, 0.03, 0.04]) @ AXES.T


@pytest.fixture(scope="module")
def aslant():
    """Non-diagonal J, tilted start and spin, gravity aslant, a torque in body axes; and how that flies."""
    body = Body(2.0, J, [(0.1, 0.2, 0.3), (0, 0, -0.1)], 0.05)
    scene = Scene(body, Plane((1, 2, 3), (0, 0, -50)), gravity=(1, -2, -9), friction=0.5)
    tilt = RNG.normal(size=4)
    tilt /= np.linalg.norm(tilt)
    starts = State(
        [(1, 2, 3), (0, 0, 0)], [tilt, (1, 0, 0, 0)], [(3, 1, 2), (0, 0, 0)], [(2, -3, 4), (1, 0, 0)]
    )
    torque = np.array([(0.05, -0.03, 0.02), (0, 0.1, -0.1), (0.02, 0.01, 0.1), (-0.1, 0, 0)])
    return scene, starts, torque, flight(scene, starts, 0.1, torque)


MULTIBODY = pytest.param("PyBullet", {"maximal": False}, marks=NAMES[list(PEERS).index("PyBullet")].marks)


@pytest.mark.parametrize(
    ("name", "settings"), [pytest.param(*p.values, {}, marks=p.marks) for p in NAMES] + [MULTIBODY]
)
def test_a_body_of_any_inertia_flies_by_newton_and_euler(name, settings, aslant):
    """A wrong frame of anything is off by order 1, the engines' own error by order h."""
    scene, starts, torque, (x, quat, v, w) = aslant
    errors = []
    for steps in (10, 100):
        run = make(name, **settings).play(scene, starts, 0.4, 4, steps, torque)
        np.testing.assert_allclose(run.t, [0, 0.1, 0.2, 0.3, 0.4])
        off = [np.abs(run.x - x), angle(run.quat, quat), np.abs(run.v - v), np.abs(run.w - w)]
        errors.append([error.max() for error in off])
    assert np.all(np.array(errors[1]) < [2e-3, 2e-3, 1e-3, 0.03])
    if name != "MuJoCo RK4":  # exact for a parabola at any step
        assert errors[1][0] == pytest.approx(errors[0][0] / 10, rel=0.05)


@every_engine
@pytest.mark.parametrize("aligned", [True, False])
def test_a_box_stays_on_a_slope_inside_the_cone(name, aligned):
    """Half of the steepest slope that holds it, through a point off the origin; J along its edges or not."""
    mu = 0.5
    slope = np.arctan(mu / 2)
    plane = Plane((np.sin(slope), 0, np.cos(slope)), (1, 2, 3))
    box = Body.box(1.0, (0.4, 0.4, 0.2))
    scene = Scene(box if aligned else Body(1.0, J, box.hull), plane, friction=mu)
    x = plane.point + 0.1 * plane.normal
    quat = (np.cos(slope / 2), 0, np.sin(slope / 2), 0)
    run = make(name).play(scene, start(x, quat), 1.0, 2, 250)
    assert np.linalg.norm(run.x[-1] - x) < 2e-4
    assert angle(run.quat[-1], run.quat[0]) < 1e-3


@every_engine
@pytest.mark.parametrize("along", [(1, 0, 0), (0.6, 0.8, 0)])
def test_a_box_slides_to_its_stop(name, along):
    """v²/2μg, straight on."""
    mu, v = 0.5, np.multiply(2.0, along)
    scene = Scene(Body.box(1.0, (0.4, 0.4, 0.2)), friction=mu)
    run = make(name).play(scene, start((0, 0, 0.1), v=v), 0.5, 2, 250)
    np.testing.assert_allclose(run.x[-1, 0, :2], v[:2] * 2 / (2 * mu * 9.81), atol=0.02 * 4 / (2 * mu * 9.81))


@every_engine
@pytest.mark.parametrize("radius", [0.0, 0.03])
def test_a_landed_body_rests_where_its_gap_is_zero(name, radius):
    """Hull points with and without a radius, off centre and not a box."""
    body = Body(1.0, (0.02, 0.02, 0.03), [(0.3, 0, 0), (-0.2, 0.2, 0), (-0.2, -0.2, 0)], radius)
    scene = Scene(body, friction=0.5)
    run = make(name).play(scene, start((0, 0, radius + 0.01)), 1.0, 1, 1000)
    assert np.abs(scene.gap(run.at(-1))).max() < 1e-4


BOUNCES = [
    ("PyBullet", {}),
    ("Rapier", {}),
    ("MuJoCo Euler", {"bounce": True}),
    ("MuJoCo implicitfast", {"bounce": True}),
]


@pytest.mark.parametrize(("name", "settings"), [bounce for bounce in BOUNCES if bounce[0] not in ABSENT])
def test_restitution_is_the_scene_s(name, settings):
    """Dropped from 1 m with e = .6: at its highest again after .3 s more, e² m up."""
    e, g = 0.6, 9.81
    fall = np.sqrt(2 / g)
    scene = Scene(Body.sphere(1.0, 0.1), restitution=e)
    run = make(name, **settings).play(scene, start((0, 0, 1.1)), fall * (1 + e), 1, 2000)
    assert run.x[-1, 0, 2] - 0.1 == pytest.approx(e**2, rel=0.01)


@every_engine
def test_what_it_cannot_play_is_refused(name):
    engine = make(name)
    body = Body.sphere(1.0, 0.1)
    field = Scene(body, HeightField.named("bumpy"))
    assert "planes" in engine.refuses(field)
    with pytest.raises(EngineError, match=name):
        engine.play(field, start((0, 0, 1)), 0.1, 1, 1)
    assert engine.refuses(Scene(body)) is None
    if name.startswith(("MuJoCo", "Drake")):
        assert "restitution" in engine.refuses(Scene(body, restitution=0.5))


@pytest.mark.skipif("MuJoCo Euler" in ABSENT, reason="MuJoCo is not installed")
def test_a_state_that_is_no_longer_finite_is_an_error(tmp_path, monkeypatch):
    """The free spin that explicit gyroscopic terms lose after 43 s; and no log file is left behind."""
    monkeypatch.chdir(tmp_path)
    scene = Scene(
        Body(1.0, (1e-3, 2e-3, 2.5e-3), [(0, 0, 0)], 0.01), Plane(point=(0, 0, -1)), gravity=(0, 0, 0)
    )
    spin = start((0, 0, 0), w=(0.01, 10, 0.01))
    with pytest.raises(EngineError, match=r"at t = 4\d"):
        make("MuJoCo Euler").play(scene, spin, 60.0, 60, 60)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("broken", [[np.nan] * 13, [np.inf] * 13])
def test_no_engine_hands_out_what_is_not_finite(broken):
    class Broken:
        put = go = lambda *_: None
        row = lambda _: np.array(broken)  # noqa: E731

    with pytest.raises(EngineError, match="not finite at record 1"):
        peer._play(Broken(), np.zeros((1, 13)), None, 1, np.empty((2, 1, 13)))


@every_engine
def test_every_setting_of_its_sweep_plays(name):
    scene = Scene(Body.box(1.0, (0.4, 0.4, 0.2)), friction=0.5)
    assert 5 <= len(SWEEPS[name]) <= 12
    for settings in SWEEPS[name]:
        engine = make(name, **settings)
        assert engine.settings.items() >= settings.items()
        run = engine.play(scene, start((0, 0, 0.1), v=(1, 0, 0)), 0.02, 2, 5)
        assert 0 < run.v[-1, 0, 0] < 1


def test_spheres_have_the_hull_s_gaps():
    rng = np.random.default_rng(0)
    body = Body(1.0, (0.02, 0.03, 0.04), rng.normal(size=(5, 3)), [0.0, 0.1, 0.0, 0.2, 0.3])
    plane = Plane((1, -2, 3), (0.1, 0.2, 0.3))
    box, spheres, frame, point = shapes.shapes(Scene(body, plane))
    assert box is None
    assert (spheres[:, 3] > 0).all()
    np.testing.assert_allclose(frame[:, 2], plane.normal)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
    gaps = (spheres[:, :3] - point) @ plane.normal - spheres[:, 3]
    np.testing.assert_allclose(gaps, plane.distance(body.hull) - body.radius, atol=1e-14)


def test_a_box_is_known_by_its_corners():
    cube = Body.box(1.0, (0.2, 0.4, 0.6))
    shifted = Body(1.0, (1, 1, 1), np.add(cube.hull[::-1], (0.01, 0.02, 0.03)))
    box = shapes.box_of(shifted)
    np.testing.assert_allclose(box.half, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(box.centre, [0.01, 0.02, 0.03])
    assert shapes.box_of(Body.box(1.0, (0.2, 0.4, 0.6), radius=0.01)) is None
    assert shapes.box_of(Body(1.0, (1, 1, 1), cube.hull[:7])) is None
    skewed = cube.hull.copy()
    skewed[0, 0] *= 1.01
    assert shapes.box_of(Body(1.0, (1, 1, 1), skewed)) is None


def test_what_is_missing_is_said_and_the_rest_goes_on(monkeypatch):
    monkeypatch.setattr(
        peers, "find_spec", lambda module: None if module in ("pydrake", "mujoco") else module
    )
    assert {engine.name for engine in peers.engines()} <= {"PyBullet", "Rapier"}
    with pytest.raises(EngineError, match=r"Drake is not installed; pip install 'flipcar\[drake\]'"):
        make("Drake")


def test_bad_names_are_refused():
    with pytest.raises(ValueError, match=r"name must be one of 'MuJoCo Euler'.*got 'Mujoco'"):
        make("Mujoco")
    with pytest.raises(ValueError, match=r"settings of Rapier must be one of 'iterations'.*got 'iteration'"):
        PEERS["Rapier"](iteration=3)
