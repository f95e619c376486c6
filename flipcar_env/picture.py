"""Pictures of cars, drawn by the processor alone: no screen, no GPU.

Triangles with a depth buffer, flat faces under one light, the car's shadow on the ground. A picture is
a function of the state, so drawing changes nothing. World axes, m; `depth` holds 1/distance along the
view, which is linear over a flat face seen in perspective.
"""

from functools import cache
from math import ceil, floor, sqrt, tan

import numpy as np

from solver import HeightField, Plane
from solver.algebra import (
    add,
    axpy,
    borrowed,
    cross,
    dot,
    entry,
    jit,
    keep_alive,
    matrix,
    put2,
    scale,
    stage,
    to_world,
    vec,
    vec2,
)
from solver.field import height as height_of
from solver.field import lent

from . import car
from . import row as r
from .car_mesh import body_faces, wheel_faces

WIDTH, HEIGHT = 480, 360

EYE = (4.1, -6.2, 2.9)
"""The camera, from the point that it looks at; it goes with the car, and does not turn."""
OVER = 0.5
"""m over the ground, below the car's centre: what the camera looks at."""
SLOPE_OF_VIEW = tan(0.4)
"""Half of the picture's height, at distance 1."""

LIGHT = (-0.35, -0.55, 0.76)
"""Towards the sun."""
AMBIENT = 0.45
SHADOW = 0.55
"""Brightness of the ground in the car's shadow."""
SPREAD, CELLS = 2.7, 128
"""m from the car's centre to the edge of the shadow's map, and its cells along an edge."""

SKY, HORIZON = np.array([150.0, 188.0, 222.0]), np.array([214.0, 222.0, 226.0])
TILES = np.array([(166.0, 156.0, 136.0), (150.0, 140.0, 120.0)])
"""The ground: tiles of a metre."""
HAZE = 45.0
"""m; at this distance the ground is half as haze as it gets."""

NEAR = 0.2
"""m; nothing nearer to the camera is drawn."""

_NODES = 97
_STEP, _GROWTH = 0.35, 1.075
"""m between the middle nodes of a height field's mesh, and how much wider each next gap is."""


@cache
def _mesh() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The car's q quads: corners (4q, 3) from the nominal centre of mass, normals (q, 3), colours (q, 3)."""
    faces = [*body_faces(), *wheel_faces()]
    corners = np.array([quad for quad, _ in faces]) - [0.0, 0.0, car.CENTRE_OF_MASS_HEIGHT]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return corners.reshape(-1, 3), normals, np.array([colour for _, colour in faces], dtype=float)


