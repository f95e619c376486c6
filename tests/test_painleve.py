"""From which friction on Painlevé's paradox can occur: closed forms, and no normal that gives less."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import random_body

from solver import Body
from solver.painleve import critical_friction


def least(body, k, normals):
    """min N·K N/|K_t N| over some normals (n, 3), K as it stands (Eq. 10)."""
    found = np.inf
    for N in normals:
        x, y, z = body.hull[k] - body.radius[k] * N
        Q = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        KN = (np.eye(3) / body.m - Q @ np.linalg.inv(body.J) @ Q) @ N
        found = min(found, N @ KN / max(np.linalg.norm(KN - (N @ KN) * N), 1e-300))
    return found


def test_a_rod_needs_four_thirds():
    np.testing.assert_allclose(critical_friction(Body.rod(2.0, 0.7)), 4 / 3, rtol=1e-14)


def test_a_sphere_is_safe():
    assert critical_friction(Body.sphere(1.0, 0.1))[0] == np.inf


def test_a_point_under_the_centre_of_a_round_body():
    """J = j: K's eigenvalues are 1/m and 1/m + b²/j, so κ = 1 + m b²/j."""
    kappa = 1 + 2.0 * 0.3**2 / 0.05
    found = critical_friction(Body(2.0, np.full(3, 0.05), [(0, 0, -0.3)]))[0]
    assert found == pytest.approx(2 * np.sqrt(kappa) / (kappa - 1), rel=1e-13)


def test_a_small_radius_is_nearly_none():
    """The search for round points meets the closed form of sharp ones."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        body = random_body(rng)
        sharp, blunt = (critical_friction(Body(body.m, body.J, body.hull, rho))[0] for rho in (0.0, 1e-13))
        assert blunt == pytest.approx(sharp, rel=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_no_normal_gives_less(seed):
    rng = np.random.default_rng(seed)
    body = random_body(rng)
    body = Body(body.m, body.J, body.hull, radius=rng.choice([0.0, 0.03, 0.3, 3.0]))
    critical = critical_friction(body)[0]
    N = rng.normal(size=(1000, 3))
    found = least(body, 0, N / np.linalg.norm(N, axis=1, keepdims=True))
    assert critical <= found * (1 + 1e-12)
    assert critical >= 0.5 * found  # nor is it much too cautious
