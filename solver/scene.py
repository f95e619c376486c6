"""A scene: one body, one surface, gravity and the contact law; and the state of the body."""

from dataclasses import dataclass, fields

import numpy as np

from . import acceleration, terms
from .body import Body
from .errors import finite, number
from .rotation import from_matrix, product, to_matrix
from .surface import HeightField, Plane

UNIT_TOLERANCE = 1e-6
"""How far a quaternion's norm may be from 1; it is then normalised."""

DEEPEST_START = 0.05
"""Of the hull's bounding radius: a start deeper in the ground is refused."""

ROUNDEST = 0.8
"""Of the least radius of curvature of a height field's hollows: a hull radius beyond is refused. One that
just fits a hollow touches it everywhere at once."""


@dataclass(frozen=True)
class State:
    """Where the body is and how it moves: one body, or n with a leading axis.

    Args:
        x: (3,) or (n, 3) centre of mass, world, m.
        quat: (4,) or (n, 4) unit quaternion w, x, y, z, body to world.
        v: (3,) or (n, 3) velocity of the centre of mass, world, m/s.
        w: (3,) or (n, 3) angular velocity, world axes, rad/s.

    Raises:
        ValueError: wrong or differing shapes, not finite, quaternion not of unit length.
    """

    x: np.ndarray
    quat: np.ndarray
    v: np.ndarray
    w: np.ndarray

    def __post_init__(self):
        batch = np.shape(self.x)[:-1]
        if len(batch) > 1 or 0 in batch:
            raise ValueError(f"x must have shape (3,) or (n, 3), got {np.shape(self.x)}")
        for field in fields(self):
            size = 4 if field.name == "quat" else 3
            array = finite(field.name, getattr(self, field.name), (*batch, size))
            object.__setattr__(self, field.name, array)
        norm = np.linalg.norm(self.quat, axis=-1, keepdims=True)
        if (np.abs(norm - 1.0) > UNIT_TOLERANCE).any():
            worst = norm.ravel()[np.abs(norm - 1.0).argmax()]
            raise ValueError(f"quat must have norm 1 within {UNIT_TOLERANCE:g}, got {worst:.9g}")
        # One that is a unit already to rounding keeps its bits, so a run can be cut and resumed.
        exact = np.abs(norm - 1.0) < 4e-16
        object.__setattr__(self, "quat", np.where(exact, self.quat, self.quat / norm))


def to_principal(body: Body, vector: np.ndarray) -> np.ndarray:
    """A vector (..., 3) from the body's axes to its principal ones."""
    return np.ascontiguousarray(vector @ body.principal_axes)


def to_kernel(body: Body, state: State) -> np.ndarray:
    """The state as the kernels' rows (n, 13): x, quat, v in world and w in principal axes."""
    quat = product(state.quat, from_matrix(body.principal_axes))
    w = np.einsum("...ji,...j->...i", to_matrix(quat), state.w)
    return np.ascontiguousarray(np.concatenate([state.x, quat, state.v, w], -1).reshape(-1, 13))


def from_kernel(body: Body, rows: np.ndarray) -> State:
    """The inverse of `to_kernel`; the leading shape is the rows'."""
    x, quat, v, w = np.split(rows, [3, 7, 10], -1)
    w = np.einsum("...ij,...j->...i", to_matrix(quat), w)
    back = from_matrix(body.principal_axes) * [1, -1, -1, -1]
    return State(x, product(quat, back), v, w)


@dataclass(frozen=True)
class Contact:
    """The article's quantities at every hull point. All arrays (..., p).

    Attributes:
        gap: φ, m (Eq. 4).
        v: velocity along the normal, negative when closing, m/s.
        G: acceleration along the normal per unit of force, 1/kg (Eq. 6).
        l: acceleration along the normal without contact force, m/s² (Eq. 6).
        f: −l/G or 0, N (Eq. 7): what a point that touches at v = 0 would feel, alone.
        i: −(1 + e) v/G or 0, N s (Eq. 8): what a point that touches would be dealt, alone.
    """

    gap: np.ndarray
    v: np.ndarray
    G: np.ndarray
    l: np.ndarray
    f: np.ndarray
    i: np.ndarray


