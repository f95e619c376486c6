"""Episodes as a rerun recording: the car, its contacts and the plots. The only module with rerun.

All episodes stand one after another on the timeline `sim_time`, so that one press of play shows
them all. Every series is sent as columns, once per episode: step by step takes a hundred times as
long.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import rerun_cli

from flipcar_env import car
from flipcar_env.car_mesh import (
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    VERMILION,
    YELLOW,
    Face,
    body_faces,
    wheel_faces,
)
from flipcar_env.episode import Episode
from solver.rotation import to_matrix

TIMELINE = "sim_time"
PAUSE = 1.0
"""s between two episodes."""

NEWTON_PER_METRE = 12_000.0
"""Length of a force arrow: the whole weight of the car on one point is about a metre long."""

SKYLINE = (205, 214, 222)
EYE, FOCUS_HEIGHT = (3.4, -5.2, 2.9), 0.5
"""The camera starts here and looks at the point that it follows."""

WINDOW = (-6.0, 3.0)
"""s before and after the time cursor that the plots show of a recording that is longer."""

LINE_COLOURS = (SKY, ORANGE, GREEN, PURPLE, YELLOW, VERMILION, GREY)

PHASE_COLOURS = {
    "air": SKY,
    "sliding": ORANGE,
    "rocking": PURPLE,
    "resting": GREY,
    "upright": GREEN,
}
"""Every value that `phases` returns, and its colour."""


def has_display() -> bool:
    """Is there a screen to open a window on?"""
    if not sys.platform.startswith("linux"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def view(path: str | Path) -> None:
    """Open a recording in rerun's viewer; returns when its window is closed.

    Args:
        path: an .rrd file.

    Raises:
        FileNotFoundError: there is no such file.
        RuntimeError: there is no screen, or the viewer failed.
    """
    path = Path(path)
    if not has_display():
        raise RuntimeError(
            f"no screen (neither DISPLAY nor WAYLAND_DISPLAY is set): "
            f"copy {path} to a machine with one and run `rerun {path.name}` there"
        )
    if not path.is_file():
        raise FileNotFoundError(f"no recording at {path}")
    # The viewer also listens for data, by default on every interface. `rerun` on the PATH is a
    # wrapper that may leave the viewer behind when it is interrupted, so this runs the binary.
    binary = Path(rerun_cli.__file__).parent / "rerun"
    command = [str(binary), "--bind", "127.0.0.1", "--port", "auto", str(path)]
    status = subprocess.run(command, check=False).returncode
    if status != 0:
        raise RuntimeError(f"the viewer stopped with exit status {status} on {path}")


def phases(episode: Episode) -> list[str]:
    """What the car is doing at each step, one of `PHASE_COLOURS`; the first rule that fits.

    - air: no contact force;
    - upright: only tyres touch, tilt below 15°;
    - resting: slower than 0.05 m/s and 0.05 rad/s;
    - sliding: the centre of mass moves along the ground faster than 0.5 m/s, and faster than the
      rotation moves a point half a metre away from it;
    - rocking: everything else.

    Row 0 has no force by definition and takes the phase of row 1.
    """
    touches = _touching(episode)
    on_tyres_only = ~touches[:, car.N_WHEELS :].any(axis=1)
    speed = np.linalg.norm(episode.v, axis=1)
    along_ground = np.hypot(episode.v[:, 0], episode.v[:, 1])
    spin = np.linalg.norm(episode.w, axis=1)
    rules = {
        "air": ~touches.any(axis=1),
        "upright": on_tyres_only & (episode.tilt < np.radians(15.0)),
        "resting": (speed < 0.05) & (spin < 0.05),
        "sliding": (along_ground > 0.5) & (along_ground > 0.5 * spin),
    }
    found = np.select(list(rules.values()), list(rules), default="rocking").tolist()
    return found[1:2] + found[1:] if len(found) > 1 else found


def save(path: str | Path, episodes: Sequence[Episode]) -> Path:
    """Write episodes to one .rrd file, with the layout in which the viewer shows them.

    Args:
        path: the file to write; an existing one is replaced.
        episodes: at least one; each starts `PAUSE` seconds after the end of the one before.

    Returns:
        The path.

    Raises:
        ValueError: no episodes.
        OSError: the file cannot be written.
    """
    path = Path(path)
    if not episodes:
        raise ValueError("episodes: got none, need at least one")
    starts = start_times(episodes)
    end = starts[-1] + episodes[-1].t[-1] - episodes[-1].t[0]
    names = list(dict.fromkeys(name for e in episodes for name in e.reward_terms))
    path.open("wb").close()  # rerun's own error for a bad path is a RuntimeError and a warning
    stream = rr.RecordingStream("flipcar")
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    try:
        stream.save(path, _blueprint(end))
        _send_static(stream, names)
        for i, (episode, start) in enumerate(zip(episodes, starts, strict=True)):
            _send_episode(stream, episode, start, f"{i + 1} of {len(episodes)}")
        stream.flush()
        stream.disconnect()
    except RuntimeError as error:
        raise OSError(f"cannot write the recording {path}: {error}") from error
    return path


def start_times(episodes: Sequence[Episode]) -> np.ndarray:
    """Time of each episode's first row on the recording's timeline: (len(episodes),) s."""
    lengths = [e.t[-1] - e.t[0] + PAUSE for e in episodes]
    return np.concatenate([[0.0], np.cumsum(lengths)[:-1]])


# --------------------------------------------------------------------------- what moves


def _send_episode(stream: rr.RecordingStream, episode: Episode, start: float, number: str) -> None:
    seconds = start + episode.t - episode.t[0]
    time = [rr.TimeColumn(TIMELINE, duration=seconds)]
    at_start = [rr.TimeColumn(TIMELINE, duration=seconds[:1])]

    def send(entity: str, columns: rr.ComponentColumnList) -> None:
        stream.send_columns(entity, time, columns)

    send(
        "world/car",
        rr.Transform3D.columns(
            translation=episode.x,
            quaternion=np.roll(episode.quat, -1, axis=1),  # rerun wants x, y, z, w
        ),
    )
    # The camera follows the car over the ground, not its bobbing and rolling.
    focus = np.column_stack([episode.x[:, :2], np.full(len(seconds), FOCUS_HEIGHT)])
    send("world/focus", rr.Transform3D.columns(translation=focus))
    stream.send_columns("world/trail", at_start, rr.LineStrips3D.columns(strips=[episode.x]))

    touches = _touching(episode)
    counts = touches.sum(axis=1)
    points, arrows = _hull_points(episode)[touches], episode.force[touches] / NEWTON_PER_METRE
    # Partitions of length 0 clear the contacts of the step before. An arrow ends at its contact:
    # drawn from there, it would vanish inside the car.
    send("world/contacts/points", rr.Points3D.columns(positions=points).partition(counts))
    send(
        "world/contacts/forces",
        rr.Arrows3D.columns(vectors=arrows, origins=points - arrows).partition(counts),
    )

    # An empty row after the last one, so that no line leads from one episode to the next.
    plot_time = [rr.TimeColumn(TIMELINE, duration=np.append(seconds, seconds[-1] + 1e-3))]
    lengths = np.append(np.ones(len(seconds), dtype=int), 0)
    for entity, values in _series(episode).items():
        stream.send_columns(entity, plot_time, rr.Scalars.columns(scalars=values).partition(lengths))

    now = phases(episode)
    changes = [i for i, phase in enumerate(now) if i == 0 or phase != now[i - 1]]
    states = [now[i] for i in changes] + [""]  # the empty state ends the last one
    stream.send_columns(
        "phase",
        [rr.TimeColumn(TIMELINE, duration=np.append(seconds[changes], seconds[-1] + 1e-3))],
        rr.StateChange.columns(state=states),
    )
    send(
        "status",
        rr.TextDocument.columns(
            text=_status(episode, now, counts, number),
            media_type=["text/markdown"] * len(seconds),
        ),
    )


def _series(episode: Episode) -> Mapping[str, np.ndarray]:
    """Entity to the values that its plot shows, (T,) each."""
    series = {
        "plots/upright": np.cos(episode.tilt),
        "plots/height": episode.x[:, 2],
        "plots/energy/mechanical": episode.energy / 1e3,
        "plots/energy/work": episode.work / 1e3,
    }
    for i, axis in enumerate(("roll", "pitch", "yaw")):
        series[f"plots/torque/{axis}"] = episode.torque[:, i] / 1e3
    for name, values in episode.reward_terms.items():
        series[f"plots/reward/{name}"] = values
    return series


def _status(episode: Episode, now: list[str], counts: np.ndarray, number: str) -> list[str]:
    head = f"**{episode.start}** start, policy **{episode.policy}**, episode {number}"
    if episode.is_success:
        verdict = f"**Recovered** in {episode.time_to_upright:.2f} s"
    else:
        verdict = "**Not recovered**"
    verdicts = ["Running"] * (len(episode.t) - 1) + [verdict]
    rows = zip(episode.t, now, np.degrees(episode.tilt), counts, verdicts, strict=True)
    return [
        f"{head}\n\n{t:.2f} s: **{phase}**, tilt {tilt:.0f}°, contacts: {count}. {verdict}"
        for t, phase, tilt, count, verdict in rows
    ]


def _touching(episode: Episode) -> np.ndarray:
    """(T, p): does the hull point carry a force?"""
    return np.linalg.norm(episode.force, axis=2) > 0.0


def _hull_points(episode: Episode) -> np.ndarray:
    """(T, p, 3) lowest point of each hull point's sphere, world frame: x + R r − radius e_z."""
    hull = np.array(list(car.HULL.values()))  # (p, 4)
    rotated = np.einsum("tij,pj->tpi", to_matrix(episode.quat), hull[:, :3])
    return episode.x[:, None, :] + rotated - hull[None, :, 3:] * [0.0, 0.0, 1.0]


