"""Methods that only exist to fail: each as one would first write it, with the limit at which it does.

Slow and obvious. The letters are the article's (see `solver.contact`); vectors are in world axes unless
a name ends in `_b`, and a plane's normal is z where a function takes no scene.
"""

import numpy as np

from solver.rotation import from_vector, product, to_matrix
from solver.scene import Scene, State

# ---------------------------------------------------------------- the body, as it is without any contact


def fly(state: State, v: np.ndarray, w: np.ndarray, h: float) -> State:
    """Move by the velocities given, which the state then has: the second half of semi-implicit Euler."""
    return State(state.x + h * v, product(from_vector(h * w), state.quat), v, w)


class Rows:
    """Eqs. 1-6 of a body on its plane at some of its hull points, in world axes.

    Args:
        scene: body, plane and gravity.
        state: one body.
        points: indices of the hull points.

    Attributes:
        W: (n, 6) rows [Nᵀ, (q × N)ᵀ].
        inv_M: (6, 6).
        a: (6,) acceleration without contact, gravity and −J⁻¹(w × J w).
        l: (n,) m/s²; with Eq. 5's c.
        v: (n,) m/s.
        G: (n,) 1/kg.
    """

    def __init__(self, scene: Scene, state: State, points: list[int] | range):
        body, N, w = scene.body, scene.surface.parameters[:3], state.w
        R = to_matrix(state.quat)
        inv_J = R @ np.linalg.inv(body.J) @ R.T
        b = body.hull[list(points)] @ R.T
        q = b - body.radius[list(points), None] * N
        self.W = np.hstack([np.tile(N, (len(q), 1)), np.cross(q, N)])
        self.inv_M = np.block([[np.eye(3) / body.m, np.zeros((3, 3))], [np.zeros((3, 3)), inv_J]])
        L = R @ body.J @ R.T @ w
        self.a = np.concatenate([scene.gravity, -inv_J @ np.cross(w, L)])
        self.l = self.W @ self.a + np.cross(w, np.cross(w, b)) @ N
        self.v = self.W @ np.concatenate([state.v, w])
        self.G = np.einsum("ni,ij,nj->n", self.W, self.inv_M, self.W)

    def velocities(self, state: State, h: float, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(v, w) after h seconds under the forces f (n,), by Euler's step."""
        a = self.a + self.inv_M @ (f @ self.W)
        return state.v + h * a[:3], state.w + h * a[3:]

    def struck(self, state: State, i: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(v, w) after the impulses i (n,)."""
        jump = self.inv_M @ (i @ self.W)
        return state.v + jump[:3], state.w + jump[3:]


# ------------------------------------------------------------------------------------------- free spin


def explicit_spin(J: np.ndarray, w_b: np.ndarray, h: float) -> np.ndarray:
    """Explicit Euler for J ẇ = −w × J w, body axes, J principal (3,).

    A symmetric top's transverse energy grows by 1 + (Ωh)² a step, Ω = (J₃ − J₁) w₃/J₁.
    """
    return w_b - h * np.cross(w_b, J * w_b) / J


def implicit_spin(J: np.ndarray, w_b: np.ndarray, h: float) -> np.ndarray:
    """Implicit Euler for the same: one Newton step on J(w′ − w) + h w′ × J w′ = 0 from w.

    A symmetric top's transverse energy shrinks by 1/(1 + (Ωh)²) a step; the spin of 10 rad/s about the
    middle axis of J = (1, 2, 2.5)e-3 loses 78 % of its energy in a minute at 60 Hz.
    """

    def hat(a):
        return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])

    slope = np.diag(J) + h * (hat(w_b) @ np.diag(J) - hat(J * w_b))
    return w_b - np.linalg.solve(slope, h * np.cross(w_b, J * w_b))


def fixed_length_spin(J: np.ndarray, L_b: np.ndarray, h: float) -> np.ndarray:
    """Keep L in the world and turn the body by h w, w = J⁻¹L: in body axes L turns the other way.

    |L| is exact, the energy is not: it grows by ½h² (L × w)·J⁻¹(L × w) a step, until the body spins
    about its axis of least inertia, E = |L|²/(2 J_min), whatever axis it started on. A top that spins
    about its axis of greatest inertia tips off it: sin²θ grows by 1 + (w₃h)² J₃(J₃ − J₁)/J₁² a step.
    """
    R = to_matrix(from_vector(h * L_b / J))
    return R.T @ L_b


def euler_quat(quat: np.ndarray, w: np.ndarray, h: float) -> np.ndarray:
    """quat + ½h (0, w) ⊗ quat, not normalised: the norm grows by √(1 + (|w|h/2)²) a step."""
    return quat + 0.5 * h * product(np.concatenate([[0.0], w]), quat)


# ------------------------------------------------------------------------------ one contact: the drift


def unstabilised(scene: Scene, state: State, h: float) -> State:
    """Hold hull point 0 by Eq. 6 alone, f = −l/G: its acceleration is right, its place nobody's business.

    The gap drifts linearly at once: of a top in steady precession (turning with Ω about the vertical and
    with s about its own axis, tilted by θ, the point l below the centre) at ½ l h Ω s sin²θ m/s. The
    error of the velocity grows too, and with it the gap quadratically.
    """
    rows = Rows(scene, state, [0])
    return fly(state, *rows.velocities(state, h, -rows.l / rows.G), h)


def eq8_every_frame(scene: Scene, state: State, closed: list[int], h: float) -> State:
    """Stop the closed points by Eq. 8 with e = 0, one after another, every frame.

    No bounce is left, whatever e; a ball stays as deep as the step left it that found it. And the gap
    drifts still, by ½h²N·(w × (w × q)) a step: velocities alone know nothing of the place.
    """
    rows = Rows(scene, state, closed)
    state = State(state.x, state.quat, *rows.velocities(state, h, np.zeros(len(closed))))
    for k in closed:
        rows = Rows(scene, state, [k])
        state = State(state.x, state.quat, *rows.struck(state, -rows.v / rows.G))
    return fly(state, state.v, state.w, h)


def baumgarte_velocity(G: float, phi: float, v: float, beta: float, h: float) -> float:
    """The impulse that leaves the velocity −β φ/h along the normal, N s.

    Then φ′ = (1 − β) φ: stable for 0 < β < 2, ringing above 1. A body that overlaps by φ at rest leaves
    with the kinetic energy ½(β φ/h)²/G.
    """
    return -(v + beta * phi / h) / G


def spring_damper(
    phi: float, v: float, alpha: float, beta: float, h: float, explicit: bool = False
) -> tuple[float, float]:
    """A step of Eq. 9's contact, φ̈ = −2α φ̇ − β² φ. Returns (φ, v).

    Stable if βh < 2√(1 − αh), semi-implicit; if β²h < 2α and 4αh < 4 + β²h², explicit.
    """
    v_next = v - h * (2 * alpha * v + beta**2 * phi)
    return phi + h * (v if explicit else v_next), v_next


# ------------------------------------------------------------------------------------- several contacts


def all_at_once(scene: Scene, state: State, points: list[int]) -> State:
    """Eq. 8 (e = 0) at each point as if it were alone, all added (Jacobi).

    n points in one place below the centre: v′ = (1 − n) v. The four corners of an a × b × c box (c up):
    v′ = −e v with a false e = 4/(mG) − 1, mG = 1 + 3b²/(b² + c²) + 3a²/(a² + c²).
    """
    rows = Rows(scene, state, points)
    return State(state.x, state.quat, *rows.struck(state, np.maximum(0.0, -rows.v / rows.G)))


def one_at_a_time(A: np.ndarray, l: np.ndarray) -> np.ndarray:
    """Solve A f = −l for all points; while a force pulls, switch the worst off and solve again."""
    f = np.zeros(len(l))
    on = list(range(len(l)))
    while on:
        f[:] = 0.0
        f[on] = np.linalg.lstsq(A[np.ix_(on, on)], -l[on], rcond=1e-9)[0]
        if f.min() >= 0.0:
            break
        on.remove(int(f.argmin()))
    return f


def switching(scene: Scene, state: State, h: float) -> tuple[State, np.ndarray]:
    """A step with the forces of `one_at_a_time` at the points at or below the surface: (state, f (p,)).

    The deepest point is then lifted onto the surface, which takes the others off it: the next frame
    finds one end of a box's edge there, the one after it the other, and each carries all the load.
    """
    closed = [k for k, gap in enumerate(scene.gap(state)) if gap <= 0.0]
    rows = Rows(scene, state, closed)
    f = np.zeros(len(scene.body.hull))
    if closed:
        f[closed] = one_at_a_time(rows.W @ rows.inv_M @ rows.W.T, rows.l + rows.v / h)
    state = fly(state, *rows.velocities(state, h, f[closed]), h)
    lift = max(0.0, -scene.gap(state).min())
    return State(state.x + lift * scene.surface.parameters[:3], state.quat, state.v, state.w), f


# --------------------------------------------------------------------------------- friction and impact


def effective(m: float, inv_J: np.ndarray, q: np.ndarray) -> np.ndarray:
    """K = I/m − [q]× J⁻¹ [q]× (Eq. 10), (3, 3) 1/kg; inv_J (3, 3) in world axes."""
    hat = np.array([[0, -q[2], q[1]], [q[2], 0, -q[0]], [-q[1], q[0], 0]])
    return np.eye(3) / m - hat @ inv_J @ hat


def scalar_friction(K: np.ndarray, u: np.ndarray, mu: float, e: float = 0.0) -> np.ndarray:
    """Normal and two tangents as three separate scalars: p (3,), each from its own diagonal of K.

    Off the diagonal K is forgotten, and so is that one tangent's slip is the other's: friction is up to
    √2 μ p_n, under 45° at any slip. A block thrown at the angle ψ to x stops on the bearing atan(tan²ψ).
    On a 45° rod an impact gains up to 120 % of the contact's kinetic energy ½u·K⁻¹u.
    """
    p_n = max(0.0, -(1 + e) * u[2] / K[2, 2])
    p_t = np.clip(-u[:2] / np.diag(K)[:2], -mu * p_n, mu * p_n)
    return np.array([*p_t, p_n])


def newton_impulse(K: np.ndarray, u: np.ndarray, mu: float, e: float) -> np.ndarray:
    """Newton's e with Coulomb's friction in the x-z plane: sticks if the cone allows, else slides. p (3,).

    Friction is against the slip that is left. Gains up to 9/16 of the contact's kinetic energy ½u·K⁻¹u
    on a 45° rod (μ below Painlevé's limit).
    """
    p = -np.linalg.solve(K, u + np.array([0, 0, e * u[2]]))
    if abs(p[0]) <= mu * p[2]:
        return p
    for s in (1.0, -1.0):
        direction = np.array([-mu * s, 0.0, 1.0])
        p = -(1 + e) * u[2] / (K[2] @ direction) * direction
        if s * (u + K @ p)[0] >= 0.0:
            break
    return p


def regularised_friction(u: np.ndarray, f: float, mu: float, v_s: float) -> np.ndarray:
    """−μ f u/max(|u|, v_s), N: viscous below the slip v_s (m/s), so that nothing ever sticks.

    On a slope with tanθ < μ it creeps at v_s tanθ/μ, for ever; stable if μ g cosθ h < 2 v_s.
    """
    return -mu * f * u / max(float(np.linalg.norm(u)), v_s)


def sliding_force(K: np.ndarray, l: float, mu: float, s: np.ndarray) -> float:
    """f = −l/(N·K(N − μ s)) (Eq. 11), N; s (3,) is the direction of slip.

    Painlevé: of a rod's lower end, θ above the horizontal, the denominator is
    (1/m)[1 + 3cosθ(cosθ − μ sinθ)], so f grows without bound towards μ = (tan²θ + 4)/(3 tanθ) and pulls
    beyond it.
    """
    return -l / (K[2] @ (np.array([0, 0, 1.0]) - mu * s))


# ---------------------------------------------------------------------------------------------- bounces


def newton_every_step(x: float, v: float, h: float, e: float, g: float) -> tuple[float, float]:
    """A point of height x: v′ = −e v in every step that finds it at or below the ground and closing.

    With e = 1 each bounce leaves g h faster than the last, so E/m grows by ½ g² h a second. With e < 1 it
    never rests but bounces for ever with e g h/(1 − e).
    """
    v -= g * h
    if x <= 0.0 and v < 0.0:
        v = -e * v
    return x + h * v, v


def popped_out(x: float, v: float, h: float, g: float) -> tuple[float, float]:
    """e = 1 by exact flight; found below the ground, it is put on it and its velocity turned round.

    Each bounce gains g d per mass by being lifted out of its depth d; that is half of v h on average, so
    E/m grows by ¼ g² h a second, whatever the height.
    """
    x, v = x + h * v - 0.5 * g * h * h, v - g * h
    return (0.0, -v) if x < 0.0 else (x, v)


def at_step_ends(scene: Scene, state: State, h: float) -> State:
    """Fly for h, then Eq. 8 at the points below the surface and closing: what dips between is not seen.

    A point that goes round the centre with w at a distance l may pass l(1 − cos(wh/2)) below the surface,
    and come back, within one step.
    """
    state = fly(state, state.v + h * scene.gravity, state.w, h)
    below = [k for k, gap in enumerate(scene.gap(state)) if gap < 0.0]
    rows = Rows(scene, state, below)
    i = np.maximum(0.0, -(1 + scene.restitution) * rows.v / rows.G)
    return State(state.x, state.quat, *rows.struck(state, i))
