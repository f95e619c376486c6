"""The figure of `train.settings`, drawn from its rows alone."""

from pathlib import Path
from typing import Any

import numpy as np

from solver.chart.plots import COLOURS, GRID, OTHER, save, style

from .settings import DEFAULT, HORIZONS, NOTICED, REFERENCE
from .settings_verdict import Rows, cheapest, pick

CHOSEN = "#e4f1e6"
HORIZON = dict(
    zip(HORIZONS, ((COLOURS["impulse"], "one control step"), ("#c2410c", "half a second")), strict=True)
)
RESOLUTION = 2.0**-24
"""Of a float32 observation, relative."""


def draw(rows: Rows, path: Path) -> None:
    """Draw error, success and cost over the physics steps in a control step, as SVG and PNG.

    Args:
        rows: as `settings.cells` makes them.
        path: of the figure; its suffix is replaced.
    """
    plt = style()
    figure = plt.figure(figsize=(9.0, 5.4), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.1, 1.0))
    for place, panel, right in (
        (grid[:, 0], _error, 14.0),
        (grid[0, 1], _success, 1.5),
        (grid[1, 1], _cost, 1.5),
    ):
        axes = figure.add_subplot(place)
        axes.set_xscale("log")
        panel(axes, rows)
        n = sorted({row["substeps"] for row in pick(rows, "cost")})
        axes.set_xticks(n, [f"{k:g}" for k in n])
        axes.minorticks_off()
        axes.set_xlim(n[0] / 1.5, n[-1] * right)
        chosen = cheapest(rows)
        if chosen is not None:
            axes.axvspan(chosen / 1.17, chosen * 1.17, color=CHOSEN, zorder=0)
    figure.supxlabel("physics steps in a control step of 0.04 s", fontsize=9)
    save(figure, Path(path))


def _error(axes: Any, rows: Rows) -> None:
    axes.set_yscale("log")
    axes.grid(True, axis="y", **GRID)
    for horizon, (colour, name) in HORIZON.items():
        found = pick(rows, "error", method="impulse", control_steps=horizon)
        n = [row["substeps"] for row in found]
        for column, line, tail in (
            ("action_rare", "-", "in all but 1\nof 250 steps"),
            ("action_p50", ":", "in half of them"),
        ):
            error = np.maximum([row[column] for row in found], RESOLUTION / 2)
            axes.plot(n, error, line, color=colour, marker="o", markersize=3, linewidth=1.5)
            if column == "action_rare":
                _label(axes, f"after {name}", (n[-1], error[-1]), (5, 0), color=colour)
            if horizon == HORIZONS[-1]:
                _label(axes, tail, (n[0], error[0]), (-2, 13))
    for level, text in ((NOTICED, "a policy notices"), (RESOLUTION, "float32 resolution")):
        axes.axhline(level, color=OTHER, linewidth=1)
        _label(axes, text, (n[-1], level), (5, 6))
    for method, below in (("acceleration", False), ("baumgarte", True)):
        found = pick(rows, "error", method=method)
        if found:
            at = [row["substeps"] for row in found]
            error = [row["action_rare"] for row in found]
            axes.plot(at, error, "x--", color=OTHER, linewidth=0.8, markersize=5)
            _label(axes, f'"{method}"', (at[-1], error[-1]), (5, -5 if below else 5), color=OTHER)
    axes.set_ylabel("change of the policy's next action, of full torque")
    axes.set_title(f"Error, against {REFERENCE} steps", loc="left")


def _label(axes: Any, text: str, at: tuple[float, float], offset: tuple[float, float], color="black") -> None:
    """Text from a point on, offset in points."""
    axes.annotate(text, at, offset, textcoords="offset points", va="center", fontsize=8, color=color)


def _success(axes: Any, rows: Rows) -> None:
    """Cars not recovered: a number for each start and setting."""
    found = pick(rows, "success")
    starts = list(dict.fromkeys(row["start"] for row in found))
    for row in found:
        lost = round((1.0 - row["success"]) * row["n"])
        axes.text(row["substeps"], starts.index(row["start"]), f"{lost}", ha="center", va="center")
    axes.set_yticks(range(len(starts)), starts)
    axes.set_ylim(len(starts) - 0.4, -0.6)
    axes.tick_params(length=0)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.set_title(f"Cars not recovered, of {found[0]['n']:g}", loc="left")


def _cost(axes: Any, rows: Rows) -> None:
    found = pick(rows, "cost")
    n = [row["substeps"] for row in found]
    low, middle, high = (
        np.array([row[name] for row in found]) for name in ("ratio_p10", "ratio", "ratio_p90")
    )
    axes.set_yscale("log")
    axes.grid(True, axis="y", **GRID)
    axes.fill_between(n, low, high, color=COLOURS["impulse"], alpha=0.25, linewidth=0)
    axes.plot(n, middle, "o-", color=COLOURS["impulse"], markersize=3, linewidth=1.5)
    for steps, ratio in zip(n, middle, strict=True):
        axes.annotate(
            f"{ratio:.2g}", (steps, ratio), (0, 7), textcoords="offset points", ha="center", fontsize=8
        )
    axes.set_ylim(low.min() / 1.6, high.max() * 2)
    axes.set_title(f"Time of a control step, of that with {DEFAULT}", loc="left")
