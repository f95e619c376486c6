"""Measured impacts of an ellipse."""

import os
import pathlib

import numpy as np
import pytest

from solver.chart import ellipses

DATA = pathlib.Path(os.environ.get("FLIPCAR_DATA") or "missing") / "ellipse_impacts.npz"
needs_data = pytest.mark.skipif(
    not DATA.is_file(), reason="the data set is not here; set FLIPCAR_DATA to its folder"
)


def impacts(n=20, seed=0):
    """Random impacts on a level board, nothing known of what comes after."""
    rng = np.random.default_rng(seed)
    a, b, m = 0.035, 0.025, 0.0364
    before = np.column_stack([rng.uniform(-1.5, 1.5, n), rng.uniform(-3, -2, n), rng.normal(0, 6, n)])
    data = ellipses.Impacts(
        x=rng.uniform(0.3, 0.45, n), theta=rng.uniform(-3, 3, n), before=before, after=before,
        jac_n=np.zeros((n, 3)), jac_t=np.zeros((n, 3)), inertia=np.array([m, m, 0.25 * m * (a**2 + b**2)]),
        semi_axes=np.array([a, b]),
    )  # fmt: skip
    return data.fresh()


def stepped(K, mu, e, u, steps=200_000):
    """Eq. 12 in a plane by many small steps of p_n: p_n and p_t."""
    nn, nt, tt = K
    dp = -4.0 * u[0] / nn / steps
    p_t, stored, p_n = 0.0, 0.0, 0.0
    u_n, u_t = u
    while True:
        hold = -nt / tt  # friction that keeps u_t as it is
        stops = -(u_t + nt * dp) / (tt * dp)  # friction that would stop it within this step
        ratio = stops if abs(stops) <= mu else -mu * np.sign(u_t if abs(u_t) > 1e-12 else -hold)
        after_n, after_t = u_n + (nn + nt * ratio) * dp, u_t + (nt + tt * ratio) * dp
        work = -0.5 * (u_n + after_n) * dp
        stored += e * e * work if work > 0 else work
        if stored < 0:
            return p_n, p_t
        u_n, u_t, p_n, p_t = after_n, after_t, p_n + dp, p_t + ratio * dp


def test_an_impact_is_the_path_taken_in_small_steps():
    data = impacts(8)
    N, t, inertia = data.jac_n, data.jac_t, data.inertia
    K = np.column_stack([(N * N / inertia).sum(1), (N * t / inertia).sum(1), (t * t / inertia).sum(1)])
    u = np.column_stack([(N * data.before).sum(1), (t * data.before).sum(1)])
    p = ellipses.impulses(K, 0.2, np.full(8, 0.5), u)
    for k in range(8):
        np.testing.assert_allclose(p[k], stepped(K[k], 0.2, 0.5, u[k], 20_000), rtol=2e-3, atol=2e-5)


def test_outcomes_of_the_model_are_met_exactly_and_others_by_their_distance():
    data = impacts()
    after = ellipses.predicted(data, ellipses.MODEL)
    met = ellipses.replace(data, after=after)
    np.testing.assert_allclose(met.error(ellipses.predicted(met, ellipses.MODEL)), 0.0, atol=1e-10)
    np.testing.assert_allclose(met.error(1.1 * after), 10.0, rtol=1e-12)
    plain = ellipses.replace(data, after=ellipses.predicted(data, ellipses.PLAIN))
    np.testing.assert_allclose(plain.error(ellipses.best_impulse(plain)[1]), 0.0, atol=1e-8)


def test_a_tilted_board_is_a_turned_world():
    """Turned with its board, an impact is the same impact."""
    data, angle = impacts(), 0.3
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])  # of (vx, vy, ω)
    model = ellipses.Model(0.3, 0.5)
    turned = ellipses.replace(
        data, before=data.before @ turn.T,
        jac_n=(c * data.jac_n - s * data.jac_t) @ np.diag([1, 1, 0]) + data.jac_n * (0, 0, 1),
        jac_t=(c * data.jac_t + s * data.jac_n) @ np.diag([1, 1, 0]) + data.jac_t * (0, 0, 1),
    )  # fmt: skip
    expected = ellipses.predicted(data, model) @ turn.T
    np.testing.assert_allclose(ellipses.predicted(turned, model), expected, atol=1e-12)
    N, t = ellipses.frame(data, angle)
    np.testing.assert_allclose(N[:, :2], np.tile([-s, c], (len(N), 1)), atol=1e-12)
    np.testing.assert_allclose(np.hypot(N[:, 2], t[:, 2]), np.hypot(data.jac_n[:, 2], data.jac_t[:, 2]))


@needs_data
def test_the_metric_is_the_literatures():
    data = ellipses.load(DATA)
    assert data.error(ellipses.predicted(data, ellipses.PLAIN)).mean() == pytest.approx(18.4, abs=0.1)
    assert data.error(ellipses.best_impulse(data)[1]).mean() == pytest.approx(7.0, abs=0.1)


@needs_data
def test_impacts_not_fitted_are_met():
    rest = ellipses.load(DATA).some(ellipses.JUDGED)
    assert rest.error(ellipses.predicted(rest, ellipses.MODEL)).mean() < 14.0


@needs_data
def test_the_study_has_a_line_for_each_term():
    rows = ellipses.study(DATA, quick=True)
    assert {f"without {term}" for term in ellipses.TERMS} <= {row["terms"] for row in rows}
    assert all(row["error_low"] <= row["error_mean"] <= row["error_high"] for row in rows)


def test_a_file_that_is_not_one_of_impacts_is_refused(tmp_path):
    np.savez(tmp_path / "x.npz", a=1)
    with pytest.raises(ValueError, match="is not a file of impacts"):
        ellipses.load(tmp_path / "x.npz")
