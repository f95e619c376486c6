"""The car's looks: a procedural rally car as coloured faces, in the hull's measures.

x forward, y left, z above the ground of the upright car, m.
"""

from collections.abc import Sequence

import numpy as np

from flipcar_env import car

# Okabe and Ito's colours, which stay apart for the colour-blind.
BLUE, ORANGE, GREEN = (0, 114, 178), (230, 159, 0), (0, 158, 115)
VERMILION, SKY, PURPLE, YELLOW = (213, 94, 0), (86, 180, 233), (204, 121, 167), (240, 228, 66)
RED = (255, 60, 0)
WHITE, GREY, DARK, GLASS = (240, 240, 240), (150, 150, 150), (38, 38, 40), (20, 24, 34)
UNDERBODY = (112, 112, 118)

Face = tuple[np.ndarray, tuple[int, int, int]]
"""Four corners (4, 3), in order around the face, and the colour."""


def _mirrored(faces: Sequence[Face]) -> list[Face]:
    """The faces of the left side and, wound the other way, those of the right."""
    return [*faces, *((corners[::-1] * [1, -1, 1], colour) for corners, colour in faces)]


def _patch(face: np.ndarray, u: tuple[float, float], v: tuple[float, float]) -> np.ndarray:
    """Part of a face: u runs from corner 0 to 1, v from 0 to 3; 1 cm in front of it."""
    a, b, c, d = face
    normal = np.cross(c - a, d - b)
    uv = [(u[0], v[0]), (u[1], v[0]), (u[1], v[1]), (u[0], v[1])]
    flat = [(1 - s) * ((1 - t) * a + t * d) + s * ((1 - t) * b + t * c) for s, t in uv]
    return np.array(flat) + 0.01 * normal / np.linalg.norm(normal)


def body_faces() -> list[Face]:
    """Heights above the ground; within 3 cm of the convex hull of `car.HULL`."""
    # Cross sections from tail to nose. Each rail ends where the hull does.
    axles = car.WHEELBASE / 2 * np.array([[-1.0], [1.0]])
    arch = 0.39
    stations = [np.linspace(-2.2, 2.2, 12), *(axles + arch * np.linspace(-1, 1, 13))]
    x = np.unique(np.concatenate(stations))
    zero = np.zeros_like(x)
    sill_x, waist_x, top_x = np.clip(x, -1.85, 1.85), x, np.clip(x, -2.05, 1.76)
    sill_y = np.interp(sill_x, [-1.85, -1.3, 1.3, 1.85], [0.70, 0.79, 0.79, 0.70])
    floor = np.interp(sill_x, [-1.85, -1.6, 1.6, 1.85], [0.32, 0.22, 0.22, 0.32])
    opening = np.sqrt(np.maximum(arch**2 - (sill_x - axles) ** 2, 0.0)).max(axis=0)
    sill = np.maximum(floor, np.where(opening > 0, car.WHEEL_RADIUS + opening, 0.0))
    waist = np.maximum(np.interp(x, [-2.2, -1.3, 1.3, 2.2], [0.45, 0.5, 0.5, 0.45]), sill + 0.02)
    waist_y = np.interp(x, [-2.2, -1.25, 1.25, 2.2], [0.75, 0.89, 0.89, 0.75])
    waist_y -= 0.2 * np.maximum(waist - 0.5, 0.0)
    top_y = np.interp(top_x, [-2.05, -1.3, 1.0, 1.76], [0.68, 0.83, 0.83, 0.64])
    top = zero + 0.79
    rails = np.array(
        [
            (sill_x, zero, floor),
            (sill_x, zero + 0.56, floor),
            (sill_x, zero + 0.56, sill),
            (sill_x, sill_y, sill),
            (waist_x, waist_y, waist),
            (top_x, top_y, top),
            (top_x, zero, top),
        ]
    ).transpose(0, 2, 1)  # (rail, section, 3)
    strips = [UNDERBODY, UNDERBODY, DARK, WHITE, BLUE, BLUE]
    faces = [
        (np.array([rails[k, i], rails[k + 1, i], rails[k + 1, i + 1], rails[k, i + 1]]), colour)
        for k, colour in enumerate(strips)
        for i in range(len(x) - 1)
    ]
    waist_mid = np.stack([waist_x, zero, waist], axis=1)
    for i, turn in ((-1, 1), (0, -1)):  # nose and tail, each below and above the waist
        below = np.array([rails[0, i], rails[3, i], rails[4, i], waist_mid[i]])[::turn]
        above = np.array([waist_mid[i], rails[4, i], rails[5, i], rails[6, i]])[::turn]
        faces += [(below, DARK), (above, BLUE)]
        lamp = YELLOW if turn > 0 else VERMILION
        faces.append((_patch(above, (0.62, 0.95), (0.3, 0.8)), lamp))
        faces.append((_patch(above, (0.0, 0.5), (0.3, 0.8)), DARK if turn > 0 else WHITE))
    return _mirrored(faces + _cabin_faces())


