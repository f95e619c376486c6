"""Three scenes without a closed form, chaotic, so in restarts of half a second along one run each.

    box     a box tumbles over rough ground
    roof    the car rocks on its roof under a torque that repeats
    crash   the car rolls out of a crash

The starts lie along a run of "exact". The answers are "exact"'s too, at its finest; `reference` says how
far an independent integration is from them. The car's sharp points are given a radius of `ROUNDED`, so that
every engine can have the same body. Everything is data, in `restarts.npz`, which
`python -m train.restarts` writes (the car is above the solver).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from solver.body import Body
from solver.rotation import angle
from solver.scene import Scene, State
from solver.surface import Plane

FILE = Path(__file__).parent / "restarts.npz"

ROUNDED = 0.02
"""m; radius of those of the car's points that are sharp."""

TITLES = {
    "box": "a box tumbling with friction",
    "roof": "the car rocking on its roof under torque",
    "crash": "the car rolling out of a crash",
}


@dataclass(frozen=True)
class Restarts:
    """A scene, k starts in it, and where each is after `duration`.

    Attributes:
        name: short.
        scene: body, plane and laws.
        starts: (k, ...).
        times: (k,) s, when the run passed them.
        duration: s.
        records: intervals in which the torque is held.
        torque: (records, 3) N m, body axes; or None.
        answer: (k, ...).
    """

    name: str
    scene: Scene
    starts: State
    times: np.ndarray
    duration: float
    records: int
    torque: np.ndarray | None
    answer: State

    @property
    def title(self) -> str:
        """For a figure."""
        return TITLES[self.name]


def to_rows(state: State) -> np.ndarray:
    """(..., 13): x, quat, v, w."""
    return np.concatenate([state.x, state.quat, state.v, state.w], axis=-1)


def from_rows(rows: np.ndarray) -> State:
    """The inverse of `to_rows`."""
    return State(*np.split(rows, [3, 7, 10], axis=-1))


def error(problem: Restarts, final: State) -> np.ndarray:
    """(k,) √((|Δx|/R)² + θ²): place over the bounding radius R, and attitude, rad. Charts show its median."""
    place = np.linalg.norm(final.x - problem.answer.x, axis=-1) / problem.scene.body.bounding_radius
    return np.hypot(place, angle(final.quat, problem.answer.quat))


def save(path: Path, all_problems: list[Restarts]) -> None:
    """Write what `problems` reads."""
    arrays: dict[str, np.ndarray] = {}
    for problem in all_problems:
        body, scene = problem.scene.body, problem.scene
        values = {
            "m": body.m, "J": body.J, "hull": body.hull, "radius": body.radius,
            "normal": scene.surface.parameters[:3], "gravity": scene.gravity,
            "law": [scene.friction, scene.restitution],
            "starts": to_rows(problem.starts), "times": problem.times, "duration": problem.duration,
            "records": problem.records, "answer": to_rows(problem.answer),
            "torque": np.zeros((0, 3)) if problem.torque is None else problem.torque,
        }  # fmt: skip
        arrays.update({f"{problem.name}/{key}": np.asarray(value) for key, value in values.items()})
    np.savez_compressed(path, allow_pickle=False, **arrays)


def problems(path: Path = FILE) -> list[Restarts]:
    """The three scenes, in the order of TITLES."""
    found = []
    with np.load(path, allow_pickle=False) as data:
        for name in TITLES:
            what = {key.removeprefix(f"{name}/"): data[key] for key in data if key.startswith(f"{name}/")}
            scene = Scene(
                Body(float(what["m"]), what["J"], what["hull"], what["radius"]),
                Plane(what["normal"]), what["gravity"], *map(float, what["law"]),
            )  # fmt: skip
            found.append(
                Restarts(
                    name, scene, from_rows(what["starts"]), what["times"], float(what["duration"]),
                    int(what["records"]), what["torque"] if len(what["torque"]) else None,
                    from_rows(what["answer"]),
                )
            )  # fmt: skip
    return found
