"""Recordings as files."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from flipcar_env import terrain
from flipcar_env.episode import Episode

from . import entities, layout
from .entities import TIMELINE

PAUSE = 1.0
"""s between two episodes."""

APART = 9.0
"""m between the cars of a grid."""


def save(path: str | Path, episodes: Sequence[Episode]) -> Path:
    """Write episodes to one .rrd file, with the layout in which the viewer shows them.

    They stand one after another on the timeline, so that one press of play shows them all.

    Args:
        path: the file to write; an existing one is replaced, once the new one is whole.
        episodes: at least one; each starts `PAUSE` seconds after the end of the one before.

    Returns:
        The path.

    Raises:
        ValueError: no episodes.
        OSError: the file cannot be written.
    """
    _need(episodes, 1)
    starts = start_times(episodes)
    end = starts[-1] + duration(episodes[-1])
    with _file(path, layout.single(end)) as stream:
        entities.send_static(stream, _terms(episodes))
        for i, (episode, start) in enumerate(zip(episodes, starts, strict=True)):
            entities.send_episode(stream, episode, start, f"episode {i + 1} of {len(episodes)}")
    return Path(path)


def save_comparison(path: str | Path, episodes: Sequence[Episode]) -> Path:
    """Write episodes to one .rrd file that shows them side by side, at the same time.

    Args:
        path: as in `save`.
        episodes: at least two, as a rule from the same start; `policy` is what each is called.

    Returns:
        The path.

    Raises:
        ValueError: fewer than two episodes.
        OSError: the file cannot be written.
    """
    _need(episodes, 2)
    roots = [f"/{i}" for i in range(len(episodes))]
    names = [episode.policy or f"{i + 1}" for i, episode in enumerate(episodes)]
    end = max(duration(episode) for episode in episodes)
    with _file(path, layout.comparison(end, roots, names)) as stream:
        for i, (root, episode) in enumerate(zip(roots, episodes, strict=True)):
            colour = entities.LINE_COLOURS[i % len(entities.LINE_COLOURS)]
            entities.send_static(stream, list(episode.reward_terms), root, f"{names[i]}: ")
            for plot in COMPARED:  # a colour for each car, where the plots above have one for each quantity
                looks = rr.SeriesLines(names=names[i], colors=colour, widths=2.0)
                stream.log(f"{root}/plots/{plot}", looks, static=True)
            entities.send_episode(stream, episode, 0.0, "compared", root)
    return Path(path)


COMPARED = ("upright", "height", "energy/mechanical", "motion/speed", "torque/roll")
"""Plots of a comparison."""


def save_grid(path: str | Path, episodes: Sequence[Episode]) -> Path:
    """Write episodes to one .rrd file that shows all their cars at once, each on ground of its own.

    Args:
        path: as in `save`.
        episodes: at least one; the car of one that is over stays as it was at its end.

    Returns:
        The path.

    Raises:
        ValueError: no episodes.
        OSError: the file cannot be written.
    """
    _need(episodes, 1)
    n, steps = len(episodes), max(len(episode.t) for episode in episodes)
    longest = max(episodes, key=lambda episode: len(episode.t))
    seconds = longest.t - longest.t[0]
    places = _places(episodes)
    origins, quats, upright = np.empty((steps, n, 3)), np.empty((steps, n, 4)), np.empty((steps, n))
    recovered = np.zeros((steps, n), bool)
    for i, episode in enumerate(episodes):
        last = np.minimum(np.arange(steps), len(episode.t) - 1)
        origins[:, i] = entities.car_origin(episode)[last] + places[i]
        quats[:, i] = np.roll(episode.quat, -1, axis=1)[last]
        upright[:, i] = np.cos(episode.tilt)[last]
        recovered[len(episode.t) - 1 :, i] = episode.is_success
    time = [rr.TimeColumn(TIMELINE, duration=seconds)]
    counts = np.full(steps, n)
    low, high = origins[0].min(axis=0), origins[0].max(axis=0)
    view = layout.grid(float(seconds[-1]), n, 0.5 * (low + high), float((high - low).max()) + APART)
    with _file(path, view) as stream:
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        poses = rr.InstancePoses3D.columns(
            translations=origins.reshape(-1, 3), quaternions=quats.reshape(-1, 4)
        )
        for name, mesh in zip(("body", "wheels"), entities.car_meshes(), strict=True):
            stream.log(f"world/cars/{name}", mesh, static=True)
            stream.send_columns(f"world/cars/{name}", time, poses.partition(counts))
        for i, episode in enumerate(episodes):
            entities.send_patch(stream, episode, places[i], 4.0, f"world/ground/{i}")
        stream.log("plots/recovered", rr.SeriesLines(names="recovered", widths=2.0), static=True)
        stream.log("plots/upright", rr.SeriesLines(names="mean uprightness", widths=2.0), static=True)
        won = recovered.sum(axis=1)
        stream.send_columns("plots/recovered", time, rr.Scalars.columns(scalars=won.astype(float)))
        stream.send_columns("plots/upright", time, rr.Scalars.columns(scalars=upright.mean(axis=1)))
        texts = [f"{t:.2f} s: **{k}** of {n} recovered" for t, k in zip(seconds, won, strict=True)]
        stream.send_columns(
            "status", time, rr.TextDocument.columns(text=texts, media_type=["text/markdown"] * steps)
        )
    return Path(path)


def start_times(episodes: Sequence[Episode]) -> np.ndarray:
    """Time of each episode's first row on the recording's timeline: (len(episodes),) s."""
    lengths = [duration(episode) + PAUSE for episode in episodes]
    return np.concatenate([[0.0], np.cumsum(lengths)[:-1]])


def duration(episode: Episode) -> float:
    """From an episode's first row to its last, s."""
    return float(episode.t[-1] - episode.t[0])


def _places(episodes: Sequence[Episode]) -> np.ndarray:
    """(n, 3) by which each car of a grid is moved: to its place, along the ground where that slopes."""
    columns = int(np.ceil(np.sqrt(len(episodes))))
    places = np.zeros((len(episodes), 3))
    for i, episode in enumerate(episodes):
        surface = terrain.surface(episode.terrain)
        places[i, :2] = APART * np.array([i % columns, -(i // columns)]) - np.round(episode.x[0, :2])
        if surface.field is None:
            places[i, 2] = surface.heights(*places[i, :2]) - surface.heights(0.0, 0.0)
    return places


def _need(episodes: Sequence[Episode], least: int) -> None:
    if len(episodes) < least:
        words = {0: "none"}.get(len(episodes), str(len(episodes)))
        raise ValueError(f"episodes: got {words}, need at least {['', 'one', 'two'][least]}")


def _terms(episodes: Sequence[Episode]) -> list[str]:
    """The names of the reward's terms, each once."""
    return list(dict.fromkeys(name for episode in episodes for name in episode.reward_terms))


@contextmanager
def _file(path: str | Path, blueprint: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """A stream into a file, which takes its name when it is whole: a process that is killed leaves no half.

    Raises:
        OSError: the file cannot be written.
    """
    path = Path(path)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    stream = rr.RecordingStream("flipcar")
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    try:
        part.open("wb").close()  # rerun's own error for a bad path is a RuntimeError and a warning
        stream.save(part, blueprint)
        yield stream
        stream.flush()
        stream.disconnect()
        part.replace(path)
    except (RuntimeError, OSError) as error:
        raise OSError(f"cannot write the recording {path}: {error}") from error
    finally:
        part.unlink(missing_ok=True)
