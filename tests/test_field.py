"""Height fields: distance, normal and curvature, and what bodies do on curved ground."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import random_body, random_quat, turned

from solver import Body, HeightField, Plane, Scene, State, simulate
from solver.field import bounds, tangents
from solver.model import MEMORY, load, unpack
from solver.project import clearance, lowest_open
from solver.scene import to_kernel

UPRIGHT = [1, 0, 0, 0]
ZERO = [0, 0, 0]
g = 9.81


def hills(rng, cells=12, slope=0.25):
    """A random field, 12 m by 12 m about the origin, and points on it with their normals."""
    field = HeightField(slope * rng.uniform(-0.5, 0.5, (cells, cells)), 1.0, (-cells / 2, -cells / 2, 1))
    above = np.column_stack([rng.uniform(-cells, cells, (60, 2)), np.full(60, 1.0)])
    phi, N = np.split(field.feet(above)[:, :4], [1], axis=1)
    return field, above - phi * N, N


def symmetric(six):
    """(..., 3, 3) from (xx, xy, xz, yy, yz, zz)."""
    return six[..., [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(*six.shape[:-1], 3, 3)


def derivative(function, points, step=1e-4):
    """∂/∂(x, y, z) by differences of fourth order, in a new last axis."""
    ends = [
        (
            8 * (function(points + e) - function(points - e))
            - function(points + 2 * e)
            + function(points - 2 * e)
        )
        / (12 * step)
        for e in step * np.eye(3)
    ]
    return np.stack(ends, -1)


@given(st.integers(0, 2**32 - 1), st.floats(-0.7, 0.7))
@settings(max_examples=40, deadline=None, derandomize=True)
def test_distance_normal_and_curvature(seed, far):
    """At a distance of up to 0.7 radii of curvature on either side, where spheres would touch too."""
    field, feet, N = hills(np.random.default_rng(seed))
    phi = far / (field.valley if far > 0 else field.bump)
    points = feet + phi * N
    out = field.feet(points)
    np.testing.assert_allclose(out[:, 0], phi, rtol=0, atol=1e-13)
    np.testing.assert_allclose(out[:, 1:4], N, rtol=0, atol=1e-12)
    H = symmetric(out[:, 4:])
    np.testing.assert_allclose(np.einsum("nij,nj->ni", H, N), 0, atol=1e-12)
    # but for the points near a knot, where the third derivative jumps
    np.testing.assert_allclose(derivative(field.distance, points), N, rtol=0, atol=1e-8)
    assert np.median(np.abs(derivative(lambda r: field.feet(r)[:, 1:4], points) - H)) < 1e-10
    np.testing.assert_allclose(
        derivative(lambda r: field.feet(r)[:, 1:4], points), H, rtol=0, atol=1e-3 * (1 + np.abs(H).max())
    )


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 0.15))
@settings(max_examples=40, deadline=None, derandomize=True)
def test_the_height_straight_below_bounds_the_distance(seed, slope):
    """Above and under the ground: what is looked at no closer has no part in a contact."""
    rng = np.random.default_rng(seed)
    field, feet, _N = hills(rng, slope=slope)
    points = feet + np.column_stack([np.zeros((60, 2)), rng.normal(size=60) * 10 ** rng.uniform(-4, 0, 60)])
    for r, phi in zip(points, field.distance(points), strict=True):
        low, high = bounds(field.field, tuple(r))
        assert low - 1e-13 <= phi <= high + 1e-13


@given(st.integers(0, 2**32 - 1), st.floats(-0.02, 0.02))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_the_deepest_point_is_found_without_a_foot_for_each(seed, depth):
    """Wherever the body is: over, on or in the ground; and no clearance promises more than there is."""
    rng = np.random.default_rng(seed)
    field, _feet, _N = hills(rng, slope=0.15)
    scene = Scene(random_body(rng, 8), field)
    state = State([*rng.uniform(-5, 5, 2), 3.0], random_quat(rng), ZERO, ZERO)
    for _ in range(20):
        state.x[2] += depth - scene.gap(state).min()
    gaps = scene.gap(state)
    body, hull, ground, _law = scene.parameters
    ground = unpack(body, ground)[1]
    x, quat, _v, _w = load(to_kernel(scene.body, state)[0])
    contacts = np.zeros((8, MEMORY))
    k, least = lowest_open(hull, ground, quat, x, contacts)
    assert k == gaps.argmin()
    assert least == pytest.approx(gaps.min(), abs=1e-13)
    for enough in (0.0, 0.01, np.inf):
        clear = clearance(hull, ground, quat, x, contacts, enough)
        assert clear <= gaps.min() + 1e-13
        assert clear > enough or clear == pytest.approx(gaps.min(), abs=1e-13)


def test_no_point_of_the_surface_is_nearer():
    rng = np.random.default_rng(1)
    field, feet, N = hills(rng)
    x, y = np.meshgrid(*2 * [np.linspace(-14, 14, 701)], indexing="ij")
    level = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 1.0)])
    phi, normal = np.split(field.feet(level)[:, :4], [1], axis=1)
    surface = level - phi * normal
    for t in (-0.5 / field.bump, 0.1, 0.5 / field.valley, 0.9 / field.valley):
        for r in (feet + t * N)[:12]:
            nearest = np.linalg.norm(surface - r, axis=1).min()
            assert abs(field.distance(r)) <= nearest + 1e-12
            assert nearest <= abs(t) + 0.03  # and they are dense enough to tell
    high = field.distance(rng.uniform([-9, -9, 3], [9, 9, 9], (500, 3)))
    assert (high > 1 / field.valley).all() or field.valley < 1


def test_it_goes_through_the_grid_and_on_level_beyond_it():
    rng = np.random.default_rng(2)
    grid = 0.2 * rng.uniform(-1, 1, (7, 5))
    field = HeightField(grid, 2.0, (1, -3, 0.5))
    i, j = np.meshgrid(np.arange(7), np.arange(5), indexing="ij")
    points = np.stack([1 + 2.0 * i, -3 + 2.0 * j, 0.5 + grid], -1)
    np.testing.assert_allclose(field.distance(points), 0, atol=1e-15)
    far = field.feet(np.array([[1e9, 1e9, 7.0], [1e9 + 5, -1e9, 7.0], [1e9, -1e9 - 7, 7.0]]))
    np.testing.assert_array_equal(far[:, 1:], np.tile([0, 0, 1] + [0] * 6, (3, 1)))
    assert far[1, 0] == far[2, 0]


def test_axes_turn_without_a_jump_and_are_square():
    rng = np.random.default_rng(3)
    for _ in range(200):
        slope = np.sqrt(3) * np.sqrt(rng.uniform()) * np.array([np.cos(a := rng.uniform(0, 7)), np.sin(a)])
        N = np.array([*-slope, 1]) / np.sqrt(1 + slope @ slope)
        axes = np.array([N, *tangents(tuple(N))])
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(axes) == pytest.approx(1)
        near = N + 1e-6 * rng.normal(size=3)
        change = np.array(tangents(tuple(near / np.linalg.norm(near)))) - axes[1:]
        assert np.abs(change).max() < 2e-5


# ---------------------------------------------------------------- the article's quantities


def tilted():
    """A plane, and the same as a height field."""
    a, b = 0.3, -0.2
    x = np.arange(-12.0, 13.0)
    return Plane((-a, -b, 1), (0, 0, 0.4)), HeightField(a * x[:, None] + b * x, 1.0, (-12, -12, 0.4))


@pytest.mark.parametrize("seed", range(20))
def test_a_straight_field_is_the_plane(seed):
    rng = np.random.default_rng(seed)
    body = random_body(rng, points=6)
    state = State(rng.normal(size=3), random_quat(rng), rng.normal(size=3), 3 * rng.normal(size=3))
    plane, field = (Scene(body, ground, restitution=0.4) for ground in tilted())
    force, torque = rng.normal(size=3), rng.normal(size=3)
    expected, contact = plane.contact(state, force, torque), field.contact(state, force, torque)
    for name in ("gap", "v", "G", "l", "f", "i"):
        np.testing.assert_allclose(getattr(contact, name), getattr(expected, name), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("method", ["impulse", "acceleration", "baumgarte"])
def test_a_run_on_a_straight_field_is_the_planes(method):
    body = Body.box(1.0, (0.3, 0.4, 0.5), radius=0.02) if method == "impulse" else Body.sphere(1.0, 0.2)
    state = State([0, 0, 1.0], turned([1, 2, 3], 0.7), [0.5, 0.2, 0], [1, 2, -1])
    e = 0.3 if method == "impulse" else 0.0
    plane, field = (
        simulate(Scene(body, ground, friction=0.3, restitution=e), state, 1.0, method=method)
        for ground in tilted()
    )
    assert plane.f.max() > 1
    for name in ("x", "quat", "v", "w"):
        np.testing.assert_allclose(getattr(field, name), getattr(plane, name), atol=1e-8)
    np.testing.assert_allclose(field.f, plane.f, atol=1e-5)


@pytest.mark.parametrize("seed", range(20))
def test_l_is_the_acceleration_of_the_gap_in_free_motion(seed):
    """Eqs. 5 and 6 with the curvature term, against second differences of φ along a flight."""
    rng = np.random.default_rng(seed)
    field, feet, N = hills(rng)
    body = random_body(rng, points=4)
    scene = Scene(body, field)
    flight = Scene(body, Plane(point=(0, 0, -100)))
    state = State(feet[0] + 0.2 * N[0], random_quat(rng), rng.normal(size=3), 2 * rng.normal(size=3))
    back = State(state.x, state.quat, -state.v, -state.w)

    def gaps(t):
        return (scene.gap(simulate(flight, s, t, dt=t).state) for s in (state, back))

    def differences(t):
        after, before = gaps(t)
        return (after - before) / (2 * t), (after - 2 * scene.gap(state) + before) / t**2

    (v, l), (v2, l2) = differences(4e-3), differences(2e-3)
    contact = scene.contact(state)
    near = np.abs(contact.gap) < 0.5 / max(field.valley, field.bump)
    np.testing.assert_allclose(((4 * v2 - v) / 3)[near], contact.v[near], atol=1e-5)
    np.testing.assert_allclose(((4 * l2 - l) / 3)[near], contact.l[near], rtol=1e-3, atol=5e-3)


# ---------------------------------------------------------------- motion

DITCH = HeightField.named("ditch", depth=0.5, width=3.0)


def on(surface, x, y, rho, v=0.0):
    """A ball of radius ρ that touches near (x, y) and rolls along y at v."""
    point = np.array([x, y, 0.0])
    phi, *N = surface.feet(point)[:4]
    N = np.array(N)
    return State(point + (rho - phi) * N, UPRIGHT, [0, v, 0], [-v / (rho * N[2]), 0, 0])


@pytest.mark.parametrize("mu", [0.0, 0.9])
def test_a_ball_in_a_ditch_is_second_order_and_stays_on_it(mu):
    """It slides, or rolls, to and fro and along: energy is kept. Without Eq. 5's curvature it is not."""
    scene = Scene(Body.sphere(1.0, 0.1), DITCH, friction=mu)
    state = on(DITCH, 0.8, 0.0, 0.1, v=0.2)
    errors = []
    for hz in (120, 240, 480, 960):
        run = simulate(scene, state, 1.5, dt=1 / hz)
        errors.append(np.abs(run.energy - run.energy[0]).max())
        past = State(run.x, run.quat, run.v, run.w)
        assert np.abs(scene.gap(past)).max() < 1e-12
        assert np.abs(scene.contact(past).v).max() < 60 / hz**2
        assert (run.f[1:] > 0).all()
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders.min() > 1.9, (errors, orders)
    assert errors[1] < 2e-4


