"""FlipCar: a Gymnasium environment in which a flipped rally car is rocked back onto its wheels."""

from gymnasium.envs.registration import register, registry

from .check import check_vec_env
from .env import FlipCarEnv
from .policy import load_policy

__version__ = "0.1.0"
__all__ = ["FlipCarEnv", "check_vec_env", "load_policy"]

if "FlipCar-v0" not in registry:
    # What the wrappers left out would check on each step, the environment or its tests do.
    register(
        id="FlipCar-v0",
        entry_point="flipcar_env.env:FlipCarEnv",
        vector_entry_point="flipcar_env.vector:FlipCarVectorEnv",
        order_enforce=False,
        disable_env_checker=True,
    )
