"""Which terms of the equations a scene needs: a kernel is compiled for those alone.

A kernel takes them as `law`, a tuple (μ, e, gyroscopic, several, centripetal, μ of blows) in which None
stands for a term that is left out. None is a type of its own, so each choice is another specialisation,
which numba's cache on disk keeps; `if mu is None` is decided before the code behind it is even typed. Where
a term is zero, leaving it out changes no bit: tests compare with `full`. What it does to leave out more
is on the model ladder (`solver.chart.ladder`).
"""

import numpy as np

from .body import Body
from .painleve import critical_friction

Law = tuple[float | None, float | None, bool | None, bool | None, bool | None, float | None]


def needed(body: Body, friction: float, restitution: float, blow_friction: float | None = None) -> Law:
    """The terms of a scene: what is zero in it is None.

    Args:
        body: its J has no gyroscopic term if it is a multiple of the identity; one hull point needs
            no sweep; hull points at the centre of mass have no centripetal acceleration.
        friction: μ.
        restitution: e.
        blow_friction: μ of blows; None: as in lasting contacts.
    """
    return (
        friction if friction > 0.0 else None,
        restitution if restitution > 0.0 else None,
        None if np.ptp(body.principal_J) == 0.0 else True,
        True if len(body.hull) > 1 else None,
        True if body.hull.any() else None,
        None if blow_friction == friction else blow_friction,
    )


def full(friction: float, restitution: float) -> Law:
    """Every term, needed or not: to set a scene's `law` to, for comparison."""
    return friction, restitution, True, True, True, friction


COST = {
    "friction": 40,
    "restitution": 0,
    "gyroscopic": 10,
    "centripetal": 0,
    "sweep": 0,
    "curvature": 370,
    "contact work": 220,
    "steps at rest": 240,
}
"""ns a step that leaving the term out saves: differences of medians by `python -m solver.chart.terms`, on
two shared cores of a virtual x86-64 machine. Less than 10 there cannot be told from 0, and a step of flight
takes 80 to 100."""


def present(body: Body, friction: float, law: Law, field: tuple | None) -> list[tuple[str, bool, str]]:
    """Of each term: its name, whether the scene has it, and why.

    Args:
        body: of the scene.
        friction: its μ.
        law: what its kernel is compiled for.
        field: of its surface; None for a plane.
    """
    mu, e, gyro, several, centri, mu_blow = law
    rho = body.radius.max()
    J = ", ".join(f"{moment:.4g}" for moment in body.principal_J)
    whole = np.ptp(body.principal_J) == 0.0
    points = len(body.hull)
    rows = [
        ("friction", mu, f"μ = {friction:g}"),
        ("restitution", e, f"e = {e or 0.0:g}"),
        ("gyroscopic", gyro, f"J = ({J}) kg m²: w × J w " + ("= 0" if whole else "≠ 0")),
        ("centripetal", centri, f"w × (w × b), |b| up to {np.linalg.norm(body.hull, axis=1).max():.4g} m"),
        ("sweep", several, f"{points} hull points" if points > 1 else "one hull point: one solve is exact"),
        ("rounding", rho or None, f"hull radii up to {rho:.4g} m" if rho else "sharp points: q = b"),
        ("blows", mu_blow, f"μ = {friction if mu_blow is None else mu_blow:g} in impacts"),
        ("curvature", field, f"H up to {field[5]:.3g} 1/m" if field else "the ground is a plane: H = 0"),
        ("contact work", True, f"out while the centre of mass is above {body.bounding_radius:.4g} m"),
        ("steps at rest", True, "out after a step that changes no bit, for the rest of the call"),
    ]
    return [(term, value is not None, why) for term, value, why in rows]


def explain(body: Body, friction: float, law: Law, field: tuple | None) -> str:
    """A table of a scene's terms, and whether Painlevé's paradox can occur; arguments as for `present`."""
    lines = [f"{'term':14}{'':5}{'ns/step':>8}  why"]
    for term, is_in, why in present(body, friction, law, field):
        cost = f"{COST[term]:g}" if term in COST else "-"
        lines.append(f"{term:14}{'in' if is_in else 'out':5}{cost:>8}  {why}")
    critical = critical_friction(body)
    k = int(critical.argmin())
    if np.isinf(critical[k]):
        why = "cannot occur with any friction"
    else:
        can = "can" if friction >= critical[k] else "cannot"
        why = f"{can} occur at μ = {friction:g}; hull point {k} meets it from μ = {critical[k]:.4g}"
    return "\n".join([*lines, f"{'Painlevé':27}  {why}"])
