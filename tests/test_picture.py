"""Pictures: by their structure, not by their pixels."""

import gymnasium as gym
import numpy as np
import pytest

from flipcar_env import car, picture, terrain
from flipcar_env import row as r
from flipcar_env.core import Core
from flipcar_env.env import FlipCarEnv
from flipcar_env.sb3 import FlipCarVecEnv
from solver.rotation import to_matrix

KINDS = ("roof", "side", "nose", "drop", "crash", "upright")


def begun(kind: str) -> Core:
    core = Core(len(KINDS), start=KINDS, terrain=kind, randomize=True)
    for i in range(core.n):
        core.seed(i, i)
    core.begin(np.arange(core.n))
    return core


def on_picture(state: np.ndarray, points: np.ndarray, ground: float) -> np.ndarray:
    """(p, 2) columns and rows of points in the world: a camera of our own, in plain linear algebra."""
    origin = state[:3] - to_matrix(state[3:7]) @ state[r.OFFSET : r.OFFSET + 3]
    target = np.array([origin[0], origin[1], ground + picture.OVER])
    ahead = -np.array(picture.EYE) / np.linalg.norm(picture.EYE)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    view = np.stack([right, np.cross(right, ahead), ahead])
    x, y, far = view @ (points - target - picture.EYE).T
    size = 0.5 * picture.HEIGHT / picture.SLOPE_OF_VIEW
    return np.stack([0.5 * picture.WIDTH + size * x / far, 0.5 * picture.HEIGHT - size * y / far], axis=1)


def silhouette(image: np.ndarray, state: np.ndarray, surface) -> np.ndarray:
    """Where another colour is seen than without the car: its shadow only darkens."""
    away = state.copy()
    away[2] += 60.0
    with_car, without = image / 255.0, picture.draw(away[None], surface)[0] / 255.0
    ratio = with_car / np.maximum(0.02, without)
    return ratio.max(axis=2) - ratio.min(axis=2) > 0.04


def blue(image: np.ndarray) -> np.ndarray:
    """Where the car's body is seen: no ground and no sky is so blue."""
    red, _green, blue = image.astype(int).transpose(2, 0, 1)
    return blue > 3 * red + 20


@pytest.mark.parametrize("kind", terrain.KINDS)
def test_the_car_is_where_it_is(kind):
    core = begun(kind)
    surface = terrain.surface(kind)
    for state, image in zip(core.states, core.pictures(), strict=True):
        hull = np.array(list(car.HULL.values()))[:, :3] - state[r.OFFSET : r.OFFSET + 3]
        rotation = to_matrix(state[3:7])
        origin = state[:3] - rotation @ state[r.OFFSET : r.OFFSET + 3]
        spots = on_picture(state, state[:3] + hull @ rotation.T, float(surface.heights(*origin[:2])))
        rows, columns = np.nonzero(silhouette(image, state, surface))
        assert len(rows) > 4000
        seen = np.array([columns.min(), rows.min(), columns.max(), rows.max()])
        low, high = spots.min(axis=0), spots.max(axis=0)
        beyond = 6  # pixels: a tyre's radius, and 3 cm by which the drawing stands out
        assert (seen[:2] >= np.maximum(low, 0) - beyond).all()
        assert (seen[2:] <= high + beyond).all()
        size = np.minimum(high, [picture.WIDTH, picture.HEIGHT]) - np.maximum(low, 0)
        assert (seen[2:] - seen[:2] > 0.93 * size).all()


def test_what_is_nearer_hides_what_is_farther():
    """A car below the ground, or behind the camera, is not seen; on its roof the roof is below."""
    core = begun("level")
    state = core.states[5].copy()
    image = picture.draw(state[None], terrain.surface("level"))[0]
    buried = state.copy()
    buried[2] -= 3.0
    assert blue(image).sum() > 2000
    assert not blue(picture.draw(buried[None], terrain.surface("level"))[0]).any()
    over = core.states[0].copy()
    flipped = picture.draw(over[None], terrain.surface("level"))[0]
    down = []
    for one in (image, flipped):
        orange = (one[..., 0] > 130) & (one[..., 2] < 40)  # bonnet, roof and wing
        down.append(np.nonzero(orange)[0].mean() - np.nonzero(blue(one))[0].mean())
    assert down[0] < -5.0 < 5.0 < down[1]


