"""An independent answer: Eqs. 1-12 in world axes, from event to event, integrated by SciPy's DOP853.

    play     settle how points touch, go on to the first sign of an event, and again
    settle   impacts; then which closed points push, stick and slide
    blow     a lone point's impact along its path (Eq. 12); several points' all at once, by Newton's law
    until    one stretch of smooth motion

It shares scenes and states with the solver, and no line of mechanics. It knows planes only.

`python -m solver.chart.reference` plays every restart of `restarts.problems`, and says how far the answers
that are stored with them are from its own.
"""

import csv
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from solver.scene import Scene, State

from .coulomb import OFF, STICKS, Undetermined, contacts, room, roomiest, solve
from .restarts import RESULTS, Restarts, angle, from_rows, problems, to_rows

RTOL, ATOL = 1e-13, 1e-15

SAMPLES = 12
"""Of each step, where signs of an event are looked for."""

NEAR = 1e-9
"""m, m/s: points this near the surface touch it; slower ones neither close nor slip."""

FADED = 1e-10
"""m/s: slip that has become so slow has stopped; what is left of it is taken away."""

NASCENT = 1e-11
"""m/s: slip that is slower yet has the direction in which it began."""

BARELY = 1e-7
"""m/s: a point that comes down slower does not bounce."""

PULLS = 1e-9
"""Of the weight: by so much a force must pull, or friction hold too much, to end a stretch."""

PATH_END = 1e-11
"""Of the point's speed before an impact: slip so slow has stopped."""

MAX_EVENTS = 500


class Pose:
    """The quantities of Eqs. 1-6 and 10 in one state, world axes.

    Args:
        scene: over a plane.
        y: (13,) x, quat, v, w.
        tau: (3,) N m, body axes.

    Attributes:
        gap: (p,) m (Eq. 4).
        W: (p, 3, 6) of each point the rows [dᵀ, (q × d)ᵀ] for d = N, t1, t2.
        u: (p, 3) velocity of the contact points along them, m/s.
        c: (p, 3) w × (w × b) along them (Eq. 5), m/s².
        inv_M: (6, 6).
        a: (6,) acceleration without contact.
    """

    def __init__(self, scene: Scene, y: np.ndarray, tau: np.ndarray):
        body, N = scene.body, scene.surface.normal
        x, w = y[:3], y[10:]
        R = Rotation.from_quat(y[3:7], scalar_first=True).as_matrix()
        J = R @ body.J @ R.T
        axes = np.linalg.svd(N[None])[2]
        axes[0] = N
        b = body.hull @ R.T
        q = b - body.radius[:, None] * N
        self.gap = (x + b - scene.surface.point) @ N - body.radius
        along = np.broadcast_to(axes, (len(b), 3, 3))
        self.W = np.concatenate([along, np.cross(q[:, None], along)], axis=2)
        self.u = self.W @ y[7:]
        self.c = np.cross(w, np.cross(w, b)) @ axes.T
        self.inv_M = np.zeros((6, 6))
        self.inv_M[:3, :3] = np.eye(3) / body.m
        self.inv_M[3:, 3:] = np.linalg.inv(J)
        self.a = np.concatenate([scene.gravity, self.inv_M[3:, 3:] @ (R @ tau - np.cross(w, J @ w))])

    def K(self, points: list[int]) -> np.ndarray:
        """Eq. 10 for several points at once, (3n, 3n) 1/kg."""
        W = self.W[points].reshape(-1, 6)
        return W @ self.inv_M @ W.T

    def moved(self, points: list[int], p: np.ndarray) -> np.ndarray:
        """(6,) change of (v, w) by impulses p (n, 3), or of their rates by forces (Eq. 3)."""
        return self.inv_M @ np.einsum("nij,ni->j", self.W[points], p)

    def accelerations(self, points: list[int]) -> np.ndarray:
        """(n, 3) of the contact points without contact forces: W a + c (Eq. 5)."""
        return self.W[points] @ self.a + self.c[points]


