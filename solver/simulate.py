"""Run a scene from a state for a while, by a method."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from . import acceleration, baumgarte, impulse
from .errors import SolverError, finite, number, one_of
from .exact import run as exact
from .lanes import run_many
from .model import CROWDED, MEMORY, NOT_FINITE, PAINLEVE, STUCK, TOUCH
from .scene import DEEPEST_START, Scene, State, from_kernel, to_kernel, to_principal

METHODS = {
    "acceleration": "the article as written: contact forces (Eq. 7) each step, an impulse (Eq. 8) on "
    "collision; each touching point by itself, so several points push too hard and none sticks",
    "baumgarte": "the article's spring and damper against drift (Eq. 9); each touching point by itself, "
    "the step short against the spring, and an overlap throws the body out",
    "impulse": "time stepping with impulses, second order: the single contact solve swept over the "
    "closed contacts, friction and restitution",
    "exact": "event driven: closed-form flight, certified time of impact, energetic frictional impact, "
    "sustained contact of high order with located transitions; dt is the recording interval",
}
"""Name of each method: what it is."""

KERNELS = {
    "acceleration": acceleration.run,
    "baumgarte": baumgarte.run,
    "impulse": impulse.run,
    "exact": exact.run,
}
_OPTIONS: dict[str, dict[str, bool | float]] = {
    "acceleration": {"every_frame": False},
    "baumgarte": {"alpha": baumgarte.ALPHA, "beta": baumgarte.BETA},
    "impulse": {},
    "exact": {"tol": exact.TOL},
}
_LIMITS = {"tol": {"above": 0.0}}
EXTRA = {"exact": exact.EXTRA}
_REASONS = {
    NOT_FINITE: "the state is no longer finite; a smaller dt may help",
    CROWDED: "over a height field 'exact' serves one touching point at a time; 'impulse' takes several",
    STUCK: "events follow one another without end; another method may pass them",
    PAINLEVE: "Painlevé's paradox: no contact force satisfies Eq. 11; a method with impulses resolves it",
}
FEW = 4
"""So many bodies, or fewer, run one by one: lanes pay from there on."""

MAX_LIFTS = 60
WHOLE_STEP = 1e-6
"""duration/dt this close to a whole number counts as one."""


@dataclass(frozen=True)
class Run:
    """What `simulate` recorded; a batch has its n after T.

    Attributes:
        t: (T,) s.
        x: (T, [n,] 3) m.
        quat: (T, [n,] 4).
        v: (T, [n,] 3) m/s.
        w: (T, [n,] 3) rad/s, world axes.
        energy: (T, [n]) J.
        f: (T, [n,] p) normal force of each hull point, N: with "impulse" the mean since the record
            before (0 at the start), with the others the force at the record.
        state: the last state.
    """

    t: np.ndarray
    x: np.ndarray
    quat: np.ndarray
    v: np.ndarray
    w: np.ndarray
    energy: np.ndarray
    f: np.ndarray
    state: State


def simulate(
    scene: Scene,
    state: State,
    duration: float,
    dt: float = 1 / 240,
    method: str = "impulse",
    force: object = None,
    torque: object = None,
    record_every: int = 1,
    options: dict | None = None,
    threads: int = 1,
) -> Run:
    """Run the scene from a state.

    It takes duration/dt steps, rounded when within 1e-6 of a whole number; otherwise the last step is
    shorter. The record's row 0 is the state given, before any impulse; then the end of every
    `record_every`-th step. A start that overlaps the ground a little is first lifted out of it.

    Args:
        scene: body, surface, gravity, contact law.
        state: where it starts. A batch runs body by body, or with "impulse" over a plane eight at once:
            either way each body's bits are those it has alone.
        duration: s.
        dt: step, s.
        method: one of `METHODS`.
        force: (3,) N in world axes, or a callable of t, read at the records and held between them.
        torque: the same in body axes, N m.
        record_every: steps between records.
        options: of the method; "acceleration" takes every_frame=True (Eq. 8 each step), "baumgarte"
            alpha and beta (1/s).
        threads: how many work on a batch; the result's bits do not depend on it.

    Returns:
        The record, and the last state.

    Raises:
        ValueError: an argument is not what it must be, or the start is deep in the ground.
        SolverError: the run can't go on; it carries time, state, reason and the body's index.
    """
    if not isinstance(scene, Scene):
        raise ValueError(f"scene must be a Scene, got {scene!r}")
    if not isinstance(state, State):
        raise ValueError(f"state must be a State, got {state!r}")
    duration = number("duration", duration, low=0.0)
    dt = number("dt", dt, above=0.0)
    one_of("method", method, METHODS)
    if method != "impulse" and scene.blow_friction != scene.friction:
        raise ValueError(f"method must be 'impulse' for a scene with a blow_friction, got {method!r}")
    if not isinstance(record_every, int | np.integer) or record_every < 1:
        raise ValueError(f"record_every must be a whole number >= 1, got {record_every!r}")
    if not isinstance(threads, int | np.integer) or threads < 1:
        raise ValueError(f"threads must be a whole number >= 1, got {threads!r}")
    flags = option_values(method, options)
    force_at = _schedule("force", force)
    torque_at = _schedule("torque", torque)
    _refuse_deep(scene, state, exactly=method == "exact")

    steps = duration / dt
    whole = round(steps) if abs(steps - round(steps)) <= WHOLE_STEP else int(steps)
    short = duration - whole * dt if steps - whole > WHOLE_STEP else 0.0
    total = whole + (short > 0.0)
    starts = range(0, total, record_every)

    body, points = scene.body, len(scene.body.hull)
    rows = to_kernel(body, state)
    memory = np.zeros((len(rows), points + EXTRA.get(method, 0), MEMORY))
    times = [0.0]
    history = [rows.copy()]
    forces = [np.zeros((len(rows), points))]
    _lift(scene, state, rows)

    def run_all(n, h, t, f):
        a = scene.gravity + force_at(times[-1]) / body.m
        tau = to_principal(body, torque_at(times[-1]))

        def share(first):
            for j in range(first, len(rows), threads):
                flag = kernel(*what, a, tau, rows[j], memory[j], f[j], flags, h, n)
                if flag:
                    return j, flag
            return len(rows), 0

        def share_lanes(first):
            cut = cuts[first], cuts[first + 1]
            part = rows[slice(*cut)], memory[slice(*cut)], f[slice(*cut)]
            j = run_many(*what[:2], what[2][0], full, a, tau, *part, h, n)
            return (cut[0] + j, NOT_FINITE) if j >= 0 else (len(rows), 0)

        # the failed body of lowest index, whoever had it
        one = share_lanes if in_lanes else share
        j, flag = min(pool.map(one, range(threads)) if threads > 1 else [one(0)])
        if flag:
            index = j if state.x.ndim == 2 else None
            raise SolverError(_REASONS[flag], t, from_kernel(body, rows[j]), index)

    kernel = KERNELS[method]
    what = kernel_arguments(scene, method)
    in_lanes = method == "impulse" and len(rows) > FEW and points > 1 and scene.surface.field is None
    full = np.array([scene.friction, scene.restitution, scene.blow_friction])
    cuts = np.linspace(0, len(rows), threads + 1).astype(int)
    with ThreadPoolExecutor(threads) as pool:  # it starts no thread before it has work
        run_all(0, dt, 0.0, forces[0])
        for start in starts:
            stop = min(start + record_every, total)
            f = np.zeros_like(forces[0])
            run_all(min(stop, whole) - start, dt, start * dt, f)
            if stop > whole:
                run_all(1, short, whole * dt, f)
            if stop - start == record_every:
                times.append(duration if stop > whole else stop * dt)
                history.append(rows.copy())
                forces.append(f)

    batch = state.x.shape[:-1]
    past = from_kernel(body, np.concatenate(history))
    shape = (len(times), *batch)
    run = Run(
        t=np.array(times),
        x=past.x.reshape(*shape, 3),
        quat=past.quat.reshape(*shape, 4),
        v=past.v.reshape(*shape, 3),
        w=past.w.reshape(*shape, 3),
        energy=np.reshape(scene.energy(past), shape),
        f=np.reshape(forces, (*shape, points)),
        state=from_kernel(body, rows if batch else rows[0]),
    )
    for name in ("x", "quat", "v", "w"):  # row 0 is the state given, to the bit
        getattr(run, name)[0] = getattr(state, name)
    return run


def kernel_arguments(scene: Scene, method: str) -> tuple:
    """The scene as the first arguments of a method's kernel."""
    # the other methods, which are there to be compared, leave nothing out
    return (*scene.parameters[:3], scene.law) if method == "impulse" else scene.parameters


