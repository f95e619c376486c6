"""What a recording holds of an episode, entity by entity.

Every series is sent as columns, once per episode: step by step takes a hundred times as long. Each
function takes the root under which its entities stand: "" for one episode, another for each of several
that are shown side by side.
"""

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
import rerun as rr

from flipcar_env import car, terrain
from flipcar_env.car_mesh import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    VERMILION,
    YELLOW,
    Face,
    body_faces,
    wheel_faces,
)
from flipcar_env.episode import PHASES, Episode, hull_points, phases, touching
from solver.rotation import to_matrix

TIMELINE = "sim_time"

NEWTON_PER_METRE = 12_000.0
"""Length of a force arrow: the whole weight of the car on one point is about a metre long."""

TORQUE_PER_METRE = 2_500.0
"""Length of the torque's arrow."""

HOVER = 1.3
"""m over the centre of mass, where the torque's arrow begins: inside the car it would not be seen."""

FLASH = 0.35
"""m; radius of the flash of a blow of ten times the car's weight."""

FOCUS_HEIGHT = 0.5
"""m over the ground: what the camera looks at."""

LINE_COLOURS = (SKY, ORANGE, GREEN, PURPLE, YELLOW, VERMILION, GREY)

PHASE_COLOURS = dict(zip(PHASES, (SKY, VERMILION, GREEN, GREY, ORANGE, YELLOW, PURPLE), strict=True))

GROUND = (150, 140, 120, 70)
"""See-through, as arrows push from below."""

AROUND = 15.0
"""m of flat ground around the car's trail."""
NEARBY, CELL = 8.0, 0.25
"""m of curved ground around the trail, and between its vertices."""
LINE_GAP = 1.0
"""m between the lines of the grid."""
GRID, THIN = (40, 40, 40, 110), rr.Radius.ui_points(0.6)
"""The lines' colour and width."""

WEIGHT = car.MASS * 9.81


# --------------------------------------------------------------------------- what moves


def send_episode(
    stream: rr.RecordingStream, episode: Episode, start: float, title: str, root: str = ""
) -> None:
    """Send an episode.

    Args:
        stream: to send it to.
        episode: at least one row.
        start: of the episode on the timeline, s.
        title: in its status.
        root: of its entities.
    """
    seconds = start + episode.t - episode.t[0]
    send_ground(stream, episode, float(seconds[0]), root)
    send_trail(stream, episode, float(seconds[0]), root)
    send_rows(stream, episode, seconds, title, root)
    # An empty row after the last one, so that no line or phase leads from one episode to the next.
    after = [rr.TimeColumn(TIMELINE, duration=seconds[-1:] + 1e-3)]
    nothing = np.zeros(1, dtype=int)
    for entity in series(episode):
        stream.send_columns(
            f"{root}/{entity}", after, rr.Scalars.columns(scalars=np.zeros(0)).partition(nothing)
        )
    stream.send_columns(f"{root}/phase", after, rr.StateChange.columns(state=[""]))


def send_rows(
    stream: rr.RecordingStream, episode: Episode, seconds: np.ndarray, title: str, root: str = ""
) -> None:
    """Send the rows of an episode, at these times on the timeline."""
    time = [rr.TimeColumn(TIMELINE, duration=seconds)]

    def send(entity: str, columns: rr.ComponentColumnList) -> None:
        stream.send_columns(f"{root}/{entity}", time, columns)

    origin = car_origin(episode)
    send(
        "world/car", rr.Transform3D.columns(translation=origin, quaternion=np.roll(episode.quat, -1, axis=1))
    )
    # The camera follows the car over the ground, not its bobbing and rolling.
    focus = np.column_stack([episode.x[:, :2], height_below(episode) + FOCUS_HEIGHT])
    send("world/focus", rr.Transform3D.columns(translation=focus))

    touches = touching(episode)
    counts = touches.sum(axis=1)
    points, normals = (array[touches] for array in hull_points(episode))
    force = episode.force[touches]
    along_normal = (force * normals).sum(axis=1, keepdims=True) * normals
    # Partitions of length 0 clear the contacts of the step before. An arrow ends at its contact:
    # drawn from there, it would vanish inside the car.
    send("world/contacts/points", rr.Points3D.columns(positions=points).partition(counts))
    for name, part in (("normal", along_normal), ("friction", force - along_normal)):
        arrows = part / NEWTON_PER_METRE
        send(
            f"world/contacts/{name}",
            rr.Arrows3D.columns(vectors=arrows, origins=points - arrows).partition(counts),
        )
    strength = np.linalg.norm(force, axis=1) / WEIGHT
    struck = np.repeat([phase == "impact" for phase in phases(episode)], counts)
    flashes = np.array([n.sum() for n in np.split(struck, np.cumsum(counts)[:-1])], dtype=int)
    radii = FLASH * np.sqrt(strength[struck] / 10.0)
    send(
        "world/contacts/blows", rr.Points3D.columns(positions=points[struck], radii=radii).partition(flashes)
    )
    send("world/contacts/support", rr.LineStrips3D.columns(strips=_supports(points, counts)))

    push = np.einsum("tij,tj->ti", to_matrix(episode.quat), episode.torque) / TORQUE_PER_METRE
    send("world/torque", rr.Arrows3D.columns(vectors=push, origins=np.add(episode.x, (0.0, 0.0, HOVER))))

    for entity, values in series(episode).items():
        send(entity, rr.Scalars.columns(scalars=values))
    now = phases(episode)
    changes = [i for i, phase in enumerate(now) if i == 0 or phase != now[i - 1]]
    stream.send_columns(
        f"{root}/phase",
        [rr.TimeColumn(TIMELINE, duration=seconds[changes])],
        rr.StateChange.columns(state=[now[i] for i in changes]),
    )
    texts = _status(episode, now, counts, title)
    send("status", rr.TextDocument.columns(text=texts, media_type=["text/markdown"] * len(texts)))