def test_the_ground_shows_its_shape_its_tiles_and_the_cars_shadow():
    images = {kind: begun(kind).pictures()[5] for kind in terrain.KINDS}
    for kind, image in images.items():
        ground = image[300:, :80].reshape(-1, 3).astype(int)
        assert len(np.unique(ground.sum(axis=1) // 12)) > 1, "tiles"
        assert kind == "level" or np.abs(image.astype(int) - images["level"]).mean() > 1.0
    sky = images["level"][0, 0].astype(int)
    assert sky[2] > sky[0] + 20
    state = begun("level").states[5].copy()
    high = state.copy()
    high[2] += 60.0  # out of sight, and so is its shadow
    near, without = picture.draw(np.stack([state, high]), terrain.surface("level")).astype(int)
    ratio = near.sum(axis=2) / np.maximum(1, without.sum(axis=2))
    assert np.isclose(ratio, picture.SHADOW, atol=0.03).sum() > 1000
    assert (ratio > 0.995).mean() > 0.7


def test_pictures_read_only_and_are_the_same_alone_and_in_any_batch():
    single = [FlipCarEnv(start=kind, render_mode="rgb_array") for kind in KINDS]
    terrains = ["level", "ditch"] * 3
    envs = gym.make_vec(
        "FlipCar-v0", num_envs=6, vectorization_mode="vector_entry_point", start=KINDS, terrain=terrains,
        render_mode="rgb_array",
    )  # fmt: skip
    cars = FlipCarVecEnv(6, start=KINDS, terrain=terrains, render_mode="rgb_array", stagger=False)
    envs.reset(seed=3)
    cars.seed(3)
    cars.reset()
    before = envs.get_state()
    frames = envs.render()
    np.testing.assert_array_equal(envs.get_state(), before)
    for i, (frame, image) in enumerate(zip(frames, cars.get_images(), strict=True)):
        assert frame.shape == (picture.HEIGHT, picture.WIDTH, 3)
        assert frame.dtype == np.uint8
        np.testing.assert_array_equal(frame, image)
        env = FlipCarEnv(start=KINDS[i], terrain=terrains[i], render_mode="rgb_array")
        env.reset(seed=3 + i)
        np.testing.assert_array_equal(env.render(), frame)
    assert single[0].metadata["render_fps"] == 25


def test_rendering_before_a_reset_and_without_a_mode():
    env = gym.make("FlipCar-v0", render_mode="rgb_array").unwrapped
    with pytest.raises(gym.error.ResetNeeded):
        env.render()
    envs = gym.make_vec("FlipCar-v0", num_envs=2, vectorization_mode="vector_entry_point")
    with pytest.raises(ValueError, match="reset"):
        envs.render()
    envs.reset()
    assert envs.render() is None
    assert FlipCarVecEnv(2).get_images() == [None, None]
    with pytest.raises(ValueError, match="render_mode"):
        FlipCarVecEnv(2, render_mode="rerun")


def test_gymnasium_renders_for_humans_and_films_by_itself():
    """Both of its wrappers take the pictures; what they show them with need not be installed."""
    from gymnasium.wrappers import AddRenderObservation, RenderCollection

    env = RenderCollection(gym.make("FlipCar-v0", start="roof", render_mode="rgb_array"))
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.ones(3, np.float32))
    frames = env.render()
    assert len(frames) == 4
    assert not np.array_equal(frames[0], frames[-1])
    pixels = AddRenderObservation(gym.make("FlipCar-v0", render_mode="rgb_array"), render_only=True)
    obs, _ = pixels.reset(seed=0)
    assert pixels.observation_space.contains(obs)