@pytest.mark.parametrize(("mu", "slower"), [(0.0, 1.0), (0.9, 1.4)])
def test_small_oscillations_in_a_ditch(mu, slower):
    """The centre swings on a circle of radius 1/κ − ρ; a solid ball that rolls has 7/5 of its inertia."""
    rho = 0.1
    curvature = -DITCH.feet([0, 0, -0.5])[4]
    assert curvature == pytest.approx(8 * 0.5 / 3.0**2, rel=1e-3)
    run = simulate(Scene(Body.sphere(1.0, rho), DITCH, friction=mu), on(DITCH, 0.002, 0, rho), 9.0)
    x = run.x[:, 0]
    k = np.flatnonzero((x[:-1] > 0) & (x[1:] <= 0))
    crossings = run.t[k] + x[k] / (x[k] - x[k + 1]) / 240
    period = 2 * np.pi * np.sqrt(slower * (1 / curvature - rho) / g)
    np.testing.assert_allclose(np.diff(crossings), period, rtol=1e-4)


def test_acceleration_follows_the_ditch_to_first_order():
    """ "acceleration" has the curvature in l; the gap it drifts by halves with the step."""
    scene = Scene(Body.sphere(1.0, 0.1), DITCH)
    drift = [
        np.abs(scene.gap(simulate(scene, on(DITCH, 0.8, 0, 0.1), 0.5, dt=dt, method="acceleration").state))[0]
        for dt in (1e-3, 5e-4)
    ]
    assert drift[0] / drift[1] == pytest.approx(2, rel=0.1)
    assert drift[0] < 2e-3