def _schedule(name: str, value: object) -> Callable[[float], np.ndarray]:
    """A function of t, checked, from a callable, a constant or None."""
    if callable(value):
        return lambda t: finite(f"{name}({t:g})", value(t), (3,))
    constant = finite(name, (0, 0, 0) if value is None else value, (3,))
    return lambda t: constant


def option_values(method: str, options: dict | None) -> np.ndarray:
    """The method's options as its kernel takes them."""
    known = _OPTIONS[method]
    for name, value in (options or {}).items():
        if name not in known:
            allowed = ", ".join(map(repr, known)) or "none"
            raise ValueError(f"options of {method!r} are {allowed}; got {name!r}")
        if not isinstance(known[name], bool):
            number(f"options[{name!r}]", value, **_LIMITS.get(name, {"low": 0.0}))
        elif not isinstance(value, bool):
            raise ValueError(f"options[{name!r}] must be True or False, got {value!r}")
    return np.array([*({**known, **(options or {})}).values(), 0.0], dtype=np.float64)


def _lift(scene: Scene, state: State, rows: np.ndarray) -> None:
    """Raise the rows that overlap the ground. Over a height field a lift leaves at most half the depth."""
    for _ in range(MAX_LIFTS):
        x = rows[:, :3].reshape(state.x.shape)
        depth = scene.gap(State(x, state.quat, state.v, state.w)).min(axis=-1).reshape(-1, 1)
        if (depth >= -TOUCH).all():
            break
        rows[:, :3] -= np.where(depth < -TOUCH, depth, 0.0) * scene.surface.parameters[:3]


def _refuse_deep(scene: Scene, state: State, exactly: bool) -> None:
    """A start too deep in the ground; "exact" takes none that is below it at all."""
    limit = -TOUCH if exactly else -DEEPEST_START * scene.body.bounding_radius
    allowed = "" if exactly else f" ({DEEPEST_START:.0%} of the hull's bounding radius)"
    deepest = scene.gap(state).min()
    if deepest < limit:
        raise ValueError(
            f"state is {-deepest:.4g} m deep in the ground; at most {-limit:.4g} m is allowed{allowed}"
        )
