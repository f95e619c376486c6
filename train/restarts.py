"""Makes the restarts of `solver.chart.restarts`: `python -m train.restarts` writes their file.

Along one run of "exact" in each scene there is a candidate every 0.1 s. It is taken if it moves, and not
only flies; if nothing happens within a microsecond of it; if an independent integration finds one answer,
and the same; and if the answer does not depend on the law of impacts. Where a point slides through an
impact, it does: the path of Eq. 12 and Newton's law at once, with the same friction and restitution, then
end far apart after half a second, and a chart would show laws, not accuracy. With μ = 0.8 points mostly
stick.
"""

from collections.abc import Iterator

import numpy as np
from tqdm import tqdm

from flipcar_env import car
from solver import Body, Scene, State, simulate
from solver.chart import reference
from solver.chart.coulomb import Undetermined
from solver.chart.restarts import FILE, ROUNDED, TITLES, Restarts, from_rows, save, to_rows
from solver.rotation import product

DURATION, RECORDS = 0.5, 5

FINEST = 1e-13
"""The tolerance of "exact" that the answers are made with."""

SPACING, CANDIDATES = 0.1, 40
APART, MOST = 0.2, 10
"""s between restarts, at least; of each scene."""

CLEAR = 1e-6
"""s: nothing happens within that of a start."""

AGREES = 1e-8
"""m, rad, m/s, rad/s: how far the independent answer may be, and the one by another law of impacts."""

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
    still = np.zeros(3)
    found = {}
    for name, scene, quat, v, w, torque in (
        ("box", rough, attitude(0.5, 0.3, 0.2), (6, 1, 0), (1, 9, 2), None),
        ("roof", ground, attitude(np.pi - 0.2, 0.02, 0.1), still, (0.3, 0.1, 0.05), PUSH),
        ("crash", ground, attitude(0.4, 0.1, 0.2), (1, 12, 0), (-9, 0.3, 0.3), None),
    ):
        low = scene.gap(State(still, quat, still, still)).min()
        start = State(np.array([0, 0, 1e-3 - low]), quat, np.array(v), np.array(w))
        found[name] = scene, start, torque
    return found


def finest(scene: Scene, start: State, duration: float, torque=None) -> State:
    """The state after `duration` by "exact"; torque (3,) or (RECORDS, 3)."""
    torque = np.zeros((1, 3)) if torque is None else np.atleast_2d(torque)
    interval = duration / len(torque)
    return simulate(
        scene, start, duration, interval, "exact", options={"tol": FINEST},
        torque=lambda t: torque[min(len(torque) - 1, round(t / interval))],
    ).state  # fmt: skip


def candidates(scene: Scene, state: State, torque: np.ndarray | None) -> Iterator[tuple[float, State]]:
    """(time, state) every SPACING along the run from `state`, where nothing happens at about that time."""
    for n in range(CANDIDATES):
        tau = np.zeros(3) if torque is None else torque[n % RECORDS]
        before = finest(scene, state, SPACING - CLEAR, tau)
        state = finest(scene, before, CLEAR, tau)
        if max(np.abs(state.v).max(), np.abs(state.w).max()) < MOVES:
            continue
        try:
            _end, seen = reference.play(scene, before, 2.0 * CLEAR, tau[None])
        except Undetermined:
            continue
        if not seen["events"] + seen["impacts"] + seen["impacts of several"]:
            yield round((n + 1) * SPACING, 9), state


def gather(found: list[State]) -> State:
    """A batch."""
    return from_rows(np.array([to_rows(state) for state in found]))


def make(name: str) -> Restarts:
    """The restarts of one scene."""
    scene, first, torque = runs()[name]

    def restarts(times: list[float], starts: list[State], answers: list[State]) -> Restarts:
        return Restarts(
            name, scene, gather(starts), np.array(times), DURATION, RECORDS, torque, gather(answers)
        )

    kept: list[tuple[float, State, State]] = []
    for t, start in tqdm(candidates(scene, first, torque), desc=name, unit=" candidates"):
        if kept and t < kept[-1][0] + APART - 1e-9:
            continue
        answer = finest(scene, start, DURATION, torque)
        try:
            row = reference.certify(restarts([t], [start], [answer]), 0)
        except Undetermined as why:
            tqdm.write(f"{name}, {t:.1f} s: left out, {why}")
            continue
        off = max(row[key] for key in ("x_m", "attitude_rad", "v_m_s", "w_rad_s"))
        law = row["other_impact_law"]
        if not row["impacts"] + row["impacts_of_several"] + row["most_closed"]:
            tqdm.write(f"{name}, {t:.1f} s: left out, it only flies")
        elif off < AGREES and law < AGREES:
            kept.append((t, start, answer))
        else:
            tqdm.write(f"{name}, {t:.1f} s: left out, off by {off:.1e}, impact laws by {law:.1e}")
        if len(kept) == MOST:
            break
    return restarts(*map(list, zip(*kept, strict=True)))


def main() -> None:
    """Make them all, and write them."""
    save(FILE, [make(name) for name in TITLES])


if __name__ == "__main__":
    main()