def until(
    rate: Callable, t: float, y: np.ndarray, end: float, sign: Callable, first: float | None = None
) -> tuple[float, np.ndarray, bool]:
    """Integrate ẏ = rate(y) to `end`, or to where sign(y) becomes true: (t, y, is it true?).

    It is looked for at SAMPLES places of each step, then by halving. The step is done again up to there,
    as that is more accurate than what interpolates.
    """
    solver = DOP853(lambda t, y: rate(y), t, y, end, rtol=RTOL, atol=ATOL, first_step=first)
    while solver.status == "running":
        start = solver.y
        solver.step()
        if solver.status == "failed":
            raise Undetermined(f"no step is short enough at {solver.t:.9g} s")
        between = solver.dense_output()
        times = np.linspace(solver.t_old, solver.t, SAMPLES + 1)
        high = next((k for k in range(1, SAMPLES + 1) if sign(between(times[k]))), None)
        if high is not None:
            low, high = times[high - 1], times[high]
            while low < (middle := 0.5 * (low + high)) < high:
                low, high = (low, middle) if sign(between(middle)) else (middle, high)
            return high, until(rate, solver.t_old, start, high, lambda y: False)[1], True
    return end, solver.y, False


# ------------------------------------------------------------------------------------------- impacts


def strike(K: np.ndarray, u: np.ndarray, mu: float, e: float) -> np.ndarray:
    """The impulse (3,) of a lone point that closes with u (3,), K (3, 3): Eq. 12, over p_n.

    It ends once restitution has given back e² of the work that compression took (Stronge 1990).

    Raises:
        Undetermined: it would compress a second time, or jams.
    """
    speed = np.linalg.norm(u)
    z, taken, s = np.append(u, 0.0), 0.0, None  # velocity, and the work of p_n; direction, if slip began anew
    sticks = False
    while True:
        if not sticks and s is None and np.hypot(*z[1:3]) <= PATH_END * speed:
            z[1:3] = 0.0
            sticks, s = from_rest(K, mu)

        def rate(z, sticks=sticks, s=s):
            if sticks:
                way = np.append(1.0, -np.linalg.solve(K[1:, 1:], K[1:, 0]))
            else:
                way = np.append(1.0, -mu * (z[1:3] / np.hypot(*z[1:3]) if s is None else s))
            return np.append(K @ way, z[0])

        def sign(z, closing=z[0] < 0.0, taken=taken, slips=not sticks and s is None):
            stops = slips and np.hypot(*z[1:3]) <= PATH_END * speed
            done = z[0] >= 0.0 if closing else z[3] >= (1.0 - e * e) * taken
            return stops or done

        if z[0] < 0.0 and rate(z)[0] <= 0.0 and (sticks or s is not None):
            raise Undetermined("a point jams")
        was_closing = z[0] < 0.0
        _p_n, z, found = until(rate, 0.0, z, 1e3 * speed / K[0, 0], sign)
        if not found:
            raise Undetermined("an impact has no end")
        if was_closing and z[0] >= 0.0:
            z[0], taken = 0.0, z[3]
        over = e == 0.0 if z[0] == 0.0 and z[3] == taken else z[3] >= (1.0 - e * e) * taken
        if taken < 0.0 and z[0] < 0.0:
            raise Undetermined("an impact compresses twice")
        if taken < 0.0 and over:
            return np.linalg.solve(K, z[:3] - u)


def from_rest(K: np.ndarray, mu: float) -> tuple[bool, np.ndarray | None]:
    """(sticks, s) of a path without slip: the s along which friction lets slip grow, if it can't hold it."""
    if np.linalg.norm(np.linalg.solve(K[1:, 1:], K[1:, 0])) <= mu:
        return True, None

    def growth(angle):
        s = np.array([np.cos(angle), np.sin(angle)])
        v = K[1:, 0] - mu * K[1:, 1:] @ s
        return s, v @ s, s[0] * v[1] - s[1] * v[0]

    angles = np.linspace(-np.pi, np.pi, 361)
    for a, b in zip(angles[:-1], angles[1:], strict=True):
        if growth(a)[2] * growth(b)[2] <= 0.0:
            s, along, _across = growth(brentq(lambda angle: growth(angle)[2], a, b, xtol=1e-15))
            if along > 0.0:
                return False, s
    raise Undetermined("slip begins nowhere")


