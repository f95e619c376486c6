"""Each peer's best settings, scene by scene: all that an expert would try, and the one that did best."""

import json
from collections.abc import Callable, Iterable, Iterator
from functools import partial

import numpy as np

from .engine import Engine
from .precision import measured
from .problems import Problem
from .store import Cell, Row

RATES = (120, 960)
"""Steps a second at which settings are tried."""
QUICK_RATES = (240,)
TRIED_WHEN_QUICK = 2


def cells(
    problems: Iterable[Problem],
    peers: dict[str, list[dict]],
    make: Callable[..., Engine],
    quick: bool,
) -> Iterator[Cell]:
    """A cell for each scene and peer: a row for each of its settings and rates.

    Args:
        problems: the scenes.
        peers: of each engine, by name, the settings to try.
        make: an engine from its name and settings.
        quick: fewer of both.
    """

    def tries(problem: Problem, name: str, settings: list[dict]) -> list[Row]:
        rows = []
        for chosen in settings:
            engine = make(name, **chosen)
            for rate in QUICK_RATES if quick else RATES:
                steps = round(rate * problem.duration / problem.records)
                row, _took = measured(problem, engine, steps, 1)
                rows.append(
                    {
                        "scene": problem.name,
                        "method": name,
                        "settings": json.dumps(chosen),
                        "rate": rate,
                        **{key: row[key] for key in ("error", "ns", "failed")},
                    }
                )
        return rows

    for problem in problems:
        for name, settings in peers.items():
            chosen = [some for some in settings if make(name, **some).refuses(problem.scene) is None]
            if chosen:
                chosen = chosen[:TRIED_WHEN_QUICK] if quick else chosen
                yield (problem.name, name), partial(tries, problem, name, chosen)


def best(rows: list[Row], wrong: dict[str, float]) -> dict[tuple[str, str], dict]:
    """(scene, engine): the settings of the least error, geometric mean over the rates.

    Args:
        rows: of the sweep.
        wrong: of each scene, the error from which on an answer is wrong; a run that ended counts as that.
    """
    scores: dict[tuple[str, str], dict[str, list[float]]] = {}
    for row in rows:
        limit = wrong[row["scene"]]
        error = row["error"] if isinstance(row["error"], float) else limit
        # a run that ended counts as badly as can be; one that is wrong, as what it is
        per = scores.setdefault((row["scene"], row["method"]), {}).setdefault(row["settings"], [])
        per.append(np.log(np.clip(error if not row["failed"] else max(error, limit), 1e-17, 1e3 * limit)))
    return {
        key: json.loads(min(settings, key=lambda name: float(np.mean(settings[name]))))
        for key, settings in scores.items()
    }
