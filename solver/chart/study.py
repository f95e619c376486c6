"""All of the charts: what there is to measure, done piece by piece into a folder, and drawn from it."""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

from solver.body import Body
from solver.simulate import METHODS

from . import (
    ellipses,
    engine,
    ladder,
    ladder_plot,
    plots,
    precision,
    reference,
    report,
    restarts,
    stability,
    stability_plot,
    sweep,
    tosses,
)
from .peers import SWEEPS, engines, make, missing
from .problems import Problem, problems
from .store import Cell, Row, claim, fill, read

STUDIES = ("stability", "ladder", "reference", "tosses", "ellipses")
"""Beside the scenes of the work-precision study."""

REAL = (
    ("tosses", tosses, "cube_tosses.npz", "ContactNets, in DAIR Lab's repository dair_pll"),
    ("ellipses", ellipses, "ellipse_impacts.npz", "Fazeli et al., in DAIR Lab's repository ImpactModeling"),
)
"""Studies of real impacts: name, module, file of the data, where it is from."""

Progress = Callable[[str, int], Callable[[], None]]
"""From a title and a number of pieces of work: what to call after each."""


def names() -> tuple[str, ...]:
    """Everything that can be asked for."""
    return (*problems(), *STUDIES)


def measure(
    asked: tuple[str, ...],
    peers: bool,
    quick: bool,
    out: Path,
    data: Path | None,
    progress: Progress,
    say: Callable[[str], None],
) -> None:
    """Do what is asked for and not there yet.

    Args:
        asked: of `names`; all if empty.
        peers: other engines, too.
        quick: a coarse look at everything, in seconds.
        out: the folder.
        data: the folder with the real impacts.
        progress: of each study.
        say: tells about what can't be done; the rest goes on.

    Raises:
        ValueError: a name that is none, or a folder with another machine's results.
    """
    for name in asked:
        if name not in names():
            raise ValueError(f"scene must be one of {', '.join(names())}; got {name!r}")
    claim(out, quick)
    every = not asked
    some = [problem for name, problem in problems().items() if every or name in asked]
    others = engines(quick) if peers else []
    if peers:
        for peer, how in missing().items():
            say(f"{peer} is not installed and is left out: {how}")

    def do(title: str, file: str, cells: list[Cell]) -> None:
        if cells:
            fill(out / file, cells, progress(title, len(cells)))

    if some:
        tried = {peer.name: SWEEPS[peer.name] for peer in others}
        do("peers' settings", "sweep.csv", list(sweep.cells(some, tried, make, quick)))
        chosen = sweep.best(read(out / "sweep.csv"), {name: p.wrong for name, p in problems().items()})

        def set_for(problem: Problem) -> list[engine.Engine]:
            best = [make(peer.name, **chosen.get((problem.name, peer.name), {})) for peer in others]
            return [peer for peer in best if peer.refuses(problem.scene) is None]

        do("work-precision", "precision.csv", list(precision.cells(some, set_for, quick)))
    if every or "stability" in asked:
        methods: list[engine.Engine] = [engine.Ours(name, lean=not quick, timed=False) for name in METHODS]
        do("stability", "stability.csv", _rows(stability.cells([*methods, *others], quick)))
    if every or "ladder" in asked:
        do("ladder", "ladder.csv", _rows(ladder.cells(quick, _car())))
    if every or "reference" in asked:
        do("reference", "reference.csv", _restarts(quick))
    for name, module, file, source in REAL:
        if every or name in asked:
            path = None if data is None else data / file
            if path is None or not path.is_file():
                say(f"{name} is left out: --data has no {file} (public data: {source})")
            else:
                do(name, f"{name}.csv", [((name,), partial(module.study, path, quick))])


def _rows(cells: Iterable[tuple[Any, Callable[[], Row]]]) -> list[Cell]:
    """Cells of one row each, as cells of several."""

    def alone(work: Callable[[], Row]) -> Callable[[], list[Row]]:
        return lambda: [work()]

    return [((key,) if isinstance(key, str) else key, alone(work)) for key, work in cells]


def _restarts(quick: bool) -> list[Cell]:
    """The independent integration of each restart."""
    every = [(p, k) for p in restarts.problems() for k in range(len(p.times))]
    cells = [((p.name, str(k)), partial(reference.certify, p, k)) for p, k in every]
    return _rows(cells[:1] if quick else cells)


def _car() -> Body:
    """The car, from the restarts' data."""
    return next(p for p in restarts.problems() if p.name == "roof").scene.body


def draw(out: Path) -> Path:
    """Every figure and the report, from a folder's CSV files; returns the report's path."""
    precise = read(out / "precision.csv")
    drawn = {
        name: problem for name, problem in problems().items() if any(r["scene"] == name for r in precise)
    }
    for name, problem in drawn.items():
        plots.precision(precise, name, problem.title, problem.asks, out / f"precision-{name}")
    if precise:
        plots.fronts(precise, {name: problem.title for name, problem in drawn.items()}, out / "front")
    parts = []
    if rows := read(out / "stability.csv"):
        stability_plot.draw(rows, out / "stability")
        parts.append(("Where methods fail", report.stability(rows)))
    if rows := read(out / "ladder.csv"):
        ladder_plot.draw(rows, out / "ladder")
        parts.append(("The model ladder", report.ladder(rows)))
    for title, name, about, measures in (
        ("Real tosses of a cube", "tosses", tosses.__doc__, {"position": "% of the width", "rotation": "°"}),
        ("Real impacts of an ellipse", "ellipses", ellipses.__doc__, {"error": "%"}),
    ):
        if rows := read(out / f"{name}.csv"):
            text = report.real(rows, measures, f"flipcar chart {name} --data FOLDER")
            parts.append((title, f"{about.strip()}\n\n{text}"))
    if rows := read(out / "reference.csv"):
        parts.append(("The reference of the scenes without a closed form", report.reference(rows)))
    return report.write(out, problems(), parts, precise)