# --------------------------------------------------------------------------- what stands still


def _send_static(stream: rr.RecordingStream, reward_terms: Sequence[str]) -> None:
    def log(entity: str, archetype: rr.AsComponents) -> None:
        stream.log(entity, archetype, static=True)

    log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    log("world/car/body", _mesh(body_faces()))
    log("world/car/wheels", _mesh(wheel_faces()))
    log("world/focus", rr.Points3D([(0.0, 0.0, 0.0)], radii=1e-4))  # it must have a size
    size = 500.0
    corners = [(-size, -size, 0.0), (size, -size, 0.0), (size, size, 0.0), (-size, size, 0.0)]
    log(
        "world/ground",
        rr.Mesh3D(
            vertex_positions=corners,
            triangle_indices=[(0, 1, 2), (0, 2, 3)],
            albedo_factor=(150, 140, 120, 40),
        ),
    )
    log("world/trail", rr.LineStrips3D.from_fields(colors=PURPLE, radii=0.012))
    log("world/contacts/points", rr.Points3D.from_fields(colors=RED, radii=0.05))
    log("world/contacts/forces", rr.Arrows3D.from_fields(colors=RED, radii=0.04))
    log(
        "phase",
        rr.StateConfiguration(values=list(PHASE_COLOURS), colors=list(PHASE_COLOURS.values())),
    )
    lines = {
        "upright": ("uprightness", GREEN),
        "height": ("height, m", SKY),
        "energy/mechanical": ("mechanical", SKY),
        "energy/work": ("work of the torque", ORANGE),
        "torque/roll": ("roll", SKY),
        "torque/pitch": ("pitch", ORANGE),
        "torque/yaw": ("yaw", GREEN),
    }
    for i, name in enumerate(reward_terms):
        lines[f"reward/{name}"] = (name, LINE_COLOURS[i % len(LINE_COLOURS)])
    for entity, (name, colour) in lines.items():
        log(f"plots/{entity}", rr.SeriesLines(names=name, colors=colour, widths=2.0))


