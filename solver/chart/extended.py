"""Reference answers for smooth motion: the equations integrated again, in extended precision.

It shares nothing with the methods that it judges but the scene: Eqs. 1, 2, 5 and 11 in world axes, one
point in the air or sliding on a level plane, by an extrapolated midpoint rule with a fixed step in long
doubles (64 bits of mantissa on x86; where they are doubles, the answers lose their last digits).

`python -m solver.chart.extended` writes the answers that `solver.chart.problems` reads. The tippe top slips
and rolls in turn, so its answer is "exact"'s: the same to 1e-11 at a hundred times the tolerance, and to
2e-5 rad by `solver.chart.reference`, which follows the first moments of slip less closely.
"""

import json
from pathlib import Path

import numpy as np

from solver.model import TOUCH
from solver.scene import Scene, State
from solver.simulate import simulate

ANSWERS = Path(__file__).parent / "answers.json"
Long = np.longdouble
ORDERS = 8


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of two quaternions."""
    return np.concatenate([[a[0] * b[0] - a[1:] @ b[1:]], a[0] * b[1:] + b[0] * a[1:] + cross(a[1:], b[1:])])


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a × b; numpy's own is five times slower on single vectors."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def rotation(quat: np.ndarray) -> np.ndarray:
    """(3, 3): world = R body."""
    w, u = quat[0], quat[1:]
    skew = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]], dtype=Long)
    return np.eye(3, dtype=Long) + 2 * w * skew + 2 * skew @ skew


def motion(scene: Scene, touches: bool):
    """The right-hand side y' = F(y), y = (x, quat, v, w) in world axes, of a body with J principal."""
    # restricted to a level ground and the first hull point: all that the smooth problems need
    m, J = Long(scene.body.m), np.diag(scene.body.J).astype(Long)
    b_b, rho = scene.body.hull[0].astype(Long), Long(scene.body.radius[0])
    g, mu = scene.gravity.astype(Long), Long(scene.friction)
    N = np.array([0, 0, 1], dtype=Long)

    def F(y):
        quat, v, w = y[3:7] / np.sqrt(y[3:7] @ y[3:7]), y[7:10], y[10:13]
        R = rotation(quat)

        def inv_J(a):
            return R @ ((a @ R) / J)

        w_dot = -inv_J(cross(w, R @ (J * (w @ R))))
        a = g
        if touches:
            b = R @ b_b
            q = b - rho * N
            push = N
            if mu > 0:
                slip = v + cross(w, q)
                slip = slip - (slip @ N) * N
                push = N - mu * slip / np.sqrt(slip @ slip)
            l = N @ (a + cross(w_dot, q) + cross(w, cross(w, b)))
            G = N @ (push / m + cross(inv_J(cross(q, push)), q))
            f = -l / G
            if f < 0:
                raise ArithmeticError("the point lifts off: not smooth motion")
            a = a + f * push / m
            w_dot = w_dot + f * inv_J(cross(q, push))
        spin = np.concatenate([[Long(0)], w])
        return np.concatenate([v, product(spin, quat) / 2, a, w_dot])

    return F


def integrate(F, y: np.ndarray, duration: float, steps: int) -> np.ndarray:
    """The midpoint rule with 2, 4, ... 16 pieces a step, extrapolated to order 16 (Gragg 1965).

    Its coefficients are whole numbers: tabulated ones, rounded to doubles, would cost the spin near its
    separatrix five digits.
    """
    H = Long(duration) / steps
    pieces = range(2, 2 * ORDERS + 1, 2)
    for _ in range(steps):
        first = F(y)
        table: list[np.ndarray] = []
        for j, n in enumerate(pieces):
            h = H / n
            before, here = y, y + h * first
            for _piece in range(n - 1):
                before, here = here, before + 2 * h * F(here)
            row = [here]
            for k in range(1, j + 1):
                ratio = Long(n) / pieces[j - k]
                row.append(row[-1] + (row[-1] - table[k - 1]) / (ratio * ratio - 1))
            table = row
        y = table[-1]
        y[3:7] /= np.sqrt(y[3:7] @ y[3:7])
    return y


def answer(scene: Scene, starts: State, duration: float, steps: int) -> np.ndarray:
    """(13,) x, quat, v, w at the end, from a batch of one start that touches or flies."""
    y = np.concatenate([starts.x[0], starts.quat[0], starts.v[0], starts.w[0]]).astype(Long)
    touches = scene.gap(starts).min() < TOUCH
    return integrate(motion(scene, touches), y, duration, steps)


def main() -> None:
    """Write the answers, and print how far half the steps were off."""
    from .problems import SMOOTH, TIPPE

    answers = {}
    for name, (scene, start, duration, steps) in SMOOTH.items():
        coarse = answer(scene, start, duration, steps // 2)
        fine = answer(scene, start, duration, steps)
        print(f"{name:8} half the steps: {float(np.abs(fine - coarse).max()):.1e}", flush=True)
        answers[name] = [float(value) for value in fine]
    scene, starts, duration = TIPPE
    start = State(starts.x[0], starts.quat[0], starts.v[0], starts.w[0])
    end = simulate(scene, start, duration, dt=duration, method="exact", options={"tol": 1e-14}).state
    answers["tippe"] = [*end.x, *end.quat, *end.v, *end.w]
    ANSWERS.write_text(json.dumps(answers, indent=1) + "\n")


if __name__ == "__main__":
    main()
