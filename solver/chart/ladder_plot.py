"""The model ladder, drawn from its rows alone."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .ladder import NOTHING, TERMS, least
from .plots import save

LABELS = {"sweep": "several\ncontacts", NOTHING: "nothing\nleft out"}
FLOOR, CEILING = 1e-8, 1.0
"""Errors beyond are coloured as these."""

ASKED = 0.01
"""The error whose least model is named."""


def draw(rows: Sequence[dict], path: Path) -> list[Path]:
    """Scene x term: the errors of leaving it out, and the ns a step saved; beside it the least model.

    Args:
        rows: as `ladder.cells` makes them; numbers may be text, as from a CSV.
        path: without suffix, or with any; .svg and .png are written.

    Returns:
        Both files' paths.
    """
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    cell = {(row["scene"], row["term"]): row for row in rows}
    lean = least(rows, ASKED)
    shades = colormaps["YlOrRd"]
    columns, aside = (NOTHING, *TERMS), len(TERMS) + 1.12

    inch = 0.78
    height = inch * len(scenes) + 1.9
    figure = Figure(figsize=(12.5, height), facecolor="white")
    axes = figure.add_axes((0.155, 0.3 / height, 0.64, inch * len(scenes) / height))
    axes.set_xlim(0, len(columns))
    axes.set_ylim(len(scenes), 0)
    for i, scene in enumerate(scenes):
        for j, term in enumerate(columns):
            row = cell.get((scene, term))
            if row is not None:
                _cell(axes, i, j, row, shades)
        kept = (
            ", ".join(LABELS.get(term, term).replace("\n", " ") for term in lean.get(scene, ()))
            or "none of these terms"
        )
        axes.text(
            aside,
            i + 0.5,
            _wrapped(kept if scene in lean else "no model at 240 Hz"),
            va="center",
            fontsize=8.5,
        )
    axes.set_xticks(np.arange(len(columns)) + 0.5, [LABELS.get(term, term) for term in columns], fontsize=9)
    axes.set_yticks(np.arange(len(scenes)) + 0.5, scenes, fontsize=9)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.text(aside, -0.1, f"least model with an\nerror below {ASKED:g} has", fontsize=9, weight="bold")
    title, below = 1 - 0.3 / height, 1 - 0.5 / height
    figure.text(0.012, title, "What leaving a term out costs and saves", fontsize=13, weight="bold")
    figure.text(
        0.012, below,
        "Bold: error at 240 Hz after half a second, the larger of attitude (rad) and place over the body's "
        "radius. Under it: the part that no smaller step takes away, and the ns a step saved.\n"
        "Grey: the scene does not need the term; leaving it out changes no bit. A saving is negative where "
        "the leaner model moves so that it has more contacts to serve.",
        fontsize=9, va="top",
    )  # fmt: skip
    return save(figure, Path(path), dpi=150)


def _cell(axes: Any, i: int, j: int, row: dict, shades: Any) -> None:
    """One square: coloured by the logarithm of its error."""
    error, saved = float(row["error"]), float(row["ns_with"]) - float(row["ns_without"])
    whole = row["term"] == NOTHING
    out = row["in_explain"] == "out" and not whole
    share = np.log(max(error, FLOOR) / FLOOR) / np.log(CEILING / FLOOR)
    axes.add_patch(_square(j, i, "#f4f4f4" if out else shades(0.75 * min(1.0, share))))
    time = f"{float(row['ns_with']):.0f} ns" if whole else f"{saved:+.0f} ns".replace("-", "−")
    lines = [(0.5, time, 8.0, "#888888")]
    if not out:
        limit = f"limit {_short(float(row['error_model']))}"
        lines = [(0.24, _short(error), 9.5, "black"), (0.77, time, 8.0, "#222222")]
        lines += [] if whole else [(0.52, limit, 8.0, "#222222")]
    for y, text, size, colour in lines:
        weight = "bold" if size > 9 else "normal"
        axes.text(j + 0.5, i + y, text, ha="center", va="center", fontsize=size, color=colour, weight=weight)


def _short(error: float) -> str:
    """One digit; below 1e-9 it is rounding."""
    if error < 1e-9:
        return "0" if error == 0.0 else "<1e−9"
    return f"{error:.1g}" if error >= 1e-3 else f"{error:.0e}".replace("e-0", "e−")


def _square(x: float, y: float, colour: Any) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((x + 0.02, y + 0.04), 0.96, 0.92, facecolor=colour, edgecolor="none")


def _wrapped(text: str, width: int = 32) -> str:
    import textwrap

    return "\n".join(textwrap.wrap(text, width))
