"""The recording is read back and compared with the episode that it was made from."""

import ipaddress
import os
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import rerun as rr
import rerun_cli
from rerun.chunk import RrdReader

from flipcar_env import car, recording, terrain
from flipcar_env import row as r
from flipcar_env.core import Core
from flipcar_env.env import FlipCarEnv
from flipcar_env.episode import PHASES, Episode, hull_points, phases, touching
from flipcar_env.recording import entities
from flipcar_env.recording.viewer import command
from flipcar_env.rollout import play, replay
from solver.rotation import to_matrix

N_POINTS = len(car.HULL)
WEIGHT = car.MASS * 9.81


@pytest.fixture(autouse=True)
def _strict():
    rr.set_strict_mode(True)  # otherwise wrong shapes only warn
    yield
    rr.set_strict_mode(False)


def episode(steps: int = 26, seed: int = 0, **changes) -> Episode:
    """A car that rolls from its roof onto its wheels; every third step it is in the air."""
    rng = np.random.default_rng(seed)
    t = 0.04 * np.arange(steps)
    roll = np.linspace(np.pi, 0.0, steps)
    force = np.zeros((steps, N_POINTS, 3))
    for i in range(1, steps):
        if i % 3:
            force[i, rng.choice(N_POINTS, size=i % 3, replace=False)] = [100.0, -50.0, WEIGHT / 2]
    terms = {"upright": -np.cos(roll), "effort": rng.normal(size=steps)}
    values = {
        "t": t,
        "x": rng.normal(size=(steps, 3)),
        "quat": np.column_stack([np.cos(roll / 2), np.sin(roll / 2) * 0.6, np.sin(roll / 2) * 0.8, 0 * roll]),
        "v": rng.normal(size=(steps, 3)),
        "w": rng.normal(size=(steps, 3)),
        "action": rng.uniform(-1, 1, size=(steps, 3)),
        "torque": rng.uniform(-1, 1, size=(steps, 3)) * car.TORQUE_LIMIT,
        "force": force,
        "tilt": roll,
        "energy": rng.normal(size=steps),
        "work": np.cumsum(rng.uniform(size=steps)),
        "reward": sum(terms.values()),
        "reward_terms": terms,
        "start": "roof",
        "policy": "nominal",
        "is_success": True,
    }
    return Episode(**(values | changes))


def read(path: Path, entity: str, component: str) -> tuple[np.ndarray, list]:
    """Times in seconds, and one list of instances a row."""
    times, rows = [], []
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and component in batch.schema.names and not chunk.is_static:
            times.append(batch.column(recording.TIMELINE).to_numpy() / np.timedelta64(1, "s"))
            rows += batch.column(component).to_pylist()
    return np.concatenate(times), rows


def test_poses_are_the_episodes(tmp_path):
    e = episode()
    path = recording.save(tmp_path / "a.rrd", [e])
    t, x = read(path, "/world/car", "Transform3D:translation")
    _, quat = read(path, "/world/car", "Transform3D:quaternion")
    np.testing.assert_allclose(t, e.t, atol=1e-9)
    np.testing.assert_array_equal(np.array(x)[:, 0], e.x.astype(np.float32))
    xyzw = e.quat[:, [1, 2, 3, 0]].astype(np.float32)
    np.testing.assert_array_equal(np.array(quat)[:, 0], xyzw)