@cache
def _offsets() -> np.ndarray:
    """Of a height field's nodes from the middle one, m: close together there, far apart far away."""
    gaps = _STEP * _GROWTH ** np.arange(_NODES // 2)
    out = np.concatenate([[0.0], np.cumsum(gaps)])
    return np.concatenate([-out[:0:-1], out])


def draw(
    states: np.ndarray, surface: Plane | HeightField, width: int = WIDTH, height: int = HEIGHT
) -> np.ndarray:
    """Pictures of cars on one ground.

    Args:
        states: (n, k) as `get_state` gives them.
        surface: the ground.
        width: of a picture.
        height: of a picture.

    Returns:
        (n, height, width, 3) uint8.
    """
    pictures = np.empty((len(states), height, width, 3), np.uint8)
    _draw(pictures, np.ascontiguousarray(states), surface.parameters, surface.field, *_mesh(), _offsets())
    return pictures


@jit
def _seen(eye, axes, size, middle, p):
    """(column, row, 1/distance) of a point on the picture; behind the camera, the last is 0."""
    right, up, ahead = axes
    d = (p[0] - eye[0], p[1] - eye[1], p[2] - eye[2])
    far = dot(d, ahead)
    if far < NEAR:
        return 0.0, 0.0, 0.0
    near = 1.0 / far
    return middle[0] + size * near * dot(d, right), middle[1] - size * near * dot(d, up), near


@jit
def _reach(p, q, y, least, most):
    """Widen a row's span to where an edge crosses it."""
    if (p[1] <= y) != (q[1] <= y):
        x = p[0] + (y - p[1]) * (q[0] - p[0]) / (q[1] - p[1])
        return min(least, x), max(most, x)
    return least, most


@stage
def _fill(depth, light, paint, a, b, c, lights, what):
    """Draw a triangle where it is nearer than what is there: pixels whose middles it covers.

    Args:
        depth: (height, width) 1/distance.
        light: (height, width) brightness.
        paint: (height, width) what is seen.
        a: (3,) a corner as `_seen` gives it.
        b: the second.
        c: the third.
        lights: (3,) brightness at the corners.
        what: to paint.
    """
    if a[2] == 0.0 or b[2] == 0.0 or c[2] == 0.0:
        return
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if area == 0.0:
        return
    rows, columns = depth.shape
    top = max(0, ceil(min(a[1], b[1], c[1]) - 0.5))
    bottom = min(rows - 1, floor(max(a[1], b[1], c[1]) - 0.5))
    if top > bottom or max(a[0], b[0], c[0]) < 0.0 or min(a[0], b[0], c[0]) > columns:
        return
    # both are linear over the picture: value at a, and slopes along columns and rows
    n1, n2, l1, l2 = b[2] - a[2], c[2] - a[2], lights[1] - lights[0], lights[2] - lights[0]
    x1, x2, y1, y2 = b[0] - a[0], c[0] - a[0], b[1] - a[1], c[1] - a[1]
    n_x, n_y = (n1 * y2 - n2 * y1) / area, (n2 * x1 - n1 * x2) / area
    l_x, l_y = (l1 * y2 - l2 * y1) / area, (l2 * x1 - l1 * x2) / area
    for i in range(top, bottom + 1):
        y = i + 0.5
        least, most = _reach(a, b, y, 1e9, -1e9)
        least, most = _reach(b, c, y, least, most)
        least, most = _reach(c, a, y, least, most)
        for j in range(max(0, ceil(least - 0.5)), min(columns - 1, floor(most - 0.5)) + 1):
            x = j + 0.5 - a[0]
            near = np.float32(a[2] + n_x * x + n_y * (y - a[1]))
            if near > depth[i, j]:
                depth[i, j] = near
                light[i, j] = np.float32(lights[0] + l_x * x + l_y * (y - a[1]))
                paint[i, j] = what


@jit
def _brightness(normal):
    """Of a face that is seen, with its normal towards the camera."""
    return AMBIENT + (1.0 - AMBIENT) * max(0.0, dot(normal, LIGHT))


SKY_SEEN, GROUND_SEEN = -2, -1
"""What a pixel shows; from 0 on it is a face of the car."""


@stage
def _put_ground(depth, light, paint, view, plane, field, x, offsets, nodes):
    """Draw the ground as a mesh around x, a point on it, finer there; nodes (n², 4) is scratch."""
    n = offsets.shape[0]
    i0, j0 = floor(x[0]), floor(x[1])  # nodes do not swim along with the car
    for i in range(n):
        for j in range(n):
            px, py = i0 + offsets[i], j0 + offsets[j]
            if field is None:
                pz = (plane[9] - plane[0] * px - plane[1] * py) / plane[2]
                normal = vec(plane, 0)
            else:
                pz, h_x, h_y, _xx, _xy, _yy = height_of(field, px, py)
                normal = scale(1.0 / sqrt(1.0 + h_x * h_x + h_y * h_y), (-h_x, -h_y, 1.0))
            spot = _seen(view[0], view[1], view[2], view[3], (px, py, pz))
            put2(nodes, i * n + j, 0, spot)
            nodes[i * n + j, 3] = _brightness(normal)
    for i in range(n - 1):
        for j in range(n - 1):
            k = i * n + j
            a, b, c, d = (
                vec2(nodes, k, 0),
                vec2(nodes, k + n, 0),
                vec2(nodes, k + n + 1, 0),
                vec2(nodes, k + 1, 0),
            )
            la, lb, lc, ld = nodes[k, 3], nodes[k + n, 3], nodes[k + n + 1, 3], nodes[k + 1, 3]
            _fill(depth, light, paint, a, b, c, (la, lb, lc), GROUND_SEEN)
            _fill(depth, light, paint, a, c, d, (la, lc, ld), GROUND_SEEN)


@stage
def _put_car(depth, light, paint, view, at, corners, normals):
    """Draw the car, at = (point of the car's origin, its rotation)."""
    eye, axes, size, middle = view
    for k in range(corners.shape[0] // 4):
        p = add(at[0], to_world(at[1], vec2(corners, 4 * k, 0)))
        normal = to_world(at[1], vec2(normals, k, 0))
        if dot(normal, (eye[0] - p[0], eye[1] - p[1], eye[2] - p[2])) < 0.0:
            normal = scale(-1.0, normal)
        bright = _brightness(normal)
        lights = (bright, bright, bright)
        a = _seen(eye, axes, size, middle, p)
        b = _seen(eye, axes, size, middle, add(at[0], to_world(at[1], vec2(corners, 4 * k + 1, 0))))
        c = _seen(eye, axes, size, middle, add(at[0], to_world(at[1], vec2(corners, 4 * k + 2, 0))))
        d = _seen(eye, axes, size, middle, add(at[0], to_world(at[1], vec2(corners, 4 * k + 3, 0))))
        _fill(depth, light, paint, a, b, c, lights, k)
        _fill(depth, light, paint, a, c, d, lights, k)


@stage
def _cast(map_, light, paint, at, e1, e2, corners):
    """Fill the map of the car's shadow: seen along the light, from as far as you like."""
    per_m = 0.5 * CELLS / SPREAD
    for k in range(corners.shape[0] // 4):
        a = _shade(at, e1, e2, per_m, vec2(corners, 4 * k, 0))
        b = _shade(at, e1, e2, per_m, vec2(corners, 4 * k + 1, 0))
        c = _shade(at, e1, e2, per_m, vec2(corners, 4 * k + 2, 0))
        d = _shade(at, e1, e2, per_m, vec2(corners, 4 * k + 3, 0))
        _fill(map_, light, paint, a, b, c, (0.0, 0.0, 0.0), 0)
        _fill(map_, light, paint, a, c, d, (0.0, 0.0, 0.0), 0)


@jit
def _shade(at, e1, e2, per_m, corner):
    p = to_world(at[1], corner)
    return 0.5 * CELLS + per_m * dot(p, e1), 0.5 * CELLS + per_m * dot(p, e2), 1.0


@jit
def _lit(map_, u, v):
    """Share of the light at a place on the shadow's map, smoothed over a cell."""
    if not (1.0 <= u < CELLS - 1.0 and 1.0 <= v < CELLS - 1.0):
        return 1.0
    i, j = int(v - 0.5), int(u - 0.5)
    s, t = v - 0.5 - i, u - 0.5 - j
    dark = (1.0 - s) * ((1.0 - t) * map_[i, j] + t * map_[i, j + 1])
    dark += s * ((1.0 - t) * map_[i + 1, j] + t * map_[i + 1, j + 1])
    return 1.0 - (1.0 - SHADOW) * dark


@stage
def _colour(depth, light, paint, view, at, e1, e2, map_, colours, picture):
    """From what is seen to the picture."""
    eye, axes, size, middle = view
    rows, columns = depth.shape
    per_m = 0.5 * CELLS / SPREAD
    for i in range(rows):
        high = (middle[1] - i - 0.5) / size
        for j in range(columns):
            what, near = paint[i, j], depth[i, j]
            if what == SKY_SEEN:
                t = min(1.0, max(0.0, 2.0 * high + 0.6))
                for k in range(3):
                    picture[i, j, k] = np.uint8(HORIZON[k] + t * (SKY[k] - HORIZON[k]))
                continue
            bright = light[i, j]
            if what >= 0:
                for k in range(3):
                    picture[i, j, k] = np.uint8(bright * colours[what, k])
                continue
            side = (j + 0.5 - middle[0]) / size
            ray = axpy(side, axes[0], axpy(high, axes[1], axes[2]))
            far = 1.0 / near
            p = axpy(far, ray, eye)
            tile = (floor(p[0]) + floor(p[1])) & 1
            d = (p[0] - at[0][0], p[1] - at[0][1], p[2] - at[0][2])
            bright *= _lit(map_, 0.5 * CELLS + per_m * dot(d, e1), 0.5 * CELLS + per_m * dot(d, e2))
            haze = far / (far + HAZE)
            haze *= haze
            for k in range(3):
                ground = bright * TILES[tile, k]
                picture[i, j, k] = np.uint8(ground + haze * (HORIZON[k] - ground))


@entry
def _draw(pictures, states, plane, field, corners, normals, colours, offsets):
    """See `draw`; `plane` and `field` as a surface has them, the others the car's and the ground's meshes."""
    n, rows, columns, _three = pictures.shape
    ground = lent(field)
    depths, lights = np.empty((rows, columns), np.float32), np.empty((rows, columns), np.float32)
    paints, maps = np.empty((rows, columns), np.int32), np.empty((CELLS, CELLS), np.float32)
    map_lights, map_paints = np.empty((CELLS, CELLS), np.float32), np.empty((CELLS, CELLS), np.int32)
    grid = np.empty((offsets.shape[0] ** 2, 4))
    depth, light, paint, map_ = borrowed(depths), borrowed(lights), borrowed(paints), borrowed(maps)
    map_light, map_paint, nodes = borrowed(map_lights), borrowed(map_paints), borrowed(grid)
    size, middle = 0.5 * rows / SLOPE_OF_VIEW, (0.5 * columns, 0.5 * rows)
    far = 1.0 / sqrt(EYE[0] * EYE[0] + EYE[1] * EYE[1] + EYE[2] * EYE[2])
    ahead = scale(-far, EYE)
    level = 1.0 / sqrt(ahead[0] * ahead[0] + ahead[1] * ahead[1])
    right = (ahead[1] * level, -ahead[0] * level, 0.0)
    axes = (right, cross(right, ahead), ahead)
    across = 1.0 / sqrt(LIGHT[0] * LIGHT[0] + LIGHT[1] * LIGHT[1])
    e1 = (-LIGHT[1] * across, LIGHT[0] * across, 0.0)
    e2 = cross(LIGHT, e1)
    for i in range(n):
        row = states[i]
        rotation = matrix((row[r.MOTION + 3], row[r.MOTION + 4], row[r.MOTION + 5], row[r.MOTION + 6]))
        offset = to_world(rotation, vec(row, r.OFFSET))
        x = axpy(-1.0, offset, vec(row, r.MOTION))
        if field is None:
            h = (plane[9] - plane[0] * x[0] - plane[1] * x[1]) / plane[2]
        else:
            h = height_of(ground, x[0], x[1])[0]
        view = ((x[0] + EYE[0], x[1] + EYE[1], h + OVER + EYE[2]), axes, size, middle)
        at = (x, rotation)
        depth[:], paint[:], map_[:] = 0.0, SKY_SEEN, 0.0
        _put_ground(depth, light, paint, view, plane, ground, x, offsets, nodes)
        _put_car(depth, light, paint, view, at, corners, normals)
        _cast(map_, map_light, map_paint, at, e1, e2, corners)
        _colour(depth, light, paint, view, at, e1, e2, map_, colours, pictures[i])
    keep_alive(depths, lights, paints, maps, map_lights, map_paints, grid)
