"""Painlevé's paradox, decided before a run: up to which friction Eq. 11's denominator stays positive.

    N·K N > μ |K_t N|,  K_t N the part of K N along the surface

is needed for every normal N that the body can meet: over all attitudes, every direction in the body.
"""

import numpy as np

from .body import Body

GRID = 1000
"""Directions tried first, where the radius makes K depend on N."""

CLIMBERS = 24
"""So many of them are improved, the steepest."""

FINEST = 1e-9
"""rad: the last steps of a climb. Near its top a hill falls with the square of that."""


def critical_friction(body: Body) -> np.ndarray:
    """The least μ with which each hull point can meet Painlevé's paradox, alone.

    For a sharp point K is one matrix in body axes, symmetric and positive definite. The angle between N
    and K N is largest halfway, in a sense, between the axes of its extreme eigenvalues (Kantorovich):
    with κ their ratio, μ = 2 √κ/(κ − 1). A rod's end has κ = 4: μ = 4/3. With a radius ρ the contact's
    arm is q = b − ρN, and the worst N is searched for.

    Args:
        body: the body.

    Returns:
        (p,); inf where no friction is enough, as for a sphere.
    """
    return np.array([_critical(body, b, rho) for b, rho in zip(body.hull, body.radius, strict=True)])


def _critical(body: Body, b: np.ndarray, rho: float) -> float:
    inv_J = np.linalg.inv(body.J)
    B = np.cross(b, np.eye(3)).T  # B N = b × N
    eigenvalues, axes = np.linalg.eigh(np.eye(3) / body.m + B.T @ inv_J @ B)  # Eq. 10 for ρ = 0
    low, high = np.sqrt(eigenvalues[[0, 2]])
    if rho == 0.0:
        steepest = (high**2 - low**2) / (2.0 * high * low)
    else:
        ends = [s * high * axes[:, 0] + t * low * axes[:, 2] for s in (-1, 1) for t in (-1, 1)]
        steepest = _climb(lambda N: _steepness(N, b, rho, body.m, inv_J), np.array(ends))
    return 1.0 / steepest if steepest > 0.0 else np.inf


def _steepness(N: np.ndarray, b: np.ndarray, rho: float, m: float, inv_J: np.ndarray) -> np.ndarray:
    """|K_t N|/(N·K N) for normals (..., 3)."""
    arm = np.cross(b, N)  # q × N: the radius drops out
    turn = arm @ inv_J
    sideways = np.cross(turn, b - rho * N)
    sideways -= (sideways * N).sum(-1, keepdims=True) * N
    return np.linalg.norm(sideways, axis=-1) / (1.0 / m + (arm * turn).sum(-1))


def _climb(height, starts: np.ndarray) -> float:
    """The maximum of a function of directions: a grid, then eight steps about the best of it, halved."""
    k = np.arange(GRID) + 0.5
    z, turn = 1.0 - 2.0 * k / GRID, np.pi * (1.0 + np.sqrt(5.0)) * k
    grid = np.column_stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z])
    grid = np.concatenate([starts / np.linalg.norm(starts, axis=1, keepdims=True), grid])
    N = grid[np.argsort(-height(grid))[:CLIMBERS]]
    compass = np.exp(0.25j * np.pi * np.arange(8))
    reach = np.full(len(N), 2.0 / np.sqrt(GRID))
    while reach.max() > FINEST:
        side = np.cross(N, np.eye(3)[np.abs(N).argmin(axis=1)])
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        ahead = np.cross(N, side)
        steps = compass.real[:, None] * side[:, None] + compass.imag[:, None] * ahead[:, None]
        around = N[:, None] + reach[:, None, None] * steps
        around /= np.linalg.norm(around, axis=-1, keepdims=True)
        heights = height(around)
        best = heights.argmax(axis=1)
        rows = np.arange(len(N))
        higher = heights[rows, best] > height(N)
        N = np.where(higher[:, None], around[rows, best], N)
        reach = np.where(higher, reach, 0.5 * reach)
    return float(height(N).max())