def test_contacts_are_the_episodes_and_cleared_in_the_air(tmp_path):
    e = episode()
    path = recording.save(tmp_path / "a.rrd", [e])
    _, points = read(path, "/world/contacts/points", "Points3D:positions")
    _, normal = read(path, "/world/contacts/normal", "Arrows3D:vectors")
    _, friction = read(path, "/world/contacts/friction", "Arrows3D:vectors")
    _, origins = read(path, "/world/contacts/normal", "Arrows3D:origins")
    hull = np.array(list(car.HULL.values()))
    assert len(points) == len(normal) == len(friction) == len(origins) == len(e.t)
    for i in range(len(e.t)):
        touching = np.flatnonzero(e.force[i].any(axis=1))
        assert len(points[i]) == len(normal[i]) == len(friction[i]) == len(touching) == (i % 3)
        if not len(touching):
            continue
        w, x, y, z = e.quat[i]
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        expected = e.x[i] + hull[touching, :3] @ rotation.T
        expected[:, 2] -= hull[touching, 3]
        np.testing.assert_allclose(points[i], expected, atol=1e-5)
        force = np.add(normal[i], friction[i]) * entities.NEWTON_PER_METRE
        np.testing.assert_allclose(force, e.force[i, touching], rtol=1e-5, atol=1e-3)
        np.testing.assert_array_equal(np.array(normal[i])[:, :2], 0.0)
        np.testing.assert_allclose(np.add(origins[i], normal[i]), points[i], atol=1e-5)


def test_plots_are_the_episodes(tmp_path):
    e = episode()
    path = recording.save(tmp_path / "a.rrd", [e])
    expected = {
        "upright": np.cos(e.tilt),
        "height": e.x[:, 2],
        "torque/roll": e.torque[:, 0] / 1e3,
        "torque/pitch": e.torque[:, 1] / 1e3,
        "torque/yaw": e.torque[:, 2] / 1e3,
        "energy/mechanical": e.energy / 1e3,
        "energy/work": e.work / 1e3,
        "reward/upright": e.reward_terms["upright"],
        "reward/effort": e.reward_terms["effort"],
    }
    for name, values in expected.items():
        t, rows = read(path, f"/plots/{name}", "Scalars:scalars")
        assert rows[-1] == [], "the last row ends the curve"
        np.testing.assert_allclose(t[:-1], e.t, atol=1e-9)
        np.testing.assert_array_equal(np.array(rows[:-1])[:, 0], values)


def test_status_tells_the_outcome(tmp_path):
    path = recording.save(
        tmp_path / "a.rrd", [episode(), episode(is_success=False, start="side", policy="pump")]
    )
    _, rows = read(path, "/status", "TextDocument:text")
    texts = [text for (text,) in rows]
    assert len(texts) == 2 * 26
    assert "roof" in texts[0]
    assert "nominal" in texts[0]
    assert "episode 1 of 2" in texts[0]
    assert "Running" in texts[24]
    assert "**Recovered** in 1.00 s" in texts[25]
    assert "side" in texts[-1]
    assert "pump" in texts[-1]
    assert "**Not recovered**" in texts[-1]


def test_episodes_follow_one_another(tmp_path):
    late = episode(seed=1)
    late = episode(seed=1, t=late.t + 7.0)  # its own clock need not start at zero
    other = episode(steps=11, reward_terms={})
    path = recording.save(tmp_path / "a.rrd", [episode(), late, other])
    t, _ = read(path, "/world/car", "Transform3D:translation")
    starts = recording.start_times([episode(), late, other])
    np.testing.assert_allclose(starts, [0.0, 2.0, 4.0])
    assert np.all(np.diff(t) > 0)
    np.testing.assert_allclose(t[[0, 25, 26, 51, 52, 62]], [0.0, 1.0, 2.0, 3.0, 4.0, 4.4])
    _, upright = read(path, "/plots/reward/upright", "Scalars:scalars")
    assert len(upright) == 2 * 27, "the third episode has no such term"


