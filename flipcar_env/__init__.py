"""FlipCar: a Gymnasium environment in which a flipped rally car is rocked back onto its wheels."""

from gymnasium.envs.registration import register, registry

from .env import FlipCarEnv
from .policy import load_policy

__version__ = "0.1.0"
__all__ = ["FlipCarEnv", "load_policy"]

if "FlipCar-v0" not in registry:
    # The environment itself refuses a step before the first reset.
    register(id="FlipCar-v0", entry_point="flipcar_env.env:FlipCarEnv", order_enforce=False)