def _cabin_faces() -> list[Face]:
    """Left half of the greenhouse, the stripes and the wing."""
    base, rail, crown = 0.79, car.HULL["rail_front_left"], car.HULL["crown_front"]
    front, rear = rail[0], car.HULL["rail_rear_left"][0]
    rail_z, crown_z = (point[2] + car.CENTRE_OF_MASS_HEIGHT for point in (rail, crown))
    rails = [(rear, rail[1], rail_z), (front, rail[1], rail_z)]
    crowns = [(rear, 0.0, crown_z), (front, 0.0, crown_z)]
    tail, cowl = (-1.85, 0.72, base), (1.05, 0.72, base)
    windscreen = np.array([(1.05, 0.0, base), cowl, rails[1], crowns[1]])
    rear_window = np.array([crowns[0], rails[0], tail, (-1.85, 0.0, base)])
    side = np.array([tail, rails[0], rails[1], cowl])
    roof = np.array([rails[0], crowns[0], crowns[1], rails[1]])
    bonnet = np.array([(1.05, 0.70, base), (1.05, 0.0, base), (1.74, 0.0, base), (1.74, 0.6, base)])
    wing = car.HULL["spoiler_left"]
    wing_z = wing[2] + car.CENTRE_OF_MASS_HEIGHT
    return [
        (windscreen, BLUE),
        (_patch(windscreen, (0.0, 0.9), (0.08, 0.9)), GLASS),
        (rear_window, BLUE),
        (_patch(rear_window, (0.0, 0.88), (0.12, 0.75)), GLASS),
        (side, BLUE),
        (_patch(side, (0.15, 0.85), (0.22, 0.50)), GLASS),
        (_patch(side, (0.15, 0.85), (0.53, 0.86)), GLASS),
        (roof, WHITE),
        (_patch(roof, (0.6, 1.0), (0.0, 1.0)), ORANGE),
        (_patch(bonnet, (0.6, 1.0), (0.0, 1.0)), ORANGE),
        *_box((wing[0], 0.0, wing_z - 0.05), (wing[0] + 0.3, wing[1], wing_z), ORANGE),
        *_box((wing[0] + 0.1, 0.4, base), (wing[0] + 0.2, 0.45, wing_z - 0.05), DARK),
    ]


def _box(low: Sequence[float], high: Sequence[float], colour: tuple[int, int, int]) -> list[Face]:
    corners = np.array(
        [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )
    order = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return [(corners[list(face)], colour) for face in order]


def wheel_faces(sectors: int = 24) -> list[Face]:
    """Four wheels, turned around their axles; the tyre's outer shoulder is the hull's sphere."""
    _, y, _, shoulder = car.HULL["tyre_front_left"]
    outer, tread = y + shoulder, car.WHEEL_RADIUS - shoulder
    round_part = np.radians([0.0, 45.0, 90.0])
    # Radius and y along a section of the tyre and rim, from the inner to the outer side.
    radius = [
        0.0,
        tread + 0.05,
        car.WHEEL_RADIUS,
        *(tread + shoulder * np.cos(round_part)),
        0.2,
        0.0,
    ]
    across = [-0.22, -0.22, -0.19, *(shoulder * (np.sin(round_part) - 1.0)), -0.02, -0.02]
    angle = np.linspace(0.0, 2.0 * np.pi, sectors + 1)
    faces = []
    for axle in (-car.WHEELBASE / 2, car.WHEELBASE / 2):
        along = axle + np.outer(np.cos(angle), radius)
        height = car.WHEEL_RADIUS + np.outer(np.sin(angle), radius)
        ring = np.stack([along, np.broadcast_to(outer + np.array(across), along.shape), height], axis=2)
        for j in range(sectors):
            spoke = WHITE if j % 4 < 2 else DARK
            for k in range(len(radius) - 1):
                quad = np.array([ring[j, k], ring[j, k + 1], ring[j + 1, k + 1], ring[j + 1, k]])
                faces.append((quad, spoke if k == len(radius) - 2 else DARK))
    return _mirrored(faces)