def send_trail(stream: rr.RecordingStream, episode: Episode, start: float, root: str = "") -> None:
    """Send where the centre of mass goes, all at once."""
    at = [rr.TimeColumn(TIMELINE, duration=[start])]
    stream.send_columns(f"{root}/world/trail", at, rr.LineStrips3D.columns(strips=[episode.x]))


def series(episode: Episode) -> Mapping[str, np.ndarray]:
    """Entity to the values that its plot shows, (T,) each."""
    found = {
        "plots/upright": np.cos(episode.tilt),
        "plots/height": episode.x[:, 2] - height_below(episode),
        "plots/energy/mechanical": episode.energy / 1e3,
        "plots/energy/work": episode.work / 1e3,
        "plots/motion/speed": np.linalg.norm(episode.v, axis=1),
        "plots/motion/spin": np.linalg.norm(episode.w, axis=1),
    }
    for i, axis in enumerate(("roll", "pitch", "yaw")):
        found[f"plots/torque/{axis}"] = episode.torque[:, i] / 1e3
    for name, values in episode.reward_terms.items():
        found[f"plots/reward/{name}"] = values
    return found


def car_origin(episode: Episode) -> np.ndarray:
    """(T, 3) where the nominal car's centre of mass is: the drawn car's origin."""
    return episode.x - to_matrix(episode.quat) @ episode.offset


def height_below(episode: Episode) -> np.ndarray:
    """(T,) height of the ground below the centre of mass, m."""
    return terrain.surface(episode.terrain).heights(episode.x[:, 0], episode.x[:, 1])


def _supports(points: np.ndarray, counts: np.ndarray) -> list[np.ndarray]:
    """For each row a line around its contacts; of fewer than two none."""
    strips = []
    for some in np.split(points, np.cumsum(counts)[:-1]):
        if len(some) < 2:
            strips.append(np.zeros((0, 3)))
            continue
        away = some[:, :2] - some[:, :2].mean(axis=0)
        order = np.argsort(np.arctan2(away[:, 1], away[:, 0]))
        strips.append(some[np.append(order, order[0])])
    return strips


def _status(episode: Episode, now: list[str], counts: np.ndarray, title: str) -> list[str]:
    head = f"**{episode.start}** start, {episode.terrain}, policy **{episode.policy}**, {title}"
    if episode.is_success:
        verdict = f"**Recovered** in {episode.time_to_upright:.2f} s"
    else:
        verdict = "**Not recovered**"
    verdicts = ["Running"] * (len(episode.t) - 1) + [verdict]
    rows = zip(episode.t, now, np.degrees(episode.tilt), counts, verdicts, strict=True)
    return [
        f"{head}\n\n{t:.2f} s: **{phase}**, tilt {tilt:.0f}°, contacts: {count}. {verdict}"
        for t, phase, tilt, count, verdict in rows
    ]


# --------------------------------------------------------------------------- what stands still


