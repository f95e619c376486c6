"""The recording is read back and compared with the episode that it was made from."""

import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun_cli
from rerun.chunk import RrdReader

from flipcar_env import car, recording
from flipcar_env.episode import Episode

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
    _, arrows = read(path, "/world/contacts/forces", "Arrows3D:vectors")
    _, origins = read(path, "/world/contacts/forces", "Arrows3D:origins")
    hull = np.array(list(car.HULL.values()))
    assert len(points) == len(arrows) == len(origins) == len(e.t)
    for i in range(len(e.t)):
        touching = np.flatnonzero(e.force[i].any(axis=1))
        assert len(points[i]) == len(arrows[i]) == len(touching) == (i % 3)
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
        force = np.array(arrows[i]) * recording.NEWTON_PER_METRE
        np.testing.assert_allclose(force, e.force[i, touching], rtol=1e-5)
        np.testing.assert_allclose(np.add(origins[i], arrows[i]), points[i], atol=1e-5)


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
        "/world/contacts/forces",
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


def phase(points=(), tilt=0.0, v=(0.0, 0.0, 0.0), w=(0.0, 0.0, 0.0)) -> str:
    force = np.zeros((2, N_POINTS, 3))
    force[1, list(points), 2] = 1000.0
    motion = {"v": np.array([(9.0, 9.0, 9.0), v]), "w": np.array([(9.0, 9.0, 9.0), w])}
    e = episode(2, force=force, tilt=np.array([3.0, np.radians(tilt)]), **motion)
    before, now = recording.phases(e)
    assert before == now, "row 0 has no force; it takes the phase of row 1"
    assert now in recording.PHASE_COLOURS
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
    assert phase([roof], tilt=180, v=(0.6, 0.0, 0.0), w=(0.0, 0.0, 1.0)) == "sliding"
    assert phase([roof], tilt=180, v=(0.6, 0.0, 0.0), w=(0.0, 0.0, 1.3)) == "rocking"
    assert phase([roof], tilt=180, v=(0.0, 0.0, 2.0)) == "rocking"


def test_phase_strip_holds_the_changes(tmp_path):
    e = episode()
    path = recording.save(tmp_path / "a.rrd", [e])
    t, rows = read(path, "/phase", "StateChange:state")
    states = [state for (state,) in rows]
    assert states[-1] == "", "the last phase ends with the episode"
    assert all(a != b for a, b in pairwise(states))
    at = np.searchsorted(t, e.t + 1e-6) - 1  # the row in force at each step
    assert [states[i] for i in at] == recording.phases(e)


# ------------------------------------------------------------------------------- the viewer


def test_view_without_a_screen_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert not recording.has_display()
    with pytest.raises(RuntimeError, match=r"run `rerun a\.rrd`") as error:
        recording.view(tmp_path / "a.rrd")
    assert "\n" not in str(error.value)


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
