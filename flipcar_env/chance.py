"""Random numbers as a pure function of (key, episode, index): SplitMix64, counter-based.

So every environment of a batch has its own stream, whatever the batch, the order or the threads, and
the whole generator is two numbers in the environment's state.
"""

import math

import numpy as np

from solver.algebra import jit

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11, _32 = (np.uint64(n) for n in (30, 27, 31, 11, 32))


@jit
def _mix(z):
    """SplitMix64's finaliser (Steele, Lea & Flood, OOPSLA 2014): 64 bits to 64 well-stirred bits."""
    z = (z ^ (z >> _30)) * _MIX1
    z = (z ^ (z >> _27)) * _MIX2
    return z ^ (z >> _31)


@jit
def uniform(key_high, key_low, episode, index):
    """A number in [0, 1), 53 bits. The key comes as two 32-bit halves, exact as floats.

    So does the index: numba would compile the function anew for each whole number written out.
    """
    key = (np.uint64(key_high) << _32) | np.uint64(key_low)
    z = _mix(key + _GOLDEN)
    z = _mix(z + _GOLDEN * (np.uint64(episode) + np.uint64(1)))
    z = _mix(z + _GOLDEN * (np.uint64(index) + np.uint64(1)))
    return float(z >> _11) * (1.0 / 9007199254740992.0)


@jit
def between(low, high, key_high, key_low, episode, index):
    """A number in [low, high)."""
    return low + (high - low) * uniform(key_high, key_low, episode, index)


@jit
def normal(key_high, key_low, episode, index):
    """A standard normal number (Box-Muller); it uses up index and index + 1."""
    u = 1.0 - uniform(key_high, key_low, episode, index)
    angle = 2.0 * math.pi * uniform(key_high, key_low, episode, index + 1.0)
    return math.sqrt(-2.0 * math.log(u)) * math.cos(angle)
