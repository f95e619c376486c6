"""How the viewer shows a recording: its blueprints."""

from collections.abc import Callable, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from flipcar_env import car

from .entities import FOCUS_HEIGHT, TIMELINE

SKYLINE = (205, 214, 222)
EYE = (3.4, -5.2, 2.9)
"""The camera starts here and looks at the point that it follows."""

WINDOW = (-6.0, 3.0)
"""s before and after the time cursor that the plots show of a recording that is longer, or not over."""

TORQUE = 1e-3 * max(car.TORQUE_LIMIT)
"""kN m."""


def single(end: float | None) -> rrb.Blueprint:
    """The scene on the left; status, phases and plots on the right.

    Args:
        end: of the recording, s; None if it is not over.
    """
    times = _Times(end)
    return _shown(
        rrb.Horizontal(
            _scene("Scene"),
            rrb.Vertical(
                rrb.TextDocumentView(name="Status", origin="status"),
                times.strip("Phase", "phase"),
                times.plot(UPRIGHT, ["plots/upright"], (-1.1, 1.1), False),
                times.plot("Height over the ground, m", ["plots/height"], None, False),
                times.plot(
                    f"Torque, kN m (limit {TORQUE:g})", ["plots/torque"], (-1.15 * TORQUE, 1.15 * TORQUE)
                ),
                rrb.Tabs(
                    times.plot("Reward", ["plots/reward"]),
                    times.plot("Energy, kJ", ["plots/energy"]),
                    times.plot("Speed and spin", ["plots/motion"]),
                ),
                row_shares=[20, 20, 28, 28, 36, 38],
            ),
            column_shares=[3, 2],
        )
    )


def comparison(end: float, roots: Sequence[str], names: Sequence[str]) -> rrb.Blueprint:
    """Scenes side by side, each with its status and phases; below, plots with a line for each.

    Args:
        end: of the recording, s.
        roots: of the episodes' entities.
        names: of who drove.
    """
    times = _Times(end)
    scenes = [
        rrb.Vertical(
            _scene(name, root, 0.7),
            rrb.TextDocumentView(name=f"{name}: status", origin=f"{root}/status"),
            times.strip(f"{name}: phase", f"{root}/phase"),
            row_shares=[60, 16, 14],
        )
        for root, name in zip(roots, names, strict=True)
    ]
    plots = rrb.Horizontal(
        times.plot(UPRIGHT, [f"{root}/plots/upright" for root in roots], (-1.1, 1.1)),
        times.plot("Height over the ground, m", [f"{root}/plots/height" for root in roots]),
        rrb.Tabs(
            times.plot("Energy, kJ", [f"{root}/plots/energy/mechanical" for root in roots]),
            times.plot("Speed, m/s", [f"{root}/plots/motion/speed" for root in roots]),
            times.plot("Roll torque, kN m", [f"{root}/plots/torque/roll" for root in roots]),
        ),
    )
    return _shown(rrb.Vertical(rrb.Horizontal(*scenes), plots, row_shares=[70, 30]))


def grid(end: float, n: int, middle: np.ndarray, width: float) -> rrb.Blueprint:
    """All cars in one scene; below, how many have been recovered.

    Args:
        end: of the recording, s.
        n: cars.
        middle: of them, m.
        width: of the ground that they stand on, m.
    """
    times = _Times(end)
    eye = middle + width * np.array([0.25, -0.7, 0.5])
    scene = rrb.Spatial3DView(
        name="Scene",
        origin="world",
        background=SKYLINE,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye,
            look_target=middle - [0, 0.1 * width, 0],
            eye_up=(0.0, 0.0, 1.0),
        ),
    )
    below = rrb.Horizontal(
        rrb.TextDocumentView(name="Status", origin="status"),
        times.plot(f"Recovered, of {n}", ["plots/recovered"], (0.0, 1.05 * n), False),
        times.plot("Mean uprightness", ["plots/upright"], (-1.1, 1.1), False),
    )
    return _shown(rrb.Vertical(scene, below, row_shares=[75, 25]))


UPRIGHT = "Uprightness (1: on its wheels, -1: on its roof)"


class _Times:
    """The stretch of time that plots show: all of a short recording, a window of a long one.

    Args:
        end: of the recording, s; None if it is not over.
    """

    def __init__(self, end: float | None):
        at: Callable[..., rrb.TimeRangeBoundary]
        if end is not None and end <= WINDOW[1] - WINDOW[0]:
            at, first, last = rrb.TimeRangeBoundary.absolute, 0.0, end
        else:
            at, first, last = rrb.TimeRangeBoundary.cursor_relative, *WINDOW
        # The curves end before the axes do: room for the legends on the left.
        margin = 0.22 * (last - first)
        self.axis = rrb.TimeAxis(
            view_range=rr.TimeRange(start=at(seconds=first - margin), end=at(seconds=last + 0.1))
        )
        self.range = rrb.VisibleTimeRange(TIMELINE, start=at(seconds=first), end=at(seconds=last + 0.1))

    def plot(
        self,
        name: str,
        entities: Sequence[str],
        limits: tuple[float, float] | None = None,
        legend: bool = True,
    ) -> rrb.View:
        """A plot of some entities and of what is below them."""
        return rrb.TimeSeriesView(
            name=name,
            contents=[f"{entity}/**" for entity in entities],
            axis_x=self.axis,
            axis_y=rrb.ScalarAxis(range=limits) if limits else None,
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend),
            time_ranges=self.range,
        )

    def strip(self, name: str, entity: str) -> rrb.View:
        """A strip of phases."""
        return rrb.StateTimelineView(name=name, origin=entity, time_view=self.axis, time_ranges=self.range)


def _scene(name: str, root: str = "", near: float = 1.0) -> rrb.View:
    """The world of one car; the camera follows it, at this share of its usual distance."""
    return rrb.Spatial3DView(
        name=name,
        origin=f"{root}/world",
        background=SKYLINE,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=near * np.array(EYE),
            look_target=(0.0, 0.0, FOCUS_HEIGHT),
            eye_up=(0.0, 0.0, 1.0),
            tracking_entity=f"{root}/world/focus",
        ),
    )


def _shown(views: rrb.Container) -> rrb.Blueprint:
    """With the panels out of the way."""
    return rrb.Blueprint(
        views,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
    )
