"""A row: its size, its contacts, its car, and that the car in it moves as the solver's own."""

import numpy as np
import pytest

from flipcar_env import car, observe, starts
from flipcar_env import row as r
from flipcar_env import terrain as grounds
from flipcar_env.core import GRAVITY, Core
from flipcar_env.env import FlipCarEnv
from solver import impulse
from solver.model import MEMORY

HULL = np.array(list(car.HULL.values()))


def begun(core, kinds, seed=0):
    """The core, each environment at the start of an episode of the next of these kinds."""
    for i in range(core.n):
        core.seed(i, seed + i)
    core.begin(np.arange(core.n), core.start_kinds([kinds[i % len(kinds)] for i in range(core.n)]))
    return core


def actions(steps, n, seed=0):
    """(steps, n, 3) float32: torques that change now and then, and none in the last third."""
    rng = np.random.default_rng(seed)
    found = np.repeat(rng.uniform(-1.5, 1.5, (steps // 10 + 1, n, 3)), 10, axis=0)[:steps]
    found[2 * steps // 3 :] = 0.0
    return found.astype(np.float32)


def test_a_row_is_small():
    for obs in observe.KINDS:
        core = Core(2, obs=obs)
        assert core.rows[0].nbytes <= 1024
        assert np.shares_memory(core.states, core.rows)
        assert r.STATE + r.RESULTS + core.observed.shape[1] / 2 <= core.rows.shape[1]
    assert len(car.HULL) <= r.MAX_POINTS


def test_contacts_are_packed_and_unpacked_and_forces_beyond_the_slots_forgotten():
    rng = np.random.default_rng(0)
    row = np.full(r.width(10), 7.0)
    for closed in (0, 1, r.SLOTS, r.SLOTS + 1, len(HULL)):
        contacts = np.zeros((len(HULL), MEMORY))
        which = np.sort(rng.permutation(len(HULL))[:closed])
        contacts[which] = np.column_stack([np.ones(closed), rng.normal(size=(closed, 3))])
        r.store_contacts(row, contacts)
        found = np.full((len(HULL), MEMORY), np.nan)
        r.load_contacts(row, found)
        contacts[which[r.SLOTS :], 1:] = 0.0
        np.testing.assert_array_equal(found[:, 0], contacts[:, 0])
        np.testing.assert_array_equal(found[which], contacts[which])
    assert (row[: r.CLOSED] == 7.0).all()
    assert (row[r.STATE :] == 7.0).all()


@pytest.mark.parametrize("curved", [False, True])
def test_a_car_in_a_row_moves_as_the_solvers_own(curved):
    """Bit for bit, though between control steps the row keeps of its contacts only what it needs."""
    terrains = ("bumpy", "ditch") if curved else ("level", "slope")
    n, steps = 24, 250
    core = Core(n, terrain=[terrains[i % 2] for i in range(n)], randomize=[i % 4 > 1 for i in range(n)])
    begun(core, np.repeat(starts.KINDS, 4).tolist(), seed=50)
    rows, driven = core.states.copy(), actions(steps, n)
    seen = [core.states.copy()]
    for action in driven:
        core.step(action)
        seen.append(core.states.copy())
    most = max(int(closed).bit_count() for closed in np.array(seen)[:, :, r.CLOSED].ravel())
    assert 3 <= most <= r.SLOTS
    for i, row in enumerate(rows):
        ground = grounds.surface(terrains[i % 2])
        offset = row[r.OFFSET : r.OFFSET + 3]
        bound = car.body().bounding_radius + np.sqrt(offset @ offset)
        body = np.array([row[r.MASS], *row[r.INERTIA : r.INERTIA + 3], bound])
        hull = np.column_stack([HULL[:, :3] - offset, HULL[:, 3]])
        law = (row[r.FRICTION], row[r.RESTITUTION], True, True, True, row[r.FRICTION])
        state, contacts, f = row[:13].copy(), np.zeros((len(hull), MEMORY)), np.empty(len(hull))
        for t in range(steps):
            torque = np.clip(driven[t, i].astype(float), -1, 1) * row[r.LIMIT : r.LIMIT + 3]
            impulse.run(
                body, hull, (ground.parameters, ground.field), law, np.array([0, 0, -GRAVITY]), torque,
                state, contacts, f, np.zeros(0), core.control_dt / 10, 10,
            )  # fmt: skip
            np.testing.assert_array_equal(state, seen[t + 1][i, :13], err_msg=f"car {i}, step {t}")


def test_every_episode_draws_a_car_that_can_be_and_the_start_stays_the_same():
    core = Core(1, randomize=True)
    plain = Core(1)
    cars = []
    for episode in range(300):
        kind = starts.KINDS[episode % len(starts.KINDS)]
        for each in (core, plain):
            if episode == 0:
                each.seed(0, 3)
            each.begin(np.zeros(1, np.int64), each.start_kinds(kind))
        cars.append(core.states[0, r.CAR : r.CLOSED].copy())
        np.testing.assert_array_equal(core.states[0, 3:13], plain.states[0, 3:13])
        np.testing.assert_array_equal(core.check_states(core.states[0]), core.states[0])
        np.testing.assert_array_equal(plain.states[0, r.CAR : r.CLOSED], car.NOMINAL)
    cars = np.array(cars)
    moments = cars[:, 1:4].copy()
    assert (2.0 * moments.max(axis=1) <= moments.sum(axis=1) * (1 + 1e-12)).all()
    cars[:, 1:4] /= cars[:, :1] / car.MASS
    low, high = car.RANGES.T
    assert (cars >= low).all()
    assert (cars <= high * (1 + 1e-12)).all()
    assert (np.ptp(cars, axis=0) > 0.75 * (high - low)).all()
    for column in cars.T:
        assert len(np.unique(column)) == len(cars)
    others = np.delete(np.corrcoef(cars.T), [1, 2, 3], axis=0)  # an inertia may be cut to what can be
    assert np.abs(others[others < 0.999]).max() < 0.25


def test_a_heavier_car_falls_alike_and_one_with_more_inertia_spins_slower():
    env = FlipCarEnv()
    env.reset(seed=0, options={"start": "drop"})
    state = env.get_state()
    state[2], state[7:13] = 50.0, 0.0
    speeds, spins = [], []
    for scale in (1.0, 2.0):
        state[r.MASS] = scale * car.MASS
        state[r.INERTIA : r.INERTIA + 3] = scale * np.array(car.INERTIA)
        env.set_state(state)
        *_, info = env.step(np.array([1, 0, 0], np.float32))
        speeds.append(env.get_state()[9])
        spins.append(env.get_state()[10])
        z, v = env.get_state()[2], env.get_state()[7:10]
        kinetic = 0.5 * state[r.MASS] * v @ v + 0.5 * state[r.INERTIA] * spins[-1] ** 2
        assert info["energy"] == pytest.approx(kinetic + state[r.MASS] * GRAVITY * z)
    assert speeds[0] == speeds[1] == pytest.approx(-GRAVITY * 0.04)
    assert spins[0] == pytest.approx(2.0 * spins[1])
    state[r.LIMIT] = 0.5 * car.TORQUE_LIMIT[0]
    env.set_state(state)
    env.step(np.array([1, 0, 0], np.float32))
    assert env.get_state()[10] == pytest.approx(0.5 * spins[1])


def test_friction_restitution_and_the_centre_of_mass_are_the_rows():
    env = FlipCarEnv()
    env.reset(seed=0, options={"start": "upright"})
    upright = env.get_state()
    upright[3:13] = [1, 0, 0, 0, 0, 0, 0, 0, 0, 0]
    zero = np.zeros(3, np.float32)
    speed = 4.0
    for mu in car.FRICTION_RANGE:
        state = upright.copy()
        state[7], state[r.FRICTION] = speed, mu
        env.set_state(state)
        for _ in range(60):
            env.step(zero)
        slid = env.get_state()[0] - state[0]
        assert slid == pytest.approx(speed**2 / (2 * mu * GRAVITY), rel=1e-3)
    for e in (0.0, car.RESTITUTION_RANGE[1]):
        state = upright.copy()
        state[2] += 0.5
        state[r.RESTITUTION] = e
        env.set_state(state)
        highest = 0.0
        for t in range(20):
            env.step(zero)
            if t > 8:  # it lands in step 7
                highest = max(highest, env.get_state()[2] - upright[2])
        assert highest == pytest.approx(e * e * 0.5, abs=2e-3)
    # standing on one's wheels with the weight to the left and behind: more of it there
    state = upright.copy()
    offset = np.array([-0.08, 0.05, 0.04])
    state[r.OFFSET : r.OFFSET + 3] = offset
    state[2] += offset[2]
    env.set_state(state)
    for _ in range(50):
        env.step(zero)
    np.testing.assert_allclose(env.get_state()[:7], state[:7], atol=1e-6)
    load = env.contact_impulses()[:4, 2]
    along = [p * np.sign(HULL[:4, axis]) @ load for axis, p in ((0, 1.25), (1, 0.72))]
    np.testing.assert_allclose(along / load.sum(), offset[:2], rtol=1e-6)


def test_a_randomised_episode_can_be_replayed_from_its_state():
    env = FlipCarEnv(randomize=True, obs="privileged", terrain="slope")
    env.reset(seed=8, options={"start": "side"})
    driven = actions(40, 1)[:, 0]
    for action in driven:
        last, *_ = env.step(action)
    state = env.get_state()

    def future(env):
        return [np.append(*env.step(action)[:2]) for action in driven] + [env.reset()[0]]

    first = future(env)
    other = FlipCarEnv(randomize=True, obs="privileged", terrain="slope")
    obs, _info = other.reset(options={"state": state})
    np.testing.assert_array_equal(obs, last)
    for a, b in zip(first, future(other), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_privileged_observation_holds_the_others_and_the_car():
    n, steps = 12, 120
    cores = {kind: begun(Core(n, randomize=True, obs=kind), starts.KINDS) for kind in observe.KINDS}
    driven = actions(steps, n)
    for t in range(steps + 1):
        everything = cores["privileged"].observed
        assert all(cores["privileged"].observation_space.contains(obs) for obs in everything)
        np.testing.assert_array_equal(everything[:, :13], cores["state"].observed)
        np.testing.assert_array_equal(everything[:, 13:23], cores["egocentric"].observed)
        down = everything[:, 23:49] @ 2.0 ** np.arange(26)
        np.testing.assert_array_equal(down, cores["privileged"].states[:, r.CLOSED])
        np.testing.assert_allclose(everything[:, 61], 1 - t / 250, rtol=1e-6)
        given = [np.clip(driven[i], -1, 1) if i >= 0 else np.zeros((n, 3)) for i in (t - 2, t - 1)]
        np.testing.assert_array_equal(everything[:, 62:], np.hstack(given))
        np.testing.assert_array_equal(
            np.hstack([cores["egocentric"].observed, given[1]]), cores["egocentric+action"].observed
        )
        if t < steps:
            for core in cores.values():
                core.step(driven[t])
    assert 0.0 < everything[:, 23:49].mean() < 0.2
    scaled = everything[:, 49:61]
    low, high = car.RANGES.T
    cars = low + 0.5 * (scaled + 1) * (high - low)
    cars[:, 1:4] *= cars[:, :1] / car.MASS
    np.testing.assert_allclose(cars, cores["privileged"].states[:, r.CAR : r.CLOSED], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        (r.MASS, 0.0, "mass"),
        (r.INERTIA, -1.0, "inertia"),
        (r.INERTIA + 2, 2400.0, "inertia"),
        (r.FRICTION, -0.1, "friction"),
        (r.RESTITUTION, 1.1, "restitution"),
        (r.LIMIT + 1, -1.0, "torque limits"),
        (r.OFFSET, np.inf, "finite"),
        (r.CLOSED, 2.0 ** len(HULL), "contacts"),
        (r.CLOSED, 0.5, "contacts"),
        (r.START, 9, "start"),
    ],
)
def test_a_state_with_an_impossible_car_is_refused_by_name(column, value, words):
    env = FlipCarEnv()
    env.reset(seed=0)
    before = env.core.rows.copy()
    state = env.get_state()
    state[column] = value
    with pytest.raises(ValueError, match=words):
        env.set_state(state)
    np.testing.assert_array_equal(env.core.rows, before)


@pytest.mark.parametrize("value", ["yes", 1, None, [True], [True, 1, False]])
def test_randomize_is_a_truth_or_one_for_each(value):
    with pytest.raises(ValueError, match="randomize"):
        Core(3, randomize=value)


@pytest.mark.parametrize("delay", [1, 2])
def test_a_delayed_action_is_one_given_later_and_is_in_the_state(delay):
    n, steps = 9, 40
    late, soon = Core(n, randomize=True, action_delay=delay), Core(n, randomize=True)
    begun(late, starts.KINDS)
    begun(soon, starts.KINDS)
    driven = actions(steps, n)
    motion = np.r_[0 : r.GIVEN, r.FORCES : r.STATE]
    for t in range(steps):
        saved = late.states.copy()
        late.step(driven[t])
        soon.step(driven[t - delay] if t >= delay else np.zeros((n, 3), np.float32))
        np.testing.assert_array_equal(late.states[:, motion], soon.states[:, motion])
        np.testing.assert_array_equal(late.results, soon.results)
        given = late.states[:, r.GIVEN : r.FORCES].reshape(n, -1, 3)
        np.testing.assert_array_equal(given[:, -1], np.clip(driven[t], -1, 1))
        np.testing.assert_array_equal(given[:, -2], np.clip(driven[t - 1], -1, 1) if t else 0.0)
    again = late.rows.copy()
    late.put_states(saved, np.arange(n))
    late.step(driven[t])
    np.testing.assert_array_equal(late.rows, again)


def test_sensors_err_as_told_and_change_nothing_else():
    n, steps = 40, 60
    driven = actions(steps, n)
    for obs in ("egocentric", "state"):
        true, noisy = (begun(Core(n, obs=obs, sensor_noise=s), ["drop"]) for s in (0.0, 2.0))
        errors = [noisy.observed - true.observed]
        for action in driven:
            noisy.step(action)
            true.step(action)
            errors.append(noisy.observed - true.observed)
            np.testing.assert_array_equal(noisy.states, true.states)
            np.testing.assert_array_equal(noisy.results, true.results)
        assert all(noisy.observation_space.contains(one) for one in noisy.observed)
        errors = np.array(errors) / (2.0 * observe.SENSORS[obs])
        free = np.abs(true.observed).max(axis=0) < 0.9 * noisy.observation_space.high  # not clipped
        assert free.sum() >= 7
        flat = errors.reshape(-1, errors.shape[-1])[:, free]
        np.testing.assert_allclose(flat.std(axis=0), 1.0, rtol=0.05)
        np.testing.assert_allclose(flat.mean(axis=0), 0.0, atol=0.08)
        assert np.abs(np.corrcoef(flat.T) - np.eye(free.sum())).max() < 0.1
        assert abs(np.mean(errors[1:, :, free] * errors[:-1, :, free])) < 0.05
        seen = noisy.observed.copy()
        noisy.put_states(noisy.states.copy(), np.arange(n))
        np.testing.assert_array_equal(noisy.observed, seen)
    exact, noisy = (begun(Core(3, obs="privileged", sensor_noise=s), ["drop"]) for s in (0.0, 1.0))
    np.testing.assert_array_equal(exact.observed, noisy.observed)


def test_late_and_noisy_cars_have_the_same_bits_alone_and_in_lanes():
    n, steps = 9, 30
    options = {"action_delay": 1, "sensor_noise": 1.0, "randomize": True}
    batch = begun(Core(n, **options), starts.KINDS)
    alone = [begun(Core(1, **options), [starts.KINDS[i % 6]], seed=i) for i in range(n)]
    for action in actions(steps, n):
        batch.step(action)
        for i, one in enumerate(alone):
            one.step(action[i : i + 1])
    np.testing.assert_array_equal(batch.rows, np.concatenate([one.rows for one in alone]))


@pytest.mark.parametrize(
    ("name", "value"), [("action_delay", 3), ("action_delay", 0.5), ("sensor_noise", -1.0)]
)
def test_delays_and_noise_that_cannot_be_are_named(name, value):
    with pytest.raises(ValueError, match=name):
        Core(1, **{name: value})