def tosses(rng, n, high=1.0):
    """n boxes or so, thrown at random over the middle of a field."""
    quats = np.array([random_quat(rng) for _ in range(n)])
    x = np.column_stack([rng.uniform(-5, 5, (n, 2)), np.full(n, high)])
    return State(x, quats, rng.normal(size=(n, 3)), 5 * rng.normal(size=(n, 3)))


@pytest.mark.parametrize("seed", range(4))
def test_boxes_tossed_on_bumps_neither_sink_nor_gain_energy_and_come_to_rest(seed):
    rng = np.random.default_rng(seed)
    bumps = HeightField.named("bumpy", height=0.1, seed=seed)
    body = Body.box(1.0, (0.3, 0.4, 0.5), radius=[0.0, 0.05][seed % 2])
    scene = Scene(body, bumps, friction=0.6, restitution=0.2)
    state = tosses(rng, 16)
    run = simulate(scene, state, 6.0)
    E0 = run.energy[0] + g * 0.1  # above the lowest ground
    energy = run.energy / E0
    assert np.diff(energy, axis=0).max() <= 1e-6, "energy rose in a step"
    assert (energy - np.minimum.accumulate(energy, axis=0)).max() <= 5e-6, "energy crept up"
    past = State(
        *(
            getattr(run, name).reshape(-1, k)
            for name, k in zip(["x", "quat", "v", "w"], [3, 4, 3, 3], strict=True)
        )
    )
    assert scene.gap(past).min() > -2e-7
    np.testing.assert_allclose(np.r_[run.v[-1], run.w[-1]], 0, atol=1e-9)
    assert (np.sort(np.abs(scene.gap(run.state)), axis=1)[:, :3] <= 1e-6).all()
    alone = simulate(scene, State(state.x[5], state.quat[5], state.v[5], state.w[5]), 6.0)
    np.testing.assert_array_equal(alone.x, run.x[:, 5])
    threads = simulate(scene, state, 0.5, threads=2)
    np.testing.assert_array_equal(threads.x, run.x[: len(threads.t)])


