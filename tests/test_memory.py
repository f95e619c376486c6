"""What is borrowed of an array outlives nothing."""

import ast
from pathlib import Path

import numpy as np

import flipcar_env
import solver
from solver.algebra import borrowed, entry, keep_alive

BIG = 1 << 22
"""So many numbers are given back to the system as soon as they are freed."""


def _called(node: ast.AST, name: str) -> list[ast.Call]:
    calls = [one for one in ast.walk(node) if isinstance(one, ast.Call)]
    return [one for one in calls if isinstance(one.func, ast.Name) and one.func.id == name]


def test_every_array_of_a_kernels_own_is_held_to_its_end():
    """Numba frees a variable after its last use, in mid-loop if need be: its view would read freed memory."""
    found = 0
    for package in (solver, flipcar_env):
        for file in Path(package.__file__).parent.rglob("*.py"):
            for function in ast.walk(ast.parse(file.read_text())):
                if not isinstance(function, ast.FunctionDef):
                    continue
                given = {argument.arg for argument in function.args.args}
                lent = {
                    call.args[0].id
                    for call in _called(function, "borrowed")
                    if isinstance(call.args[0], ast.Name) and call.args[0].id not in given
                }
                kept = {name.id for call in _called(function, "keep_alive") for name in call.args}
                assert lent <= kept, f"{file.name}, {function.name}: {lent - kept}"
                for call in _called(function, "keep_alive"):
                    after = [one for one in ast.walk(function) if isinstance(one, ast.Name)]
                    later = [one.id for one in after if one.lineno > call.end_lineno]
                    assert len(later) <= 1, f"{file.name}, {function.name}: used after `keep_alive`: {later}"
                found += len(lent)
    assert found > 20


@entry
def _lends(n):
    own = np.zeros(n)
    view = borrowed(own)
    total = 0.0
    for i in range(n):
        view[i] = i
        total += view[i]
    keep_alive(own)
    return total


def test_a_big_array_that_is_lent_out_is_there_until_it_is_held():
    """Without `keep_alive` the process dies here."""
    assert _lends(BIG) == BIG * (BIG - 1) / 2
