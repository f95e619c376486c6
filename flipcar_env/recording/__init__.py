"""Recordings of episodes for the rerun viewer: the only package with rerun.

`write` makes files of episodes, `Live` shows them as they happen, `RerunRecorder` is a wrapper that keeps
some of an environment's. Inside, `entities` has what is sent, `layout` how the viewer shows it, and
`viewer` the process.
"""

from .entities import PHASE_COLOURS, TIMELINE
from .live import Live
from .viewer import has_display, view
from .wrapper import RerunRecorder
from .write import save, save_comparison, save_grid, start_times

__all__ = [
    "PHASE_COLOURS",
    "TIMELINE",
    "Live",
    "RerunRecorder",
    "has_display",
    "save",
    "save_comparison",
    "save_grid",
    "start_times",
    "view",
]