def test_file_is_sound_and_complete(tmp_path):
    path = recording.save(tmp_path / "a.rrd", [episode()])
    binary = Path(rerun_cli.__file__).parent / "rerun"
    run = subprocess.run([binary, "rrd", "verify", path], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    reader = RrdReader(path)
    assert len(reader.blueprints()) == 1
    assert [entry.application_id for entry in reader.recordings()] == ["flipcar"]
    entities = {chunk.entity_path for chunk in reader.stream()}
    assert entities >= {
        "/world/car",
        "/world/car/body",
        "/world/car/wheels",
        "/world/ground",
        "/world/trail",
        "/world/contacts/points",
        "/world/contacts/normal",
        "/world/contacts/friction",
        "/world/contacts/blows",
        "/world/contacts/support",
        "/world/grid",
        "/world/torque",
        "/phase",
        "/status",
    }
    timelines = {name for chunk in reader.stream() for name in chunk.timeline_names}
    assert timelines == {recording.TIMELINE}


@pytest.mark.parametrize("steps", [1, 2])
def test_short_episode_without_contacts(tmp_path, steps):
    e = episode(steps, force=np.zeros((steps, N_POINTS, 3)))
    path = recording.save(tmp_path / "a.rrd", [e])
    _, points = read(path, "/world/contacts/points", "Points3D:positions")
    assert points == [[]] * steps


def test_save_replaces_an_existing_file(tmp_path):
    path = tmp_path / "a.rrd"
    path.write_text("something else")
    recording.save(path, [episode()])
    assert len(RrdReader(path).recordings()) == 1


def test_save_says_what_is_wrong(tmp_path):
    with pytest.raises(ValueError, match="at least one"):
        recording.save(tmp_path / "a.rrd", [])
    with pytest.raises(OSError, match=r"nowhere.a\.rrd"):
        recording.save(tmp_path / "nowhere" / "a.rrd", [episode()])
    with pytest.raises(OSError, match=tmp_path.name):
        recording.save(tmp_path, [episode()])


# ------------------------------------------------------------------------------- phases


def phase(points=(), tilt=0.0, v=(0.0, 0.0, 0.0), w=(0.0, 0.0, 0.0), force=1000.0) -> str:
    """Of a car that points as the world does, turned by nothing but its tilt's name."""
    forces = np.zeros((2, N_POINTS, 3))
    forces[1, list(points), 2] = force
    motion = {"quat": np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))}
    motion |= {"v": np.array([(9.0, 9.0, 9.0), v]), "w": np.array([(9.0, 9.0, 9.0), w])}
    e = episode(2, force=forces, tilt=np.array([3.0, np.radians(tilt)]), **motion)
    before, now = phases(e)
    assert before == now, "row 0 has no force; it takes the phase of row 1"
    assert now in PHASES
    return now


def test_phase_rules():
    tyre, roof = 0, N_POINTS - 1
    assert phase() == "air"
    assert phase(tilt=180, v=(0.0, 0.0, 0.0)) == "air"
    assert phase([tyre], tilt=14) == "upright"
    assert phase([tyre], tilt=14, v=(5.0, 0.0, 0.0)) == "upright"
    assert phase([tyre], tilt=16) == "resting"
    assert phase([tyre, roof], tilt=14) == "resting"
    assert phase([roof], tilt=180) == "resting"
    assert phase([roof], tilt=180, v=(0.3, 0.0, 0.0)) == "rocking"
    assert phase([roof], tilt=180, w=(0.1, 0.0, 0.0)) == "rocking"
    assert phase([roof], tilt=180, v=(0.6, 0.0, 0.0)) == "sliding"
    assert phase([roof], tilt=180, v=(0.0, 0.0, 2.0)) == "rocking"
    up = list(car.HULL.values())[roof][2]  # turning about that point: it does not slip
    assert phase([roof], tilt=180, v=(-2.0 * up, 0.0, 0.0), w=(0.0, 2.0, 0.0)) == "rolling"
    assert phase([roof], tilt=180, v=(-1.0 * up, 0.0, 0.0), w=(0.0, 1.0, 0.0)) == "rocking"
    assert phase([roof], tilt=180, v=(2.0 * up, 0.0, 0.0), w=(0.0, 2.0, 0.0)) == "sliding"
    assert phase([roof], tilt=180, force=3.1 * WEIGHT) == "impact"
    assert phase([roof], tilt=180, force=2.9 * WEIGHT) == "resting"


def test_phase_strip_holds_the_changes(tmp_path):
    e = episode()
    path = recording.save(tmp_path / "a.rrd", [e])
    t, rows = read(path, "/phase", "StateChange:state")
    states = [state for (state,) in rows]
    assert states[-1] == "", "the last phase ends with the episode"
    assert all(a != b for a, b in pairwise(states))
    at = np.searchsorted(t, e.t + 1e-6) - 1  # the row in force at each step
    assert [states[i] for i in at] == phases(e)