def blow(scene: Scene, y: np.ndarray, closed: list[int], path: bool) -> None:
    """The impact of closed points, one of which closes, on y in place.

    A lone point's follows Eq. 12. Points that are struck together share Newton's law, −e times what each
    closed with, friction being against the mean of its slip before and after; so does a lone one if not `path`.

    Raises:
        Undetermined: as `contacts` and `strike`; or Newton's law would gain energy.
    """
    pose = Pose(scene, y, np.zeros(3))
    K, u, mu = pose.K(closed), pose.u[closed], scene.friction
    e = scene.restitution if u[:, 0].min() < -BARELY else 0.0
    if len(closed) == 1 and path:
        p = strike(K, u[0], mu, e)[None]
    else:
        b = u + np.where(u[:, 0] < -NEAR, e * u[:, 0], 0.0)[:, None] * [1, 0, 0]
        p, _modes = contacts(K, b, 2.0 * u[:, 1:], mu, [None] * len(closed))
        if (p.ravel() @ (u.ravel() + 0.5 * K @ p.ravel())) > 1e-12 * np.abs(p).max() * np.abs(u).max():
            raise Undetermined("Newton's law gains energy here")
    y[7:] += pose.moved(closed, p)


# --------------------------------------------------------------------------------- sustained contact


def way(mode: Any, u: np.ndarray) -> Any:
    """How a point touches, given its velocity: if it slips, against which direction."""
    speed = np.hypot(*u[1:])
    return u[1:] / speed if mode is not STICKS and speed > NASCENT else mode


def forces(pose: Pose, modes: dict[int, Any], mu: float) -> tuple[np.ndarray, np.ndarray, list]:
    """The forces p (n, 3) of closed points, N; those that change nothing; and how each of them touches."""
    points = list(modes)
    now = [way(mode, pose.u[k]) for k, mode in modes.items()]
    p, idle, unique = solve(pose.K(points), pose.accelerations(points), now, mu)
    if not unique:
        raise Undetermined("friction depends on normal forces that are not unique")
    return p, idle, now


def rate(scene: Scene, y: np.ndarray, tau: np.ndarray, modes: dict[int, Any]) -> np.ndarray:
    """ẏ (13,)."""
    pose = Pose(scene, y, tau)
    a = pose.a
    if modes:
        a = a + pose.moved(list(modes), forces(pose, modes, scene.friction)[0])
    (q0, *q), w = y[3:7], y[10:]
    turn = 0.5 * np.append(-np.dot(w, q), q0 * w + np.cross(w, q))
    return np.concatenate([y[7:10], turn, a])


def happens(scene: Scene, y: np.ndarray, tau: np.ndarray, modes: dict[int, Any]) -> bool:
    """Is an open point through the surface, does a force pull or fail to hold, or has slip stopped?"""
    pose = Pose(scene, y, tau)
    for k in range(len(pose.gap)):
        if k not in modes and pose.gap[k] < 0.0 and pose.u[k, 0] < -1e-3 * NEAR:
            return True
    if not modes:
        return False
    p, idle, now = forces(pose, modes, scene.friction)
    weight = scene.body.m * np.linalg.norm(scene.gravity)
    if room(roomiest(p, idle, now, scene.friction), now, scene.friction).min() < -PULLS * weight:
        return True
    points = list(modes)
    u_dot = pose.accelerations(points) + pose.W[points] @ pose.moved(points, p)
    return any(
        mode is not STICKS and np.hypot(*pose.u[k, 1:]) < FADED and u_dot[i, 1:] @ mode < 0.0
        for i, (k, mode) in enumerate(zip(points, now, strict=True))
    )


def settle(
    scene: Scene, y: np.ndarray, tau: np.ndarray, closed: set[int], path: bool, seen: Counter
) -> dict[int, Any]:
    """Impacts of what touches, on y in place; then how each point that stays closed touches."""
    for _ in range(MAX_EVENTS):
        pose = Pose(scene, y, tau)
        touch = {k for k in range(len(pose.gap)) if k in closed or pose.gap[k] < NEAR}
        closed = {k for k in touch if pose.u[k, 0] < NEAR}
        points = sorted(closed)
        if not points:
            return {}
        if pose.u[points, 0].min() < -NEAR:
            blow(scene, y, points, path)
            seen["impacts of several" if len(points) > 1 else "impacts"] += 1
            continue
        slips = [way(None, u) if np.hypot(*u[1:]) > NEAR else None for u in pose.u[points]]
        b = pose.accelerations(points)
        _p, modes = contacts(pose.K(points), b, b[:, 1:], scene.friction, slips)
        # what is left of velocities that are none any more
        none = [mode if isinstance(mode, str) else np.zeros(2) for mode in modes]
        y[7:] += pose.moved(points, solve(pose.K(points), pose.u[points], none, 0.0)[0])
        touching = {k: mode for k, mode in zip(points, modes, strict=True) if mode is not OFF}
        seen["sticks"] += any(mode is STICKS for mode in touching.values())
        seen["slides"] += any(mode is not STICKS for mode in touching.values())
        seen["most closed"] = max(seen["most closed"], len(touching))
        return touching
    raise Undetermined("impacts follow each other without end")