class Scene:
    """One body on one surface.

    Args:
        body: the body.
        surface: the ground, `Plane` or `HeightField`; a level plane through the origin unless given.
        gravity: (3,) m/s².
        friction: Coulomb's μ, >= 0.
        restitution: e, in [0, 1].
        blow_friction: μ of impacts, >= 0, where they have one of their own: real surfaces often grip less
            in a blow than under a load that lasts. Only "impulse" knows it.

    Raises:
        ValueError: naming the argument, its value and what is allowed.
    """

    def __init__(
        self,
        body,
        surface=None,
        gravity=(0, 0, -9.81),
        friction=0.0,
        restitution=0.0,
        blow_friction=None,
    ):
        if not isinstance(body, Body):
            raise ValueError(f"body must be a Body, got {body!r}")
        surface = Plane() if surface is None else surface
        if not isinstance(surface, Plane | HeightField):
            raise ValueError(f"surface must be a Plane or a HeightField, got {surface!r}")
        if isinstance(surface, HeightField) and body.radius.max() * surface.valley > ROUNDEST:
            raise ValueError(
                f"body's radius must be <= {ROUNDEST / surface.valley:.4g} m on this surface, whose hollows "
                f"have radii of curvature down to {1.0 / surface.valley:.4g} m, got {body.radius.max():g}"
            )
        self.body = body
        self.surface = surface
        self.gravity = finite("gravity", gravity, (3,))
        self.friction = number("friction", friction, low=0.0)
        self.restitution = number("restitution", restitution, low=0.0, high=1.0)
        self.blow_friction = (
            self.friction if blow_friction is None else number("blow_friction", blow_friction, low=0.0)
        )
        hull = np.column_stack([body.hull @ body.principal_axes, body.radius])
        self.parameters = (
            np.array([body.m, *body.principal_J, body.bounding_radius]),
            np.ascontiguousarray(hull),
            (surface.parameters, surface.field),
            np.array([self.friction, self.restitution]),
        )
        """The scene as the kernels' first arguments: body, hull, ground, law."""
        self.law = terms.needed(body, self.friction, self.restitution, self.blow_friction)
        """The terms that "impulse" is compiled for; set to `terms.full`, it has them all."""

    def energy(self, state: State) -> np.ndarray | float:
        """½m|v|² + ½w·Jw − m g·x, J: a float, or (n,) for a batch."""
        R = to_matrix(state.quat)
        w_b = np.einsum("...ji,...j->...i", R, state.w)
        kinetic = self.body.m * (state.v**2).sum(-1) + np.einsum("...i,ij,...j->...", w_b, self.body.J, w_b)
        energy = 0.5 * kinetic - self.body.m * (state.x @ self.gravity)
        return energy if energy.ndim else float(energy)

    def angular_momentum(self, state: State) -> np.ndarray:
        """J w about the centre of mass, world axes, kg m²/s: (..., 3)."""
        R = to_matrix(state.quat)
        return np.einsum("...ij,jk,...lk,...l->...i", R, self.body.J, R, state.w)

    def gap(self, state: State) -> np.ndarray:
        """φ of each hull point: signed distance to the surface, radius subtracted, m. (..., p)."""
        R = to_matrix(state.quat)
        points = state.x[..., None, :] + np.einsum("...ij,pj->...pi", R, self.body.hull)
        return self.surface.distance(points) - self.body.radius

    def contact(self, state: State, force=(0, 0, 0), torque=(0, 0, 0)) -> Contact:
        """The article's l, G, v, f and i at every hull point (Eqs. 4-8), whether it touches or not.

        Args:
            state: one body or a batch.
            force: (3,) N, world axes.
            torque: (3,) N m, body axes.
        """
        a = self.gravity + finite("force", force, (3,)) / self.body.m
        torque = to_principal(self.body, finite("torque", torque, (3,)))
        rows = to_kernel(self.body, state)
        out = np.empty((len(rows), len(self.body.hull), len(fields(Contact))))
        for row, quantities in zip(rows, out, strict=True):
            acceleration.quantities(*self.parameters, a, torque, row, quantities)
        return Contact(*np.moveaxis(out.reshape(*state.x.shape[:-1], *out.shape[1:]), -1, 0))

    def explain(self) -> str:
        """Which terms the kernel of "impulse" has for this scene, why, and what each costs: a table.

        The cost of a term is what leaving it out saves, ns a step (`terms.COST`). The last line tells if
        Painlevé's paradox can occur, and from which friction on.
        """
        return terms.explain(self.body, self.friction, self.law, self.surface.field)

    def __repr__(self):
        blows = "" if self.blow_friction == self.friction else f", blow_friction={self.blow_friction:g}"
        return (
            f"Scene({self.body}, {self.surface}, gravity={self.gravity.tolist()}, "
            f"friction={self.friction:g}, restitution={self.restitution:g}{blows})"
        )
