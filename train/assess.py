"""The evaluation of record: every kind of start, each terrain, beside a search; and where it fails."""

import csv
import json
from collections.abc import Callable, Iterable, Sequence
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from . import heatmap
from .agents import DIRECTIONS, Agent, autoflip, constant, pd, random, zero
from .evaluate import UNSEEN, Played, play, stratified, summary, wilson
from .search import search

AGENTS: dict[str, Callable[[], Agent]] = {
    "zero": lambda: zero,
    "random": random,
    "pd": lambda: pd,
    "autoflip": lambda: autoflip,
}
"""And "constant" and "search", which are no single agents."""

FAILURES = 20
"""Starts that are kept, of each kind and terrain."""

SEARCHED = Path(str(files("train") / "search.csv"))
"""What `flipcar search` has found, from 200 starts of each kind on each terrain."""

Row = dict[str, Any]
Progress = Callable[..., Iterable]


def _quietly(steps: Iterable, name: str) -> Iterable:
    return steps


def policy_rows(
    agent: Agent,
    starts: Sequence[str],
    terrains: Sequence[str],
    episodes: int,
    seed: int = UNSEEN,
    out: Path | None = None,
    progress: Progress = _quietly,
    **arguments: Any,
) -> list[Row]:
    """Play an agent from stratified starts of each kind on each terrain.

    Args:
        agent: observations to actions.
        starts: kinds of start.
        terrains: kinds of ground.
        episodes: of each.
        seed: first of those that starts are drawn from.
        out: folder for evaluation.json, success over roll and pitch as CSV and heat map, and failing starts.
        progress: of the control steps of what has a name.
        arguments: the environment's.
    """
    rows, cells = [], []
    for terrain in terrains:
        played = []
        for start in starts:
            where = {"start": start, "terrain": terrain, **arguments}
            name = f"{terrain}, {start}"
            seeds = stratified(episodes, seed, **where)
            one = play(agent, seeds, partial(progress, name=name), **where)
            rows.append({"terrain": terrain, "start": start, **summary(one), "search": _beside(agent, where)})
            played.append(one)
            if out is not None:
                _keep_failures(out / "failures", f"{terrain}-{start}", one)
        cells += heatmap.cells(terrain, played)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write(out / "success.csv", cells)
        heatmap.draw(cells, out / "success.png")
        (out / "evaluation.json").write_text(json.dumps(rows, indent=2) + "\n")
    return rows


def constant_rows(
    starts: Sequence[str], terrains: Sequence[str], episodes: int, **arguments: Any
) -> list[Row]:
    """Constant torque: mean success over 26 directions, and the best one's."""
    rows = []
    for terrain in terrains:
        for start in starts:
            where = {"start": start, "terrain": terrain, **arguments}
            seeds = stratified(episodes, **where)
            won = [play(constant(direction), seeds, **where).success.mean() for direction in DIRECTIONS]
            best = int(np.argmax(won))
            found = {"success": float(np.mean(won)), "best": won[best], "torque": DIRECTIONS[best].tolist()}
            rows.append({"terrain": terrain, "start": start, "episodes": episodes, **found})
    return rows


def search_rows(
    policy: Agent,
    starts: Sequence[str],
    terrains: Sequence[str],
    episodes: int,
    progress: Progress = _quietly,
    **arguments: Any,
) -> list[Row]:
    """What a search finds, a row for each start: control steps until upright, or "" where none is found.

    No start is recovered later than by the policy.
    """
    agents, rows = [pd, autoflip], []
    for terrain in terrains:
        for start in starts:
            where = {"start": start, "terrain": terrain, **arguments}
            seeds = stratified(episodes, **where)
            name = f"{terrain}, {start}"
            steps = search(agents, seeds, policy, partial(progress, name=name), **where)
            rows += [
                {"terrain": terrain, "start": start, "seed": seed, "steps": int(n) if np.isfinite(n) else ""}
                for seed, n in zip(seeds.tolist(), steps, strict=True)
            ]
    return rows


def found(rows: list[Row]) -> list[Row]:
    """How many starts of each kind on each terrain a search has recovered, and how soon."""
    kinds = dict.fromkeys((row["terrain"], row["start"]) for row in rows)
    result = []
    for terrain, start in kinds:
        steps = [row["steps"] for row in rows if (row["terrain"], row["start"]) == (terrain, start)]
        won = [n for n in steps if n != ""]
        low, high = wilson(len(won), len(steps))
        result.append(
            {
                "terrain": terrain,
                "start": start,
                "episodes": len(steps),
                "success": len(won) / len(steps),
                "wilson": [low, high],
                "steps_median": float(np.median(won)) if won else None,
            }
        )
    return result


def line(row: Row) -> str:
    """A row as a line of text."""
    words = f"{row['terrain']:7}{row['start']:8}{row['success']:8.2%}"
    if "wilson" in row:
        words += f"  (95 %: {row['wilson'][0]:.2%} to {row['wilson'][1]:.2%})"
    if "best" in row:
        words += f"  mean of 26 directions; the best, {row['torque']}: {row['best']:.2%}"
    if row.get("time_median") is not None:
        words += f"  upright in {row['time_median']:.2f} s, 95 % in {row['time_p95']:.2f}"
        words += f"; {row['work_median'] / 1e3:.1f} kJ, blows to {row['impulse_max'] / 1e3:.1f} kN s"
        words += f", {row['flipped_again']:.2%} flipped again"
    if row.get("steps_median") is not None:
        words += f"  upright in {row['steps_median']:g} control steps"
    if row.get("search"):
        beside = row["search"]
        ratio = "" if beside["time_ratio"] is None else f", {beside['time_ratio']:.2f} x its time"
        words += f"; where searched {beside['success']:.1%}, search {beside['search_success']:.1%}{ratio}"
    return words


def write(path: Path, rows: list[Row]) -> None:
    """Write rows as CSV."""
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)


@cache
def searched(start: str, terrain: str) -> tuple[np.ndarray, np.ndarray]:
    """(seeds, control steps until upright) that `flipcar search` has found; infinite where it has not."""
    with SEARCHED.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if (row["start"], row["terrain"]) == (start, terrain)]
    steps = [float(row["steps"] or np.inf) for row in rows]
    return np.array([int(row["seed"]) for row in rows]), np.array(steps)


def _beside(agent: Agent, where: dict[str, Any]) -> Row | None:
    """An agent and the search from the same starts, where there has been one."""
    if set(where) - {"start", "terrain", "obs"}:
        return None  # of other cars
    seeds, steps = searched(where["start"], where["terrain"])
    if not len(seeds):
        return None
    played = play(agent, seeds, **where)
    found, both = np.isfinite(steps), np.isfinite(steps) & played.success
    ratio = float(np.median(played.steps[both]) / np.median(steps[both])) if both.any() else None
    return {
        "episodes": len(seeds),
        "search_success": float(found.mean()),
        "success": float(played.success.mean()),
        "time_ratio": ratio,
    }


def _keep_failures(folder: Path, name: str, played: Played) -> None:
    """Save starts from which the car was not recovered, as states that `flipcar play --state` replays."""
    failed = np.flatnonzero(~played.success)[:FAILURES]
    if failed.size:
        folder.mkdir(parents=True, exist_ok=True)
    for i in failed:
        np.save(folder / f"{name}-{played.seeds[i]}.npy", played.starts[i])