def play(
    scene: Scene,
    start: State,
    duration: float,
    torque: np.ndarray | None = None,
    path: bool = True,
) -> tuple[State, Counter]:
    """The state after `duration`, and how often what happened on the way.

    Args:
        scene: over a plane.
        start: one body.
        duration: s.
        torque: (records, 3) N m, body axes, each held for its part of the duration.
        path: a lone point's impact follows Eq. 12; else it is dealt Newton's law at once.

    Raises:
        Undetermined: the motion has no one answer.
    """
    torques = np.zeros((1, 3)) if torque is None else torque
    y, seen, t = to_rows(start), Counter(), 0.0
    modes: dict[int, Any] = {}
    for n, tau in enumerate(torques, 1):
        end = n * duration / len(torques)
        modes = settle(scene, y, tau, set(modes), path, seen)
        while t < end:
            t, y, event = until(
                lambda y, tau=tau, modes=modes: rate(scene, y, tau, modes), t, y, end,
                lambda y, tau=tau, modes=modes: happens(scene, y, tau, modes),
                shortest_hop(scene, y, tau, end - t),
            )  # fmt: skip
            y[3:7] /= np.linalg.norm(y[3:7])
            if event:
                modes = settle(scene, y, tau, set(modes), path, seen)
                seen["events"] += 1
            if seen["events"] > MAX_EVENTS:
                raise Undetermined("events follow each other without end")
    return from_rows(y), seen


def shortest_hop(scene: Scene, y: np.ndarray, tau: np.ndarray, span: float) -> float | None:
    """A first step that is short enough not to pass over a hop that begins now, s; None if none does."""
    pose = Pose(scene, y, tau)
    bend = pose.accelerations(list(range(len(pose.gap))))[:, 0]
    hops = (pose.gap < NEAR) & (pose.u[:, 0] > NEAR) & (bend < 0.0)
    return min(span, 0.5 * (pose.u[hops, 0] / -bend[hops]).min()) if hops.any() else None


# ------------------------------------------------------------------------------------------- the table

COLUMNS = (
    "scene", "restart", "time_s", "x_m", "attitude_rad", "v_m_s", "w_rad_s", "other_impact_law",
    "impacts", "impacts_of_several", "slides", "sticks", "most_closed",
)  # fmt: skip


def certify(problem: Restarts, k: int) -> dict[str, Any]:
    """One restart's row: how far its answer is from this one, what happened, and how much impact laws matter.

    `other_impact_law` is how far the state after it is (m, rad, m/s, rad/s: the largest) if lone points'
    impacts follow Newton's law at once instead of Eq. 12's path; NaN where that has no one answer.
    """
    start, answer = (from_rows(to_rows(state)[k]) for state in (problem.starts, problem.answer))
    mine, seen = play(problem.scene, start, problem.duration, problem.torque)
    try:
        other = play(problem.scene, start, problem.duration, problem.torque, path=False)[0]
        law = max(differences(mine, other))
    except Undetermined:
        law = np.nan
    counts = [seen[name.replace("_", " ")] for name in COLUMNS[8:]]
    row = (problem.name, k, float(problem.times[k]), *differences(mine, answer), law, *counts)
    return dict(zip(COLUMNS, row, strict=True))


def differences(a: State, b: State) -> tuple[float, float, float, float]:
    """|Δx| m, angle rad, |Δv| m/s, |Δw| rad/s."""
    x, v, w = (float(np.linalg.norm(p - q)) for p, q in ((a.x, b.x), (a.v, b.v), (a.w, b.w)))
    return x, float(angle(a.quat, b.quat)), v, w


def main() -> None:
    """Print the table, and write it."""
    with open(RESULTS / "reference.csv", "w", newline="") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        print(*COLUMNS)
        for problem in problems():
            for k in range(len(problem.times)):
                row = certify(problem, k)
                row = {
                    name: f"{value:.3g}" if isinstance(value, float) else value for name, value in row.items()
                }
                table.writerow(row)
                print(*row.values(), flush=True)


if __name__ == "__main__":
    main()