@pytest.mark.parametrize("speed", [5.0, 50.0, 300.0])
def test_nothing_tunnels(speed):
    """Balls and boxes fly into the bumps, also flat over them, so fast that a step crosses several."""
    rng = np.random.default_rng(0)
    bumps = HeightField.named("bumpy", height=0.1)
    n = 30
    direction = rng.normal(size=(n, 3)) * [1, 1, 0.3]
    direction[:, 2] = -np.abs(direction[:, 2])
    v = speed * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    start = tosses(rng, n, high=0.6)
    state = State(start.x, start.quat, v, start.w)
    for body in (Body.sphere(1.0, 0.05), Body.box(1.0, (0.3, 0.4, 0.5))):
        scene = Scene(body, bumps, friction=0.3, restitution=0.3)
        run = simulate(scene, state, 10 / speed, dt=1 / 240)
        gap = scene.gap(
            State(run.x.reshape(-1, 3), run.quat.reshape(-1, 4), run.v.reshape(-1, 3), run.w.reshape(-1, 3))
        )
        assert gap.min() > -2e-7
        assert np.diff(run.energy, axis=0).max() <= 1e-6 * run.energy[0].max()


def test_a_ball_skims_no_bump():
    """So fast and flat that within a step it would be over the bump, its gap the same at both ends."""
    x = np.linspace(-1, 1, 41)
    bump = 0.1 * np.exp(-20 * x**2)
    scene = Scene(
        Body.sphere(1.0, 0.05), HeightField(np.tile(bump[:, None], 3), 0.05, (-1, 0, 0)), gravity=ZERO
    )
    run = simulate(scene, State([-2, 0, 0.1], UPRIGHT, [960, 0, 0], ZERO), 1 / 60, dt=1 / 240)
    assert run.f.max() > 0
    assert run.v[-1, 2] > 100