def send_static(
    stream: rr.RecordingStream, reward_terms: Sequence[str], root: str = "", label: str = ""
) -> None:
    """Send what does not change: the car's looks, and those of lines, points and plots.

    Args:
        stream: to send it to.
        reward_terms: their names.
        root: of the entities.
        label: in front of what plots are called.
    """

    def log(entity: str, archetype: rr.AsComponents) -> None:
        stream.log(f"{root}/{entity}", archetype, static=True)

    log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    body, wheels = car_meshes()
    log("world/car/body", body)
    log("world/car/wheels", wheels)
    log("world/focus", rr.Points3D([(0.0, 0.0, 0.0)], radii=1e-4))  # it must have a size
    log("world/trail", rr.LineStrips3D.from_fields(colors=PURPLE, radii=0.012))
    log("world/grid", rr.LineStrips3D.from_fields(colors=GRID, radii=THIN))
    log("world/contacts/points", rr.Points3D.from_fields(colors=RED, radii=0.05))
    log("world/contacts/normal", rr.Arrows3D.from_fields(colors=RED, radii=0.04))
    log("world/contacts/friction", rr.Arrows3D.from_fields(colors=ORANGE, radii=0.03))
    log("world/contacts/blows", rr.Points3D.from_fields(colors=(*YELLOW, 150)))
    log("world/contacts/support", rr.LineStrips3D.from_fields(colors=BLUE, radii=0.02))
    log("world/torque", rr.Arrows3D.from_fields(colors=PURPLE, radii=0.03))
    log(
        "phase",
        rr.StateConfiguration(values=list(PHASE_COLOURS), colors=list(PHASE_COLOURS.values())),
    )
    lines = {
        "upright": ("uprightness", GREEN),
        "height": ("height, m", SKY),
        "energy/mechanical": ("mechanical", SKY),
        "energy/work": ("work of the torque", ORANGE),
        "motion/speed": ("speed, m/s", SKY),
        "motion/spin": ("spin, rad/s", ORANGE),
        "torque/roll": ("roll", SKY),
        "torque/pitch": ("pitch", ORANGE),
        "torque/yaw": ("yaw", GREEN),
    }
    for i, name in enumerate(reward_terms):
        lines[f"reward/{name}"] = (name, LINE_COLOURS[i % len(LINE_COLOURS)])
    for entity, (name, colour) in lines.items():
        log(f"plots/{entity}", rr.SeriesLines(names=f"{label}{name}", colors=colour, widths=2.0))


def send_ground(stream: rr.RecordingStream, episode: Episode, start: float, root: str = "") -> None:
    """Send the ground's true shape around an episode's trail, and a grid of lines on it, from a time on."""
    margin = AROUND if terrain.surface(episode.terrain).field is None else NEARBY
    low, high = episode.x[:, :2].min(axis=0) - margin, episode.x[:, :2].max(axis=0) + margin
    spots, lines = _ground(episode.terrain, np.floor(low), np.ceil(high))
    stream.set_time(TIMELINE, duration=start)
    stream.log(f"{root}/world/ground", _sheet(spots))
    stream.log(f"{root}/world/grid", rr.LineStrips3D.from_fields(strips=lines))
    stream.reset_time()


def send_patch(
    stream: rr.RecordingStream, episode: Episode, place: np.ndarray, half: float, entity: str
) -> None:
    """Send a square of ground around where a car starts, moved by `place`."""
    middle = np.round(episode.x[0, :2])
    spots, lines = _ground(episode.terrain, middle - half, middle + half)
    stream.log(entity, _sheet(spots + place), static=True)
    strips = rr.LineStrips3D([line + place for line in lines], colors=GRID, radii=THIN)
    stream.log(f"{entity}/grid", strips, static=True)


def _ground(kind: str, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """(a, b, 3) points of a rectangle of ground, and lines over it."""
    surface = terrain.surface(kind)
    gap = LINE_GAP if surface.field is None else CELL
    x, y = (np.arange(a, b + 0.5 * gap, gap) for a, b in zip(low, high, strict=True))
    at = np.stack(np.meshgrid(x, y, indexing="ij"), axis=2)
    spots = np.dstack([at, surface.heights(at[..., 0], at[..., 1])])
    every = round(LINE_GAP / gap)
    lines = [*spots[::every], *spots.transpose(1, 0, 2)[::every]]
    # Lines keep their points, as the viewer takes their width from the nearest one.
    return spots if surface.field is not None else spots[:: len(x) - 1, :: len(y) - 1], lines


def _sheet(spots: np.ndarray) -> rr.Mesh3D:
    """A mesh through (a, b, 3) points."""
    a, b, _ = spots.shape
    first = (np.arange(a - 1)[:, None] * b + np.arange(b - 1)).ravel()
    triangles = first[:, None, None] + np.array([(0, b, b + 1), (0, b + 1, 1)])
    return rr.Mesh3D(
        vertex_positions=spots.reshape(-1, 3),
        triangle_indices=triangles.reshape(-1, 3),
        albedo_factor=GROUND,
    )


@cache
def car_meshes() -> tuple[rr.Mesh3D, rr.Mesh3D]:
    """The car's body and its wheels."""
    return _mesh(body_faces()), _mesh(wheel_faces())


def _mesh(faces: Sequence[Face]) -> rr.Mesh3D:
    """Flat-shaded faces: each has its own corners, and one normal for all four."""
    corners = np.array([corners for corners, _ in faces])  # (n, 4, 3)
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    first = 4 * np.arange(len(faces))[:, None, None]
    triangles = first + np.array([(0, 1, 2), (0, 2, 3)])  # (n, 2, 3)
    return rr.Mesh3D(
        vertex_positions=corners.reshape(-1, 3) - [0.0, 0.0, car.CENTRE_OF_MASS_HEIGHT],
        vertex_normals=np.repeat(normals, 4, axis=0),
        vertex_colors=np.repeat([colour for _, colour in faces], 4, axis=0).astype(np.uint8),
        triangle_indices=triangles.reshape(-1, 3),
    )
