"""The model ladder, drawn from its rows alone."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .ladder import TERMS, least

LABELS = {"sweep": "several contacts"}
FLOOR, CEILING = 1e-8, 1.0
"""Errors beyond are coloured as these."""

ASKED = 0.01
"""The error whose least model is named."""


def draw(rows: Sequence[dict], path: Path) -> list[Path]:
    """Scene x term: the error of leaving it out, and the ns a step saved; beside it the least model.

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

    height = 0.62 * len(scenes) + 1.9
    figure = Figure(figsize=(11.5, height), facecolor="white")
    axes = figure.add_axes((0.165, 0.35 / height, 0.6, (0.62 * len(scenes)) / height))
    axes.set_xlim(0, len(TERMS))
    axes.set_ylim(len(scenes), 0)
    for i, scene in enumerate(scenes):
        for j, term in enumerate(TERMS):
            row = cell.get((scene, term))
            if row is not None:
                _cell(axes, i, j, row, shades)
        kept = ", ".join(LABELS.get(term, term) for term in lean.get(scene, ()))
        axes.text(len(TERMS) + 0.12, i + 0.5, _wrapped(kept or "none of them"), va="center", fontsize=8.5)
    axes.set_xticks(np.arange(len(TERMS)) + 0.5, [LABELS.get(term, term) for term in TERMS], fontsize=9)
    axes.set_yticks(np.arange(len(scenes)) + 0.5, scenes, fontsize=9)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.text(
        len(TERMS) + 0.12, -0.12, f"least model with an\nerror below {ASKED:g} has", fontsize=9, weight="bold"
    )
    figure.text(
        0.012, 1 - 0.3 / height, "What leaving a term out costs and saves", fontsize=13, weight="bold"
    )
    figure.text(
        0.012, 1 - 0.62 / height,
        "Bold: error after half a second, the larger of attitude (rad) and place over the body's radius, "
        "in the limit of small steps. Below: ns a step saved at 240 Hz.\n"
        "Blank: the scene does not need the term; its error is exactly 0.",
        fontsize=9, va="top",
    )  # fmt: skip
    path = Path(path)
    files = [path.with_suffix(suffix) for suffix in (".svg", ".png")]
    for file in files:
        figure.savefig(file, dpi=150)
    return files


def _cell(axes: Any, i: int, j: int, row: dict, shades: Any) -> None:
    """One square: coloured by the logarithm of its error."""
    error = float(row["error_model"])
    saved = float(row["ns_with"]) - float(row["ns_without"])
    out = row["in_explain"] == "out"
    share = np.log(max(error, FLOOR) / FLOOR) / np.log(CEILING / FLOOR)
    colour = "#f4f4f4" if out else shades(0.75 * min(1.0, share))
    axes.add_patch(_square(j, i, colour))
    if not out:
        text = "0" if error == 0.0 else f"{error:.1g}" if error >= 1e-3 else f"{error:.0e}"
        axes.text(j + 0.5, i + 0.38, text, ha="center", va="center", fontsize=9.5, weight="bold")
    axes.text(
        j + 0.5, i + (0.5 if out else 0.74), f"{saved:+.0f} ns".replace("-", "−"), ha="center", va="center",
        fontsize=8, color="#888888" if out else "#222222",
    )  # fmt: skip


def _square(x: float, y: float, colour: Any) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((x + 0.02, y + 0.04), 0.96, 0.92, facecolor=colour, edgecolor="none")


def _wrapped(text: str, width: int = 32) -> str:
    import textwrap

    return "\n".join(textwrap.wrap(text, width))
