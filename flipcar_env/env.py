"""The Gymnasium environment: the batch of one."""

from typing import Any

import gymnasium as gym
import numpy as np

from solver.errors import one_of

from .core import Core, whole
from .row import FAILED, REWARD, TERMINATED, TRUNCATED


class FlipCarEnv(gym.Env):
    """Recover a flipped rally car.

    ## Description
    A rally car (1230 kg, 4.4 m) has flipped over. A righting torque acts about its own axes, too weak
    to lift it over an edge of its roof from rest: it must be rocked, often the wrong way first,
    pumping energy through the contact with the ground. The ground is level unless `terrain` says
    otherwise, friction 0.8; the wheels are locked. Contacts are rigid impulses with Coulomb friction,
    stepped at 250 Hz.

    ## Action Space
    `Box(-1, 1, (3,), float32)`; values outside are clipped, non-finite ones refused.

    | Num | Action | Unit of 1 |
    |-----|--------|-----------|
    | 0 | torque about the car's x axis (roll) | 3100 N m |
    | 1 | torque about the car's y axis (pitch) | 3100 N m |
    | 2 | torque about the car's z axis (yaw) | 3100 N m |

    ## Observation Space
    `obs="egocentric"`: `Box((10,), float32)`, in the car's axes (x forward, y left, z up), clipped.

    | Num | Observation | Min | Max |
    |-----|-------------|-----|-----|
    | 0-2 | direction of gravity | -1 | 1 |
    | 3-5 | velocity of the centre of mass, m/s | -60 | 60 |
    | 6-8 | angular velocity, rad/s | -60 | 60 |
    | 9 | distance of the centre of mass from the ground, m | 0 | 150 |

    `obs="egocentric+action"`: `Box((13,), float32)`, the same and, as 10-12, the last action that was given
    (0 at a start). A car that is stuck looks the same at every step; one that knows what it has tried can
    try something else.

    `obs="state"`: `Box((13,), float32)`, in world axes.

    | Num | Observation | Min | Max |
    |-----|-------------|-----|-----|
    | 0-2 | centre of mass, m | -150 | 150 |
    | 3-6 | attitude, unit quaternion w, x, y, z, body to world | -1 | 1 |
    | 7-9 | velocity of the centre of mass, m/s | -60 | 60 |
    | 10-12 | angular velocity, rad/s | -60 | 60 |

    `obs="privileged"`: `Box((68,), float32)`, everything, for a critic or a teacher.

    | Num | Observation | Min | Max |
    |-----|-------------|-----|-----|
    | 0-12 | as "state" | | |
    | 13-22 | as "egocentric" | | |
    | 23-48 | 1 for each hull point in contact, in the order of `car.HULL` | 0 | 1 |
    | 49-52 | mass, inertia at the nominal mass: from the least that `randomize` draws to the most | -1 | 1 |
    | 53-55 | offset of the centre of mass, the same | -1 | 1 |
    | 56-60 | friction, restitution and torque limits, the same | -1 | 1 |
    | 61 | share of the time left | 0 | 1 |
    | 62-67 | the last two actions, the newest last | -1 | 1 |

    ## Rewards
    The sum of four terms, each in `info["reward_terms"]`:

    | Term | Value |
    |------|-------|
    | progress | 2 x the change of (1 + cos tilt)/2, a potential |
    | success | 5 once, when the episode ends upright |
    | time | -0.02 a step |
    | effort | -0.005 x the mean square of the action |

    ## Starting State
    `start`, or `reset(options={"start": ...})`:

    | Kind | Start | Share of "any" |
    |------|-------|----------------|
    | roof | settled on its roof, nudged by a small random spin | 40 % |
    | side | settled on its side, nudged | 20 % |
    | nose | on its nose or tail, let go near balance | 10 % |
    | drop | any attitude and spin, 0.2 to 1.5 m above the ground | 20 % |
    | upright | on its wheels, nudged | 10 % |
    | crash | barrel rolling sideways at 5 to 20 m/s | 0 |

    `reset(options={"state": array})` starts from what `get_state()` gave.

    Where the ground is not level, the car starts within 3 m of the origin in x and y, and is turned with the
    ground there; it may have to settle a little.

    With `randomize=True` each episode has a car of its own: mass and each moment of inertia +-15 %, the
    centre of mass moved by up to 8, 5 and 4 cm, friction 0.4 to 1, restitution 0 to 0.2 and each torque
    limit +-10 %.

    ## Terrain
    | Kind | Ground |
    |------|--------|
    | level | z = 0 |
    | slope | a plane that falls by 10° towards x |
    | bumpy | humps and hollows up to 15 cm up and down, 2.5 m apart |
    | ditch | 0.8 m deep along y, with banks of 13° at most |

    ## Episode End
    Terminated: success, that is within 15° of upright, carried by at least three wheels and nothing else,
    slower than 0.5 m/s and 0.5 rad/s, for half a second. Upright is against the vertical on any ground:
    none of them tilts a car that stands on its wheels by more than 13°. Truncated: after 10 s (the
    environment's own limit, part of its state), beyond 100 m, or if the solver gives up
    (`info["solver_error"]`; `info["solver_error_state"]` is the state before that step).

    ## Information
    `is_success` (bool), `time_to_upright` (s, once reached), `energy` (mechanical, J; 0 at rest with the
    centre of mass at z = 0), `work` (the actuator's integral of |torque · w|, J), `tilt` (rad),
    `n_contacts`, `reward_terms`.

    ## Arguments
    | Argument | Default | Meaning |
    |----------|---------|---------|
    | start | "any" | kind of start |
    | terrain | "level" | kind of ground |
    | randomize | False | a car of its own for each episode |
    | obs | "egocentric" | or "egocentric+action", "state", "privileged" |
    | control_dt | 0.04 | s between actions |
    | substeps | 10 | physics steps in each |
    | method | "impulse" | contact method |
    | action_delay | 0 | control steps from an action to its torque, up to 2 |
    | sensor_noise | 0 | of observations but "privileged"; 1 is that of `observe.SENSORS` |

    ## Version History
    * v0: initial version.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (Env declares it so)
        "render_modes": ["rgb_array", "rerun"],
        "render_fps": 25,
    }

    def __init__(
        self,
        start: str = "any",
        terrain: str = "level",
        randomize: bool = False,
        obs: str = "egocentric",
        render_mode: str | None = None,
        control_dt: float = 0.04,
        substeps: int = 10,
        method: str = "impulse",
        action_delay: int = 0,
        sensor_noise: float = 0.0,
    ):
        self.render_mode = check_render_mode(render_mode, self.metadata["render_modes"])
        self.core = Core(
            1, start, terrain, randomize, obs, control_dt, substeps, method, action_delay, sensor_noise
        )
        self.observation_space = self.core.observation_space
        self.action_space = self.core.action_space
        self._name_parts()
        self._started = False
        self._live: Any = None
        if self.render_mode == "rerun":
            from .recording import Live

            self._live = Live(self)

    def _name_parts(self) -> None:
        self._results = self.core.results[0]
        self._observed = self.core.observed[0]

    def __setstate__(self, values: dict[str, Any]) -> None:
        self.__dict__.update(values)
        self._name_parts()  # a pickled or copied view would be an array of its own

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Start an episode: the next of this environment's stream, or the first of a seed's.

        Args:
            seed: of the stream.
            options: {"start": kind} or {"state": array}.

        Raises:
            ValueError: seed or options are not what they must be; nothing has changed then.
        """
        seed = None if seed is None else whole("seed", seed, 0)
        options = options or {}
        for name in options:
            one_of("options", name, ("start", "state"))
        refuse_both(options)
        kinds = self.core.start_kinds(options["start"]) if "start" in options else None
        state = self.core.check_states(options["state"]) if "state" in options else None
        super().reset(seed=seed)
        if seed is not None or not self._started:
            self.core.seed(0, self.np_random_seed)
        self._started = True
        if state is None:
            self.core.begin(FIRST, kinds)
        else:
            self.core.put_states(state, FIRST)
        info = self.core.start_info(0)
        if self._live is not None:
            self._live.begin(info)
        return self._observed.copy(), info

    def step(self, action):
        """One control step. An action that is no three finite numbers is refused and changes nothing."""
        if not self._started:
            raise gym.error.ResetNeeded("call reset() before step()")
        self.core.step(self.core.take(action, SHAPE, "action"))
        results = self._results.tolist()
        info = self.core.info(0, results)
        if self._live is not None:
            self._live.go_on(info, action, results[REWARD])
        return (
            self._observed.copy(),
            results[REWARD],
            results[TERMINATED] != 0.0,
            results[TRUNCATED] != 0.0,
            info,
        )

    def close(self) -> None:
        """End the viewer, if there is one."""
        if self._live is not None:
            self._live.close()
            self._live = None

    def render(self) -> np.ndarray | None:
        """A picture of the car as it is now, (360, 480, 3) uint8; None unless asked for by `render_mode`."""
        if not self._started:
            raise gym.error.ResetNeeded("call reset() before render()")
        return self.core.pictures()[0] if self.render_mode == "rgb_array" else None

    def get_state(self) -> np.ndarray:
        """Everything that the future depends on, random stream and time included, as one array."""
        return self.core.states[0].copy()

    def set_state(self, state: np.ndarray) -> None:
        """Go on from what `get_state` gave.

        Raises:
            ValueError: it is not such an array; nothing has changed then.
        """
        self.core.put_states(self.core.check_states(state), FIRST)
        self._started = True

    def contact_impulses(self) -> np.ndarray:
        """(p, 3) impulse on each hull point over the last control step, world axes, N s.

        A step that was undone, as its state was no longer finite, has none.
        """
        if self._results[FAILED]:
            return np.zeros((self.core.points, 3))
        return self.core.push[:, :3].copy()


SHAPE = (3,)
"""Of an action."""

FIRST = np.zeros(1, np.int64)
"""The only environment's index."""


def refuse_both(options: dict[str, Any]) -> None:
    """A state is not of the kind of start that is asked for.

    Raises:
        ValueError: both are asked for.
    """
    if "start" in options and "state" in options:
        raise ValueError(f"options must have start or state, got both: start is {options['start']!r}")


def check_render_mode(render_mode: Any, known: list[str]) -> str | None:
    """The render mode, if there is such a one.

    Raises:
        ValueError: there is not.
    """
    return None if render_mode is None else one_of("render_mode", render_mode, known)
