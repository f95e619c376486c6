"""An independent answer: Eqs. 1-12 in world axes, from event to event, integrated by SciPy's DOP853.

    play     settle how points touch, go on to the first sign of an event, and again
    settle   impacts; then which closed points push, stick and slide
    blow     a lone point's impact along its path (`path`); several points' all at once, by Newton's law
             (`coulomb`)

It shares scenes and states with the solver, and no line of mechanics. It knows planes only.

`flipcar chart reference` plays every restart of `restarts.problems`, and says how far the answers that are
stored with them are from its own.
"""

from collections import Counter
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from solver.rotation import angle
from solver.scene import Scene, State

from .coulomb import OFF, SLIDES, STICKS, Undetermined, contacts, room, roomiest, solve
from .path import strike, until
from .restarts import Restarts, from_rows, to_rows

NEAR = 1e-9
"""m, m/s: points this near the surface touch it; slower ones neither close nor slip."""

LEAVES = 1e-12
"""m/s: a point at the surface that comes down slower is one that leaves, to rounding."""

FADED = 1e-10
"""m/s: slip that has become so slow has stopped; what is left of it is taken away."""

BEGUN = 1e-7
"""m/s: until slip is so fast, it keeps the direction in which it began. That is what the answer may be off
by at most; a tenth of it takes three times as long, as slip that begins is stiff."""

BARELY = 1e-7
"""m/s: a point that comes down slower does not bounce."""

PULLS = 1e-9
"""Of the weight: by so much a force must pull, or friction hold too much, to end a stretch."""

MAX_EVENTS = 500


def hat(a: np.ndarray) -> np.ndarray:
    """The matrix [a]×: [a]× b = a × b, and b [a]× = b × a."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


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
        body, axes = scene.body, scene.surface.parameters[:9].reshape(3, 3)
        N, w = axes[0], hat(y[10:])
        R = Rotation.from_quat(y[3:7], scalar_first=True).as_matrix()
        J = R @ body.J @ R.T
        inv_J = np.linalg.inv(J)
        b = body.hull @ R.T
        q = b - body.radius[:, None] * N
        self.gap = (y[:3] + b) @ N - scene.surface.parameters[9] - body.radius
        self.W = np.empty((len(b), 3, 6))
        for j, d in enumerate(axes):
            self.W[:, j, :3], self.W[:, j, 3:] = d, q @ hat(d)
        self.u = self.W @ y[7:]
        self.c = b @ (w @ w) @ axes.T
        self.inv_M = np.zeros((6, 6))
        self.inv_M[:3, :3], self.inv_M[3:, 3:] = np.eye(3) / body.m, inv_J
        self.a = np.concatenate([scene.gravity, inv_J @ (R @ tau - w @ J @ y[10:])])

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


def blow(scene: Scene, y: np.ndarray, closed: list[int], path: bool) -> None:
    """The impact of closed points, one of which closes, on y in place.

    A lone point's follows Eq. 12. Points that are struck together share Newton's law, −e times what each
    closed with, with friction against the mean of its slip before and after; so does a lone one, if not
    `path`.

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


# How closed points touch is a dict, from the hull point to STICKS, SLIDES, or the direction (2,) in which its
# slip is about to begin.


def way(mode: Any, u: np.ndarray) -> Any:
    """STICKS, or the direction against which friction acts."""
    return u[1:] / np.hypot(*u[1:]) if mode is SLIDES else mode


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
    q, w = y[3:7], y[10:]
    turn = 0.5 * np.append(-w @ q[1:], q[0] * w + hat(w) @ q[1:])
    return np.concatenate([y[7:10], turn, a])


def happens(scene: Scene, y: np.ndarray, tau: np.ndarray, modes: dict[int, Any]) -> str:
    """What ends a stretch of smooth motion; "" while nothing does."""
    pose, mu = Pose(scene, y, tau), scene.friction
    for k in range(len(pose.gap)):
        if k not in modes and pose.gap[k] < 0.0 and pose.u[k, 0] < -LEAVES:
            return "a point comes down"
    if not modes:
        return ""
    p, idle, now = forces(pose, modes, mu)
    weight = scene.body.m * np.linalg.norm(scene.gravity)
    if room(roomiest(p, idle, now, mu), now, mu).min() < -PULLS * weight:
        return "a force would pull, or friction does not hold"
    for k, mode in modes.items():
        slip = pose.u[k, 1:]
        if mode is SLIDES and np.hypot(*slip) < FADED:
            return "slip stops"
        if not isinstance(mode, str) and not -LEAVES < slip @ mode < BEGUN:
            return "slip has begun, or has not"
    return ""


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
        slips = [way(SLIDES, u) if np.hypot(*u[1:]) > NEAR else None for u in pose.u[points]]
        b = pose.accelerations(points)
        _p, modes = contacts(pose.K(points), b, b[:, 1:], scene.friction, slips)
        # what is left of velocities that are none any more
        gone = [mode if isinstance(mode, str) else np.zeros(2) for mode in modes]
        y[7:] += pose.moved(points, solve(pose.K(points), pose.u[points], gone, 0.0)[0])
        ways = [
            mode if slip is None or mode is OFF else SLIDES for mode, slip in zip(modes, slips, strict=True)
        ]
        touching = {k: mode for k, mode in zip(points, ways, strict=True) if mode is not OFF}
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
    seen: Counter[str] = Counter()
    y, t = to_rows(start), 0.0
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
    law = 0.0
    if seen["impacts"]:
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
