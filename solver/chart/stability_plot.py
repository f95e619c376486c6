"""The stability map as a picture, from its rows alone."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from .plots import save

STEP = "dt"
SCALE = LinearSegmentedColormap.from_list("map", ["#f6d9a8", "#f3eec4", "#bfe0c0", "#6bb58f"])
NEVER, REFUSED = "#e9a59b", "#f2f2f2"
INK, FAINT = "#222222", "#8a8a8a"
WIDTH, ROW = 9.0, 0.27
"""Inches: of the picture, and the height of a row."""

Row = Mapping[str, Any]


def draw(rows: Iterable[Row], path: str | Path) -> list[Path]:
    """Draw the map: method by scene for the largest step, then for the hardest scene; then the naive methods.

    A cell's colour says how far along what was tried the method came; a red edge, that it fails at shorter
    steps or in easier scenes than those named. A number behind a bar is the limit known beforehand.

    Args:
        rows: of `stability.cells`, or as read from CSV.
        path: of the picture, its suffix apart.

    Returns:
        The files written: SVG and PNG.
    """
    rows = list(rows)
    table = [row for row in rows if row["kind"] != "naive"]
    naive = [row for row in rows if row["kind"] == "naive"]
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    lists = _pairs(naive)
    heights = [len(scenes) + 3.2, len(scenes) + 3.2, len(lists) + 2.4]
    figure = Figure(figsize=(WIDTH, ROW * sum(heights)), facecolor="white", layout="constrained")
    axes = figure.subplots(3, 1, gridspec_kw={"height_ratios": heights})
    _grid(
        axes[0],
        [row for row in table if row["varied"] == STEP],
        scenes,
        "Largest time step (s) that is right",
    )
    _grid(
        axes[1],
        [row for row in table if row["varied"] != STEP],
        [scene for scene in scenes if any(r["scene"] == scene and r["varied"] != STEP for r in rows)],
        "Hardest scene that is right, at a step of 1/240 s",
    )
    _list(axes[2], lists)
    return save(figure, Path(path), dpi=200)


def text(row: Row, value: Any, digits: int = 4) -> str:
    """A step as a fraction, a parameter as it is."""
    return f"1/{round(1 / float(value))}" if row["varied"] == STEP else f"{float(value):.{digits}g}"


def label(row: Row) -> tuple[str, Any, bool]:
    """What stands in a cell, its colour, and whether the easiest fails while some other is right."""
    if row["note"].startswith("n/a"):
        return "n/a", REFUSED, False
    only = row["note"].partition("right at ")[2].partition(":")[0].split()
    if row["largest"] == "" and not only:
        return "never", NEVER, False
    best = only[-1] if only else row["largest"]
    shown = text(row, best) if not only or len(only) == 1 else f"{text(row, only[0])}\nto {text(row, best)}"
    tried = [float(x) for x in row["tried"].split(";")]
    # the row keeps what was tried to six digits
    at = min(range(len(tried)), key=lambda n: abs(tried[n] - float(best)))
    return shown, SCALE(at / max(1, len(tried) - 1)), bool(only)


def _hardest(row: Row) -> str:
    """The last value that may be tried, with its unit."""
    return f"{float(row['tried'].split(';')[-1]):.4g} {row['unit']}".strip()


def _grid(ax: Axes, rows: list[Row], scenes: list[str], title: str) -> None:
    """Scenes down, methods across; ours first."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    for row in rows:
        i, j = scenes.index(row["scene"]), methods.index(row["method"])
        _cell(ax, j, i, row)
    for i, scene in enumerate(scenes):
        varied = next((row for row in rows if row["scene"] == scene), None)
        name = scene.replace("-", " ")
        if varied is not None and varied["varied"] != STEP:
            name += f": {varied['varied']} to {_hardest(varied)}"
        ax.text(-0.12, i + 0.5, name, ha="right", va="center", fontsize=7.5, color=INK)
    for j, method in enumerate(methods):
        ours = any(row["method"] == method and row["kind"] == "ours" for row in rows)
        ax.text(
            j + 0.5, -0.15, _broken(method), ha="center", va="bottom", fontsize=6.5, color=INK,
            fontweight="bold" if ours else "normal",
        )  # fmt: skip
    _frame(ax, len(methods), len(scenes), title)


def _cell(ax: Axes, j: float, i: float, row: Row) -> None:
    shown, colour, partly = label(row)
    ax.add_patch(Rectangle((j + 0.02, i + 0.04), 0.96, 0.92, facecolor=colour, edgecolor="none"))
    if partly:
        ax.add_patch(Rectangle((j + 0.02, i + 0.04), 0.06, 0.92, facecolor=NEVER, edgecolor="none"))
    known = row["limit_analytic"]
    small = "\n" in shown
    if known == "":
        ax.text(j + 0.5, i + 0.5, shown, ha="center", va="center", fontsize=5.5 if small else 7.5, color=INK)
        return
    ax.text(j + 0.3, i + 0.5, shown, ha="center", va="center", fontsize=5.5 if small else 7, color=INK)
    ax.plot([j + 0.58, j + 0.58], [i + 0.12, i + 0.88], color=INK, linewidth=1.0)
    ax.text(
        j + 0.79,
        i + 0.5,
        text(row, known, 3),
        ha="center",
        va="center",
        fontsize=6,
        color=INK,
        style="italic",
    )


def _pairs(rows: list[Row]) -> list[tuple[Row, Row | None]]:
    """Of each naive method and scene: the cell of the step and that of the scene's parameter."""
    steps = [row for row in rows if row["varied"] == STEP]
    rest = {(row["method"], row["scene"]): row for row in rows if row["varied"] != STEP}
    return [(row, rest.get((row["method"], row["scene"]))) for row in steps]


def _list(ax: Axes, pairs: list[tuple[Row, Row | None]]) -> None:
    """Naive methods, each in the scenes that it is for."""
    for i, (step, varied) in enumerate(pairs):
        scene = step["scene"].replace("-", " ")
        ax.text(
            -0.03, i + 0.5, f"{step['method']}, {scene}", ha="right", va="center", fontsize=7.5, color=INK
        )
        _cell(ax, 0, i, step)
        if varied is not None:
            _cell(ax, 1, i, varied)
            aim = f"{varied['varied']} to {_hardest(varied)}"
            ax.text(2.03, i + 0.5, aim, ha="left", va="center", fontsize=7, color=FAINT)
    for j, head in enumerate(("largest step, s | limit by theory", "hardest scene | limit by theory")):
        ax.text(j + 0.5, -0.15, head, ha="center", va="bottom", fontsize=7.5, color=INK)
    _frame(ax, 3, len(pairs), "Methods as one would first write them, where each applies")


def _broken(name: str) -> str:
    """A name of two words over two lines."""
    return name.replace(" ", "\n", 1)


def _frame(ax: Axes, columns: int, count: int, title: str) -> None:
    ax.set_xlim(0, max(1, columns))
    ax.set_ylim(max(1, count), 0)
    ax.set_axis_off()
    ax.set_title(title, loc="left", fontsize=9.5, color=INK, pad=28)