# ------------------------------------------------------------------------------- real episodes


def driven(kind: str, seed: int = 0, **arguments) -> Episode:
    """A car upright on some ground, its own car, until it has stood still."""
    env = FlipCarEnv(terrain=kind, randomize=True, **arguments)
    return play(env, lambda obs: np.array([0.3, -0.2, 0.1]), seed, {"start": "upright"}, "constant")


@pytest.mark.parametrize("kind", terrain.KINDS)
def test_contacts_lie_on_the_ground_and_the_ground_is_as_it_is(kind, tmp_path):
    """A randomised car's centre of mass is not the drawn car's origin: its points would float."""
    e = driven(kind)
    assert np.linalg.norm(e.offset) > 0.01
    assert e.is_success
    surface, (points, normals) = terrain.surface(kind), hull_points(e)
    assert touching(e)[-1, :4].sum() >= 3
    assert np.abs(surface.distance(points[-1, touching(e)[-1]])).max() < 1e-3
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0)
    path = recording.save(tmp_path / "a.rrd", [e])
    _, (vertices,) = read(path, "/world/ground", "Mesh3D:vertex_positions")
    np.testing.assert_allclose(surface.distance(np.array(vertices)), 0.0, atol=1e-5)
    reach = np.abs(np.array(vertices)[:, :2] - e.x[0, :2]).max(axis=0)
    assert (reach > 7.0).all()
    _, origins = read(path, "/world/car", "Transform3D:translation")
    _, quats = read(path, "/world/car", "Transform3D:quaternion")
    x, y, z, w = quats[-1][0]
    hull = np.array(list(car.HULL.values()))[:4]
    turned = [1 - 2 * (x * x + y * y), 2 * (x * z + w * y), 2 * (y * z - w * x)]  # world's z over body's
    low = origins[-1][0][2] + hull[:, 0] * 2 * (x * z - w * y) + hull[:, 1] * 2 * (y * z + w * x)
    low += hull[:, 2] * turned[0] - hull[:, 3] * np.array(normals)[-1, :4, 2]
    np.testing.assert_allclose(low, points[-1, :4, 2], atol=1e-5)


def test_a_comparison_shows_each_at_the_same_time(tmp_path):
    a, b = episode(), episode(steps=11, policy="pump", seed=1)
    path = recording.save_comparison(tmp_path / "a.rrd", [a, b])
    for root, e in (("/0", a), ("/1", b)):
        t, x = read(path, f"{root}/world/car", "Transform3D:translation")
        np.testing.assert_allclose(t, e.t, atol=1e-9)
        np.testing.assert_array_equal(np.array(x)[:, 0], e.x.astype(np.float32))
    with pytest.raises(ValueError, match="need at least two"):
        recording.save_comparison(tmp_path / "a.rrd", [a])


def test_a_grid_shows_all_cars_at_once_and_leaves_them_where_they_end(tmp_path):
    episodes = [driven(kind, seed) for seed, kind in enumerate(terrain.KINDS * 2)]
    path = recording.save_grid(tmp_path / "a.rrd", episodes)
    t, places = read(path, "/world/cars/body", "InstancePoses3D:translations")
    longest = max(len(e.t) for e in episodes)
    assert len(t) == longest
    places = np.array(places)
    assert places.shape == (longest, len(episodes), 3)
    for i, e in enumerate(episodes):
        moved = places[:, i] - places[0, i]
        origin = entities.car_origin(e)
        np.testing.assert_allclose(moved[: len(e.t)], origin - origin[0], atol=1e-5)
        np.testing.assert_array_equal(moved[len(e.t) :], np.tile(moved[-1], (longest - len(e.t), 1)))
    apart = np.linalg.norm(places[0][:, None, :2] - places[0][None, :, :2], axis=2)
    assert apart[~np.eye(len(episodes), dtype=bool)].min() > 6.0
    _, won = read(path, "/plots/recovered", "Scalars:scalars")
    assert won[0] == [0.0]
    assert won[-1] == [sum(e.is_success for e in episodes)]
    with pytest.raises(ValueError, match="got none"):
        recording.save_grid(path, [])