def _blueprint(end: float) -> rrb.Blueprint:
    """The layout: the scene on the left; status, phases and plots on the right."""
    at: Callable[..., rrb.TimeRangeBoundary]
    if end <= WINDOW[1] - WINDOW[0]:
        at, first, last = rrb.TimeRangeBoundary.absolute, 0.0, end
    else:
        at, first, last = rrb.TimeRangeBoundary.cursor_relative, *WINDOW
    # The curves end before the axes do: room for the legends on the left.
    margin = 0.22 * (last - first)
    axis = rrb.TimeAxis(view_range=rr.TimeRange(start=at(seconds=first - margin), end=at(seconds=last + 0.1)))
    shown = rrb.VisibleTimeRange(TIMELINE, start=at(seconds=first), end=at(seconds=last + 0.1))

    def plot(
        name: str, group: str, limits: tuple[float, float] | None = None, legend: bool = True
    ) -> rrb.View:
        return rrb.TimeSeriesView(
            name=name,
            origin=f"plots/{group}",
            axis_x=axis,
            axis_y=rrb.ScalarAxis(range=limits) if limits else None,
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend),
            time_ranges=shown,
        )

    torque = 1e-3 * max(car.TORQUE_LIMIT)
    scene = rrb.Spatial3DView(
        name="Scene",
        origin="world",
        background=SKYLINE,
        line_grid=rrb.LineGrid3D(spacing=1.0, stroke_width=1.0, color=(40, 40, 40, 140)),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=EYE,
            look_target=(0.0, 0.0, FOCUS_HEIGHT),
            eye_up=(0.0, 0.0, 1.0),
            tracking_entity="/world/focus",
        ),
    )
    right = rrb.Vertical(
        rrb.TextDocumentView(name="Status", origin="status"),
        rrb.StateTimelineView(name="Phase", origin="phase", time_view=axis, time_ranges=shown),
        plot("Uprightness (1: on its wheels, -1: on its roof)", "upright", (-1.1, 1.1), False),
        plot("Height of the centre of mass, m", "height", None, False),
        plot(f"Torque, kN m (limit {torque:g})", "torque", (-1.15 * torque, 1.15 * torque)),
        rrb.Tabs(plot("Reward", "reward"), plot("Energy, kJ", "energy")),
        row_shares=[20, 20, 28, 28, 36, 38],
    )
    return rrb.Blueprint(
        rrb.Horizontal(scene, right, column_shares=[3, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
    )


# --------------------------------------------------------------------------- the car's looks


def _mesh(faces: Sequence[Face]) -> rr.Mesh3D:
    """Flat-shaded faces: each has its own corners, and one normal for all four."""
    corners = np.array([corners for corners, _ in faces])  # (n, 4, 3)
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    first = 4 * np.arange(len(faces))[:, None, None]
    triangles = first + np.array([(0, 1, 2), (0, 2, 3)])  # (n, 2, 3)
    return rr.Mesh3D(
        vertex_positions=corners.reshape(-1, 3) - [0.0, 0.0, car.CENTRE_OF_MASS_HEIGHT],
        vertex_normals=np.repeat(normals, 4, axis=0),
        vertex_colors=np.repeat([colour for _, colour in faces], 4, axis=0).astype(np.uint8),
        triangle_indices=triangles.reshape(-1, 3),
    )
