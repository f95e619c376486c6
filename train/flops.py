"""What a processor could do, and what the kernels ask of it: floating-point operations."""

import time

import numpy as np
from numba import types

from solver import algebra, impulse, kick, project, stick, sweep
from solver.algebra import entry
from solver.contact import gyroscopic
from solver.flight import half_turn, turn
from solver.trace import LANES, flops, fma, traced

NUMBER = types.float64
TRUTH = types.boolean
VECTOR, QUATERNION, MATRIX = (types.UniTuple(NUMBER, n) for n in (3, 4, 9))
ROWS = types.Array(NUMBER, 2, "C")
ROW = types.intp


def spin() -> int:
    """Of a free spin, unsplit: Eq. 2 without torque."""
    e = flops(half_turn, VECTOR, VECTOR, TRUTH, VECTOR, NUMBER)
    return e + flops(turn, VECTOR, VECTOR, QUATERNION, VECTOR, VECTOR)


def flight() -> int:
    """Of a step in the air under a torque: drift, kick, drift."""
    move = flops(algebra.axpy, NUMBER, VECTOR, VECTOR)
    return 2 * (spin() + move) + 2 * move + flops(algebra.times, VECTOR, VECTOR)


def contact(n: int) -> int:
    """Of a step in which n contacts stick, over a plane, with every other point far enough."""
    view = flops(algebra.matrix, QUATERNION) + 3 * flops(algebra.to_body, MATRIX, VECTOR)
    seen = types.Tuple([MATRIX, VECTOR, types.UniTuple(VECTOR, 3), NUMBER])
    cone = types.UniTuple(NUMBER, 6)
    each = [
        (kick.again, ROWS, ROW, seen),
        (kick._guessed, ROWS, ROW, NUMBER, TRUTH, NUMBER, VECTOR, VECTOR, TRUTH, TRUTH),
        (kick._aimed, ROWS, ROW, VECTOR, TRUTH, types.none, seen, TRUTH, VECTOR, VECTOR, NUMBER, NUMBER),
        (stick._gathered, ROWS, ROW, TRUTH, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, cone),
        (stick._given, ROWS, ROW, NUMBER, TRUTH, TRUTH, VECTOR, VECTOR, VECTOR, VECTOR, TRUTH),
        (kick._worked, ROWS, ROW, TRUTH, VECTOR, VECTOR, NUMBER),
        (project._off, ROWS, ROW, TRUTH, VECTOR, NUMBER, NUMBER),
    ]
    once = [
        (sweep.spread, NUMBER, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR),
        (gyroscopic, VECTOR, VECTOR, VECTOR),
        (stick._answers, NUMBER, NUMBER, NUMBER, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, cone),
        (sweep.spread, NUMBER, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR),
        (impulse.reach, NUMBER, VECTOR, VECTOR, NUMBER),
        (impulse.reach, NUMBER, VECTOR, VECTOR, NUMBER),
    ]
    return flight() + 2 * view + n * sum(flops(*one) for one in each) + sum(flops(*one) for one in once)


CHAINS = 10
"""More independent sums than a processor takes to begin a second operation on the first."""


@traced
def _sums(numbers, sums):
    """Eight times a b + c for every sum."""
    for _ in range(8):
        sums = tuple(fma(one, numbers[0], numbers[1]) for one in sums)
    return sums


@traced
def _taken(numbers):
    """CHAINS numbers of each lane."""
    return tuple(numbers[k] for k in range(CHAINS))


@traced
def _given(numbers, sums):
    """The inverse."""
    for k, one in enumerate(sums):
        numbers[k] = one


@entry
def _work(factors, numbers, n):
    """So many rounds of sums."""
    sums = _taken(numbers)
    for _ in range(n):
        sums = _sums(_taken(factors), sums)
    _given(numbers, sums)


def peak(rounds: int = 20_000) -> float:
    """Floating-point operations a second of one core, in float64: multiplications and additions in one."""
    factors, numbers = np.full((CHAINS, LANES), 0.5), np.zeros((CHAINS, LANES))
    _work(factors, numbers, 1)
    before = time.perf_counter()
    _work(factors, numbers, rounds)
    return rounds * 8 * CHAINS * LANES * 2 / (time.perf_counter() - before)