def test_a_file_that_is_not_finished_is_not_there(tmp_path, monkeypatch):
    path = recording.save(tmp_path / "a.rrd", [episode()])
    before = path.read_bytes()

    def fail(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(entities, "send_episode", fail)
    with pytest.raises(KeyboardInterrupt):
        recording.save(path, [episode(seed=1)])
    assert [p.name for p in tmp_path.iterdir()] == ["a.rrd"]
    assert path.read_bytes() == before


# ------------------------------------------------------------------------------- recording as one goes


def test_a_process_that_is_killed_leaves_readable_files(tmp_path):
    program = f"""
import gymnasium as gym
from flipcar_env.recording import RerunRecorder
env = RerunRecorder(gym.make("FlipCar-v0", start="upright"), {str(tmp_path)!r})
while True:
    env.reset()
    over = False
    while not over:
        *_, terminated, truncated, _ = env.step([0.0, 0.0, 0.0])
        over = terminated or truncated
"""
    process = subprocess.Popen([sys.executable, "-c", program])
    try:
        while not (tmp_path / "episode-000003.rrd").exists():
            assert process.poll() is None
            time.sleep(0.01)
    finally:
        process.kill()
        process.wait()
    files = sorted(tmp_path.glob("*.rrd"))
    assert len(files) >= 4
    for file in files:
        _, rows = read(file, "/status", "TextDocument:text")
        assert "**Recovered**" in rows[-1][0]


def test_the_recorder_changes_no_bit_and_keeps_every_third(tmp_path):
    rng = np.random.default_rng(0)
    driven = rng.uniform(-1, 1, (400, 3)).astype(np.float32)
    plain, kept = (gym.make("FlipCar-v0", start="upright", randomize=True) for _ in range(2))
    kept = recording.RerunRecorder(kept, tmp_path / "new" / "folder", every=3, name="chance")
    seen, ends, most = [], 0, 0
    a, b = plain.reset(seed=5), kept.reset(seed=5)
    for action in driven:
        np.testing.assert_array_equal(a[0], b[0])
        np.testing.assert_array_equal(plain.unwrapped.get_state(), kept.unwrapped.get_state())
        if ends == 3:
            seen.append(kept.unwrapped.get_state()[:3] - turned_offset(kept.unwrapped.get_state()))
        a, b = plain.step(action), kept.step(action)
        assert a[1:4] == b[1:4]
        most = max(most, len(kept._frames))
        if a[2] or a[3]:
            if ends == 3:
                seen.append(kept.unwrapped.get_state()[:3] - turned_offset(kept.unwrapped.get_state()))
            a, b, ends = plain.reset(), kept.reset(), ends + 1
    assert ends > 4
    assert most <= 251
    kept.close()
    files = sorted((tmp_path / "new" / "folder").iterdir())
    assert [f.name for f in files] == [f"episode-{3 * i:06d}.rrd" for i in range(ends // 3 + 1)]
    _, x = read(files[1], "/world/car", "Transform3D:translation")
    np.testing.assert_allclose(np.array(x)[:, 0], seen, atol=1e-5)
    _, texts = read(files[1], "/status", "TextDocument:text")
    assert "chance" in texts[0][0]
    with pytest.raises(ValueError, match="every"):
        recording.RerunRecorder(plain, tmp_path, every=0)
    with pytest.raises(ValueError, match="FlipCar"):
        recording.RerunRecorder(gym.make("CartPole-v1"), tmp_path)


def turned_offset(state: np.ndarray) -> np.ndarray:
    return to_matrix(state[3:7]) @ state[r.OFFSET : r.OFFSET + 3]


def test_a_replay_of_a_batch_is_to_the_bit():
    n, steps = 6, 60
    settings = {"action_delay": 1, "sensor_noise": 1.0}
    batch = Core(n, start="drop", terrain="slope", randomize=True, **settings)
    for i in range(n):
        batch.seed(i, i)
    batch.begin(np.arange(n))
    starts, given = batch.states.copy(), np.random.default_rng(1).uniform(-1, 1, (steps, n, 3))
    for action in given.astype(np.float32):
        batch.step(action)
    for i in range(n):
        env = FlipCarEnv(terrain="slope", **settings)
        e = replay(env, starts[i], given[:, i].astype(np.float32))
        np.testing.assert_array_equal(env.get_state(), batch.states[i])
        limits = starts[i][r.LIMIT : r.LIMIT + 3]
        np.testing.assert_allclose(e.torque[2:], given[:-1, i] * limits, rtol=1e-6)  # one step late
        np.testing.assert_array_equal(e.torque[1], 0.0)


# ------------------------------------------------------------------------------- the viewer


def software_vulkan() -> bool:
    return any(Path("/usr/share/vulkan/icd.d").glob("lvp_icd*"))


def listening(pid: int) -> list[str]:
    """The addresses on which a process listens."""
    sockets = {os.readlink(file) for file in Path(f"/proc/{pid}/fd").iterdir()}
    found = []
    for family in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{family}").read_text().splitlines()[1:]:
            _, local, _, state, *_, inode = line.split()[:10]
            if state == "0A" and f"socket:[{inode}]" in sockets:
                raw = bytes.fromhex(local.split(":")[0])
                words = b"".join(raw[i : i + 4][::-1] for i in range(0, len(raw), 4))
                found.append(str(ipaddress.ip_address(words)))
    return found


@pytest.mark.skipif(not software_vulkan(), reason="needs a software Vulkan to draw without a screen")
def test_every_view_shows_data_without_errors_and_nothing_is_left_behind(tmp_path, monkeypatch):
    """Live, and the three layouts of a file: in a viewer without a window."""
    from rerun.experimental import ViewerClient

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("RUST_LOG", "error")
    env = FlipCarEnv(start="roof", terrain="bumpy")
    live = recording.Live(env, headless=True)
    try:
        end = time.monotonic() + 60.0
        while True:
            try:
                client = ViewerClient.connect(live.url)
                client.get_state()
                break
            except Exception:
                assert live.process.poll() is None
                if time.monotonic() > end:
                    raise
                time.sleep(0.2)
        addresses = listening(live.process.pid)
        assert addresses
        assert set(addresses) == {"127.0.0.1"}
        _obs, info = env.reset(seed=0)
        live.begin(info)
        for _ in range(5):
            action = np.array([1.0, 0.0, 0.0])
            _obs, total, _over, _cut, info = env.step(action)
            live.go_on(info, action, total)
        live.stream.flush()
        files = [
            recording.save(tmp_path / "a.rrd", [episode(), driven("ditch")]),
            recording.save_comparison(tmp_path / "b.rrd", [episode(), episode(seed=1, policy="other")]),
            recording.save_grid(tmp_path / "c.rrd", [driven(kind) for kind in terrain.KINDS]),
        ]
        for file in (None, *files):
            if file:
                client.open(str(file))
            time.sleep(1.5)
            state = client.get_state()
            assert state.views
            assert not [report for view in state.views for report in view.reports]
        assert not [log for log in client.get_logs() if log.level in ("WARN", "ERROR")]
    finally:
        live.close()
    assert live.process.poll() is not None


def test_live_without_a_screen_serves_on_loopback_and_says_where(monkeypatch, capsys):
    """Gymnasium's checker makes an environment in each of its modes: none may need a screen."""
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    started = []
    popen = subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda *a, **k: started.append(popen(*a, **k)) or started[-1])
    env = gym.make("FlipCar-v0", render_mode="rerun")
    said = capsys.readouterr().err
    env.reset(seed=0)
    env.step(np.ones(3, np.float32))
    (process,) = started
    port = process.args[process.args.index("--port") + 1]
    assert said.count("\n") == 1
    assert f"rerun --connect rerun+http://127.0.0.1:{port}/proxy" in said
    assert process.args[process.args.index("--bind") + 1] == "127.0.0.1"
    assert process.poll() is None
    env.close()
    assert process.poll() is not None


def test_live_goes_on_without_a_viewer_that_was_closed():
    env = FlipCarEnv(start="roof")
    live = recording.Live(env)
    _obs, info = env.reset(seed=0)
    live.begin(info)
    live.process.kill()
    live.process.wait()
    action = np.ones(3)
    _obs, total, _terminated, _truncated, info = env.step(action)
    live.go_on(info, action, total)
    live.close()


def test_live_shows_what_the_environment_does_and_ends_with_it(monkeypatch):
    shown = []

    class Watched:
        def __init__(self, env):
            shown.append(env)

        def begin(self, info):
            shown.append(info)

        def go_on(self, info, action, total):
            shown.append((info, action, total))

        def close(self):
            shown.append("closed")

    monkeypatch.setattr(recording, "Live", Watched)
    env = FlipCarEnv(render_mode="rerun")
    assert env.render_mode == "rerun"
    _obs, info = env.reset(seed=0)
    _obs, total, _terminated, _truncated, after = env.step(np.ones(3))
    env.close()
    env.close()
    assert shown[0] is env
    assert shown[1] is info
    assert shown[2][0] is after
    assert shown[2][2] == total
    assert shown[3:] == ["closed"]


def test_view_without_a_screen_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert not recording.has_display()
    with pytest.raises(RuntimeError, match=r"run `rerun a\.rrd`") as error:
        recording.view(tmp_path / "a.rrd")
    assert "\n" not in str(error.value)


def test_without_a_viewer_it_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setattr(rerun_cli, "__file__", str(tmp_path / "__init__.py"))
    with pytest.raises(RuntimeError, match="pip install --force-reinstall rerun-sdk") as error:
        gym.make("FlipCar-v0", render_mode="rerun")
    assert "\n" not in str(error.value)
    (tmp_path / "rerun.exe").touch()
    assert command("a.rrd")[0] == str(tmp_path / "rerun.exe")


@pytest.mark.parametrize("variable", ["DISPLAY", "WAYLAND_DISPLAY"])
def test_has_display(monkeypatch, variable):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv(variable, ":0")
    assert recording.has_display()


def test_view_listens_on_loopback_only_and_waits(tmp_path, monkeypatch):
    path = tmp_path / "a.rrd"
    monkeypatch.setenv("DISPLAY", ":0")
    with pytest.raises(FileNotFoundError, match="no recording"):
        recording.view(path)
    path.touch()
    commands = []

    def run(command, **_):
        commands.append(command)
        return subprocess.CompletedProcess(command, returncode=len(commands) - 1)

    monkeypatch.setattr(subprocess, "run", run)
    recording.view(path)
    (command,) = commands
    assert Path(command[0]).is_file()
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert command[-1] == str(path)
    with pytest.raises(RuntimeError, match="exit status 1"):
        recording.view(path)


# ------------------------------------------------------------------------------- the drawn car


def test_drawn_car_fills_the_hull_and_no_more(tmp_path):
    """Support functions: no direction in which the drawing stands more than 3 cm out."""
    path = recording.save(tmp_path / "a.rrd", [episode()])
    drawn = []
    for chunk in RrdReader(path).stream():
        if chunk.entity_path in ("/world/car/body", "/world/car/wheels"):
            (vertices,) = chunk.to_record_batch().column("Mesh3D:vertex_positions").to_pylist()
            drawn += vertices
    drawn, hull = np.array(drawn), np.array(list(car.HULL.values()))
    directions = np.random.default_rng(0).normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    allowed = (directions @ hull[:, :3].T + hull[:, 3]).max(axis=1)
    reached = (directions @ drawn.T).max(axis=1)
    assert np.all(reached < allowed + 0.03)
    assert np.all(reached > allowed - 0.10)
    np.testing.assert_allclose(drawn[:, 2].min(), -car.CENTRE_OF_MASS_HEIGHT, atol=1e-6)
