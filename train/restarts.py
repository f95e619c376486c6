"""Makes the restarts of `solver.chart.restarts`: `python -m train.restarts` writes their file.

Along one run of "exact" in each scene, a candidate every 0.1 s. One is taken if an independent integration
finds one answer and the same, nothing happens within a microsecond of its start, and it is not at rest.
"""

import argparse
from pathlib import Path

import numpy as np
from tqdm import tqdm

from flipcar_env import car
from solver import Body, Scene, State, simulate
from solver.chart import reference
from solver.chart.coulomb import Undetermined
from solver.chart.restarts import FILE, ROUNDED, Restarts, TITLES, from_rows, save, to_rows
from solver.rotation import product

DURATION, RECORDS = 0.5, 5

FINEST = 1e-13
"""The tolerance of "exact" that the answers are made with."""

SPACING, CANDIDATES = 0.1, 40

CLEAR = 1e-6
"""s: nothing happens within that of a start."""

AGREES = 1e-8
"""m, rad, m/s, rad/s: how far the independent answer may be."""

MOVES = 0.05
"""m/s or rad/s: slower than this it is about to rest, and there is little to get wrong."""

PUSH = car.TORQUE_LIMIT[0] * np.array(
    [[1, 0.3, 0], [1, 0.3, 0.4], [-1, 0, 0.4], [-1, -0.3, -0.4], [0, -0.3, -0.4]]
)
"""(RECORDS, 3) N m; repeated every half second."""


def attitude(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Turned by roll about x, then pitch about y, then yaw about z, rad."""
    axes = np.eye(3)
    turns = [
        np.append(np.cos(a / 2), np.sin(a / 2) * axis)
        for a, axis in zip((roll, pitch, yaw), axes, strict=True)
    ]
    return product(turns[2], product(turns[1], turns[0]))


def rounded_car() -> Body:
    """The car, its sharp points rounded."""
    body = car.body()
    return Body(body.m, body.J, body.hull, np.where(body.radius > 0.0, body.radius, ROUNDED))


def runs() -> dict[str, tuple[Scene, State, np.ndarray | None]]:
    """Of each scene: itself, where its run starts (the lowest point a millimetre up), the torque."""
    rough = Scene(Body.box(50.0, (0.6, 0.8, 1.0)), friction=0.8)
    ground = Scene(rounded_car(), friction=car.FRICTION, restitution=car.RESTITUTION)
    starts = {
        "box": (rough, attitude(0.5, 0.3, 0.2), [6, 1, 0], [1, 9, 2], None),
        "roof": (ground, attitude(np.pi - 0.2, 0.02, 0.1), [0, 0, 0], [0.3, 0.1, 0.05], PUSH),
        "crash": (ground, attitude(0.4, 0.1, 0.2), [1, 14, 0], [-5, 0.2, 0.3], None),
    }
    found = {}
    for name, (scene, quat, v, w, torque) in starts.items():
        low = scene.gap(State(np.zeros(3), quat, v, w)).min()
        found[name] = scene, State([0, 0, 1e-3 - low], quat, v, w), torque
    return found


def finest(scene: Scene, start: State, duration: float, torque=None) -> State:
    """The state after `duration` by "exact"; torque (3,) or (RECORDS, 3)."""
    torque = np.zeros((1, 3)) if torque is None else np.atleast_2d(torque)
    interval = duration / len(torque)
    return simulate(
        scene, start, duration, interval, "exact", options={"tol": FINEST},
        torque=lambda t: torque[min(len(torque) - 1, round(t / interval))],
    ).state  # fmt: skip


def candidates(scene: Scene, state: State, torque: np.ndarray | None) -> list[tuple[float, State]]:
    """(time, state) every SPACING along the run from `state`, where nothing happens at about that time."""
    found = []
    for n in range(CANDIDATES):
        tau = np.zeros(3) if torque is None else torque[n % RECORDS]
        before = finest(scene, state, SPACING - CLEAR, tau)
        state = finest(scene, before, CLEAR, tau)
        slow = max(np.abs(state.v).max(), np.abs(state.w).max()) < MOVES
        if slow:
            continue
        _end, seen = reference.play(scene, before, 2.0 * CLEAR, tau[None])
        if not slow and seen["events"] + seen["impacts"] + seen["impacts of several"] == 0:
            found.append(((n + 1) * SPACING, state))
    return found


def gather(found: list[State]) -> State:
    """A batch."""
    return from_rows(np.array([to_rows(state) for state in found]))


def make(name: str, most: int) -> Restarts:
    """The restarts of one scene."""
    scene, first, torque = runs()[name]
    kept = []
    for t, start in tqdm(candidates(scene, first, torque), desc=name):
        answer = finest(scene, start, DURATION, torque)
        batch = Restarts(
            name,
            TITLES[name],
            scene,
            gather([start]),
            np.array([t]),
            DURATION,
            RECORDS,
            torque,
            gather([answer]),
        )
        try:
            row = reference.certify(batch, 0)
        except Undetermined as why:
            tqdm.write(f"{name} {t:.1f} s: {why}")
            continue
        tqdm.write(" ".join(f"{v:.2g}" if isinstance(v, float) else str(v) for v in row.values()))
        if max(row[key] for key in ("x_m", "attitude_rad", "v_m_s", "w_rad_s")) < AGREES:
            kept.append((row["other_impact_law"], t, start, answer))
    _law, times, starts, answers = zip(*kept, strict=True)
    return Restarts(
        name, TITLES[name], scene, gather(list(starts)), np.array(times), DURATION, RECORDS, torque,
        gather(list(answers)),
    )  # fmt: skip


def main() -> None:
    """Make them all, and write them."""
    save(FILE, [make(name, 10) for name in TITLES])


if __name__ == "__main__":
    main()
