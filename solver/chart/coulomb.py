"""Several points with Coulomb friction, solved by trying everything: off, sticks or slides, in any direction.

For the reference: slow, obvious, without a line of the solver's. Impulses or forces p (n, 3) of n points are
sought along (N, t1, t2) that push only, let no point sink, and obey Coulomb. Where none do, or where some
do that move the body in different ways, rigid-body mechanics has no one answer: `Undetermined`.
"""

from collections.abc import Callable
from itertools import product

import numpy as np
from scipy.optimize import minimize, root

STICKS, OFF, SLIDES = "sticks", "off", "slides"
"""How a point touches. In a list of modes, one that slides has its direction s instead, (2,)."""

SLACK = 1e-10
"""By so much of the problem's scale a condition may be missed."""

ALIKE = 1e-6
"""Of the problem's scale: answers that differ by less are one."""

RANK = 1e-10
"""Of the largest singular value: smaller ones are zero."""

STARTS = {1: 12, 2: 4, 3: 3}
"""Directions all around that slip is sought from, for so many points at a time; else 2."""


class Undetermined(RuntimeError):
    """Rigid-body mechanics has no answer here, or more than one."""


def solve(K: np.ndarray, b: np.ndarray, modes: list, mu: float) -> tuple[np.ndarray, np.ndarray, bool]:
    """The impulses of points whose modes are known: b + K p is zero along N, and across it where they stick.

    Args:
        K: (3n, 3n) Eq. 10 for all of them.
        b: (n, 3) velocity, or acceleration, without them.
        modes: STICKS, OFF, or a direction s: then p ∥ N − μ s (Eq. 11).
        mu: friction coefficient.

    Returns:
        (p, idle, unique): the least p (n, 3); (n, 3, d) what can be added to it; and whether that leaves
        the motion as it is. Not so where friction depends on normal forces that are not unique.
    """
    zero: list[int] = []
    unknowns = []
    for k, mode in enumerate(modes):
        for j in range({STICKS: 3, OFF: 0}[mode] if isinstance(mode, str) else 1):
            zero.append(3 * k + j)
            column = np.zeros_like(b)
            column[k, j] = 1.0
            if not isinstance(mode, str):
                column[k, 1:] = -mu * mode
            unknowns.append(column.ravel())
    if not zero:
        return np.zeros_like(b), np.zeros((*b.shape, 0)), True
    V = np.array(unknowns).T
    left, size, right = np.linalg.svd(K[zero] @ V)
    rank = int((size > RANK * size[0]).sum())
    p = V @ (right[:rank].T @ ((left.T @ -b.ravel()[zero])[:rank] / size[:rank]))
    idle = V @ right[rank:].T
    unique = np.abs(K @ idle).max(initial=0.0) <= ALIKE * K.max()
    return p.reshape(b.shape), idle.reshape(*b.shape, -1), bool(unique)


def room(p: np.ndarray, modes: list, mu: float) -> np.ndarray:
    """What must not be negative: how hard each point pushes, and what friction has left where it sticks."""
    on = [(q, mode) for q, mode in zip(p, modes, strict=True) if mode is not OFF]
    return np.array([q[0] for q, _ in on] + [mu * q[0] - np.hypot(*q[1:]) for q, m in on if m is STICKS])


def roomiest(p: np.ndarray, idle: np.ndarray, modes: list, mu: float) -> np.ndarray:
    """Of all p + idle z, which move the body alike, one with the most room; p itself if that will do."""
    n, size = idle.shape[2], np.abs(p).max(initial=0.0)
    if n == 0 or size == 0.0 or room(p, modes, mu).min() >= 0.0:
        return p
    best = minimize(
        lambda z: -z[n],
        np.append(np.zeros(n), room(p, modes, mu).min() / size),
        constraints={"type": "ineq", "fun": lambda z: room(p / size + idle @ z[:n], modes, mu) - z[n]},
        method="SLSQP",
    )
    return max((p, p + size * (idle @ best.x[:n])), key=lambda p: room(p, modes, mu).min())