def test_mirror_images():
    rng = np.random.default_rng(4)
    grid = 0.1 * rng.uniform(-1, 1, (20, 21))
    body = Body(1.0, (0.01, 0.012, 0.014), [(0.03, 0, 0.01)], radius=0.1)
    flip, spin = np.array([1, -1, 1]), np.array([-1, 1, -1])
    state = State([0.1, 0.2, 0.5], turned([1, 2, 3], 0.5), [1, 0.7, 0], [5, -3, 8])
    image = State(state.x * flip, state.quat * [1, *spin], state.v * flip, state.w * spin)
    runs = [
        simulate(
            Scene(body, HeightField(grid[:, order], 0.8, (-8, -8, 0)), friction=0.4, restitution=0.5), s, 2.0
        )
        for order, s in ((slice(None), state), (slice(None, None, -1), image))
    ]
    assert (runs[0].f > 0).sum() > 5
    np.testing.assert_allclose(runs[1].x, runs[0].x * flip, atol=1e-9)
    np.testing.assert_allclose(runs[1].w, runs[0].w * spin, atol=1e-7)


def test_a_shallow_overlap_is_lifted_out():
    scene = Scene(Body.box(1.0, (1, 1, 1)), HeightField.named("ramp"), friction=0.8)
    start = State([2, 0, 1.2], UPRIGHT, ZERO, ZERO)
    assert -0.04 < scene.gap(start).min() < -0.01
    run = simulate(scene, start, 0.0)
    assert scene.gap(run.state).min() == pytest.approx(0, abs=1e-9)


def test_a_ball_rolls_off_the_grid_and_on():
    ramp = HeightField.named("ramp", height=0.5, length=3.0)
    scene = Scene(Body.sphere(1.0, 0.1), ramp, friction=0.9)
    run = simulate(scene, on(ramp, 2.0, 0, 0.1), 60.0, record_every=240)
    assert run.x[-1, 0] < -50
    speed = np.sqrt(10 / 7 * g * (run.x[0, 2] - 0.1))
    assert run.v[-1, 0] == pytest.approx(-speed, rel=1e-4)
    assert scene.gap(run.state)[0] == pytest.approx(0, abs=1e-12)


# ---------------------------------------------------------------- errors

FLAT = np.zeros((4, 4))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: HeightField([[0, 0]], 1), ["grid", "(a, b) with both >= 2", "(1, 2)"]),
        (lambda: HeightField([0, 0], 1), ["grid", "(2,)"]),
        (lambda: HeightField([[0, np.nan], [0, 0]], 1), ["grid must be finite"]),
        (lambda: HeightField(FLAT, 0), ["spacing must be >= 1e-06", "0"]),
        (lambda: HeightField(FLAT, np.inf), ["spacing must be finite"]),
        (lambda: HeightField(FLAT, 1, (0, 0)), ["origin", "(3,)", "(2,)"]),
        (lambda: HeightField([[0, 0], [9, 9]], 1), ["grid must not be steeper than 60°", "°"]),
        (lambda: HeightField([[0, 0], [1e308, -1e308]], 1), ["grid must not be steeper"]),
        (lambda: HeightField.named("moon"), ["name", "'bumpy', 'ditch', 'ramp'", "'moon'"]),
        (lambda: HeightField.named("ditch", deep=1), ["'ditch'", "'depth', 'width'", "'deep'"]),
        (lambda: HeightField.named("ditch", width=-1), ["width must be > 0", "-1"]),
        (lambda: HeightField.named("bumpy", size=0.1), ["size must be >= 2", "0.1"]),
        (lambda: HeightField.named("bumpy", seed="x"), ["seed", "x"]),
        (lambda: HeightField.named("bumpy", height=3), ["steeper than 60°"]),
        (
            lambda: Scene(Body.sphere(1, 3.0), DITCH),
            ["radius must be <= 1.79", "radii of curvature down to 2.24", "3"],
        ),
        (lambda: Scene(Body.sphere(1, 1.0), "hill"), ["Plane or a HeightField", "hill"]),
    ],
)
def test_bad_input(call, words):
    with pytest.raises(ValueError) as caught:
        call()
    for word in words:
        assert word in str(caught.value)
