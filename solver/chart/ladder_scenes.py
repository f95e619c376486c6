"""Scenes that terms are left out of: short runs, in which each term that a scene has can show."""

from dataclasses import dataclass

import numpy as np

from solver.body import Body
from solver.rotation import from_vector
from solver.scene import Scene, State
from solver.surface import HeightField, Plane

from .problems import ZERO, one, placed


@dataclass(frozen=True, eq=False)
class Case:
    """A scene to leave terms out of.

    Attributes:
        name: a few words.
        scene: with every term it needs.
        start: a batch of one.
        duration: s.
        torque: (3,) N m, body axes, held.
    """

    name: str
    scene: Scene
    start: State
    duration: float = 0.5
    torque: tuple = ZERO


def cases(car: Body | None = None) -> list[Case]:
    """The scenes; those with a car only if there is one."""
    R = 0.1
    box, ball = Body.box(1.0, (0.3, 0.4, 0.5)), Body.sphere(1.0, R)

    spin = Scene(Body(1.0, (1e-3, 2e-3, 2.5e-3), [ZERO], radius=0.05), gravity=ZERO)
    top = Scene(Body(1.0, (0.01, 0.01, 0.006), [(0, 0.03, -0.09)], radius=0.01))
    skid = Scene(Body(1.0, np.full(3, 0.004), [(0, 0, -0.02)], radius=R), friction=0.1)
    slope = Plane((np.sin(0.2), 0, np.cos(0.2)))
    roll = Scene(ball, slope, friction=0.5)
    slide = Scene(box, friction=0.3)
    bounce = Scene(ball, restitution=0.8)
    rock = Scene(Body.box(1.0, (0.1, 0.2, 0.4)), friction=1.0)
    toss = Scene(box, friction=0.4, restitution=0.3)
    bumpy = HeightField.named("bumpy", height=0.03, spacing=0.5, size=8)
    bumps = Scene(ball, bumpy, friction=0.5)

    N, down = slope.normal, np.array([np.cos(0.2), 0, -np.sin(0.2)])
    found = [
        Case("free spin", spin, one((0, 0, 1), w=(2, 10, 1))),
        Case("frictionless top", top, placed(top, one((0, 0, 0.1), w=(1, 0.5, 60)))),
        Case(
            "off-centre sphere skids",
            skid,
            placed(skid, one((0, 0, 0.2), from_vector((0.6, 0, 0)), (1, 0.3, 0), (20, -5, 10))),
        ),
        Case("sphere rolls down", roll, one(R * N, v=down, w=np.cross(N, down) / R)),
        Case("block slides", slide, one((0, 0, 0.25), v=(2, 0.5, 0), w=(0, 0, 3))),
        Case("ball bounces", bounce, one((0, 0, 0.4), v=(1, 0, 0), w=(3, 2, 1))),
        Case("block rocks", rock, placed(rock, one((0, 0, 0.2), from_vector((0, 0.15, 0))))),
        Case("box tossed", toss, one((0, 0, 0.6), from_vector((0.42, 0, 0.56)), (2, 1, -1), (6, -5, 4))),
        Case("ball on bumpy ground", bumps, _rolling(bumpy, R, (0.1, 0.05), (1.5, 0.7))),
    ]
    if car is not None:
        ground = Scene(car, friction=0.8)
        roof = placed(ground, one((0, 0, 1), from_vector((np.pi - 0.15, 0, 0))))
        crash = one((0, 0, 1.3), from_vector((1.8, 0, 0)), (12, 3, -3), (5, 1, 2))
        found += [
            Case("car on its roof, torque", ground, roof, torque=(3100.0, 0.0, 0.0)),
            Case("car rolls out of a crash", ground, crash),
        ]
    return found


def _rolling(ground: HeightField, R: float, place: tuple, v: tuple) -> State:
    """A sphere of radius R that touches the ground near a place and rolls, at v (2,) along x and y."""
    x = np.array([*place, 0.0])
    for _ in range(60):  # down to rounding: each leaves a small part of the gap
        foot = ground.feet(x)
        x = x - (foot[0] - R) * foot[1:4]
    N = foot[1:4]
    v_com = np.array([*v, -(N[:2] @ v) / N[2]])
    return one(x, v=v_com, w=np.cross(N, v_com) / R)