def directions(slip: Callable, n: int) -> list[np.ndarray]:
    """Angles (n,) at which n points slip along their own directions; if n = 0, the one there is, (0,)."""
    found: list[np.ndarray] = [] if n else [np.zeros(0)]
    around = np.linspace(-np.pi, np.pi, STARTS.get(n, 2), endpoint=False)
    for start in product(around, repeat=n) if n else ():
        angles = root(lambda angles: slip(angles)[1], start, tol=1e-15).x
        along, across = slip(angles)
        known = any(np.abs(np.exp(1j * angles) - np.exp(1j * old)).max() < 1e-6 for old in found)
        if np.abs(across).max() < 1e-12 and along.min() > 0.0 and not known:
            found.append(angles)
    return found


def holds(K: np.ndarray, b: np.ndarray, p: np.ndarray, mu: float, k: int) -> bool:
    """Could point k stick, the others' impulses being what they are?"""
    own = slice(3 * k, 3 * k + 3)
    held = p[k] - np.linalg.solve(K[own, own], b[k] + K[own] @ p.ravel())
    return room(held[None], [STICKS], mu).min() > SLACK * np.abs(held).max()


def contacts(K: np.ndarray, b: np.ndarray, r: np.ndarray, mu: float, slides: list) -> tuple[np.ndarray, list]:
    """The impulses, or forces, of n points: each sticks if it can, or slides, or is off.

    Slip is along r + K p. With the mean of the slip before and after for that, slip that would end up
    reversed fits as well; it has stopped on the way, so the point sticks.

    Args:
        K: (3n, 3n).
        b: (n, 3) velocity less what is asked for, or acceleration, without them.
        r: (n, 2) what slip is measured from.
        mu: friction coefficient.
        slides: for each point the direction in which it slips already, else None.

    Returns:
        (p (n, 3), modes). Of ways that move the body alike, the one with the most points that stick, and
        the fewest that are off.

    Raises:
        Undetermined: none fits, or several that move the body in different ways.
    """
    n, scale = len(b), np.abs(b).max()
    fits: list[tuple[int, np.ndarray, list]] = []
    for kinds in product(*[(STICKS, SLIDES, OFF) if s is None else (s, OFF) for s in slides]):
        free = [k for k in range(n) if kinds[k] is SLIDES]

        def modes_at(angles, kinds=kinds, free=free):
            modes = list(kinds)
            for k, angle in zip(free, angles, strict=True):
                modes[k] = np.array([np.cos(angle), np.sin(angle)])
            return modes

        def slip(angles, modes_at=modes_at, free=free):
            """(along, across) the directions."""
            s = modes_at(angles)
            t = r + (K @ solve(K, b, s, mu)[0].ravel()).reshape(n, 3)[:, 1:]
            along = [t[k] @ s[k] for k in free]
            across = [s[k][0] * t[k, 1] - s[k][1] * t[k, 0] for k in free]
            return np.array(along) / scale, np.array(across) / scale

        for angles in directions(slip, len(free)):
            modes = modes_at(angles)
            p, idle, unique = solve(K, b, modes, mu)
            p = roomiest(p, idle, modes, mu)
            after = b[:, 0] + (K @ p.ravel()).reshape(n, 3)[:, 0]
            pulls = -room(p, modes, mu).min(initial=0.0) * K.max()
            if max(pulls, -after.min()) <= SLACK * scale and not any(holds(K, b, p, mu, k) for k in free):
                if not unique:
                    raise Undetermined("friction depends on normal forces that are not unique")
                rank = sum(mode is OFF for mode in modes) * n + sum(mode is not STICKS for mode in modes)
                fits.append((rank, p, modes))
    if not fits:
        raise Undetermined("no combination of sticking and sliding fits")
    moves = np.array([K @ p.ravel() for _rank, p, _modes in fits])
    if np.ptp(moves, axis=0).max() > ALIKE * scale:
        raise Undetermined(f"{len(fits)} combinations of sticking and sliding fit")
    _rank, p, modes = min(fits, key=lambda fit: fit[0])
    return p, modes
