"""Contact physics of one rigid body on one surface: exact, fast, and no bigger than the scene needs.

>>> from solver import Body, Scene, State, simulate
>>> scene = Scene(Body.box(1.0, (1, 1, 1)), friction=0.5)
>>> run = simulate(scene, State([0, 0, 0.5], [1, 0, 0, 0], [1, 0, 0], [0, 0, 0]), duration=1.0)
>>> round(float(run.x[-1, 0]), 3)  # v² / 2μg
0.102
"""

from .body import Body
from .errors import SolverError
from .scene import Contact, Scene, State
from .simulate import METHODS, Run, simulate
from .surface import HeightField, Plane

__all__ = [
    "METHODS",
    "Body",
    "Contact",
    "HeightField",
    "Plane",
    "Run",
    "Scene",
    "SolverError",
    "State",
    "simulate",
]
