"""The model ladder: leaner scenes, the least model of given rows, the figure."""

import numpy as np
import pytest

from flipcar_env import car
from solver import HeightField, Plane
from solver.chart import ladder, ladder_plot
from solver.rotation import to_matrix

CASES = {case.name: case for case in ladder.cases(car.body())}


def row(scene, left, error, cost, said="in"):
    return {
        "scene": scene, "term": left, "in_explain": said, "error_model": str(error), "error": str(error),
        "ns_with": "200", "ns_without": str(cost),
    }  # fmt: skip


ROWS = [
    row("block", "nothing", 0, 200, "out"),
    row("block", "restitution", 0, 199, "out"),
    row("block", "rounding", 1e-6, 10),
    row("block", "friction", 0.5, 100),
    row("block", "sweep", 1e-3, 120),
    row("block", "restitution+centripetal", 1e-6, 186),
    row("block", "restitution+gyroscopic", 1e-6, 190),
    row("block", "restitution+gyroscopic+centripetal", 1e-6, 191),
    row("block", "restitution+gyroscopic+sweep", 2e-3, 90),
    row("block", "restitution+gyroscopic+sweep+friction", 0.5, 60),
    row("ball", "nothing", 0, 200, "out"),
]
REST = ("centripetal", "rounding", "curvature")


@pytest.mark.parametrize(
    ("error", "kept"),
    [
        (0.0, ("friction", "gyroscopic", "sweep", *REST)),
        (1e-5, ("friction", "sweep", "rounding", "curvature")),
        (1e-2, ("friction", *REST)),
        (1.0, REST),
    ],
)
def test_the_least_model_is_the_cheapest_that_is_good_enough(error, kept):
    found = ladder.least(ROWS, error)
    assert found["ball"] == ladder.TERMS
    # what is zero is left out even where the clock would have it otherwise
    assert set(found["block"]) == set(kept)


@pytest.mark.parametrize("name", CASES)
def test_a_sharp_body_touches_where_the_round_one_does(name):
    case = CASES[name]
    lean = ladder.sharp(case)
    assert not lean.body.radius.any()
    np.testing.assert_allclose(lean.gap(case.start), case.scene.gap(case.start), atol=1e-12)
    np.testing.assert_array_equal(lean.body.J, case.scene.body.J)


@pytest.mark.parametrize("name", CASES)
def test_flattened_ground_is_the_tangent_plane_under_the_lowest_point(name):
    case = CASES[name]
    lean = ladder.flattened(case)
    if not isinstance(case.scene.surface, HeightField):
        assert lean is case.scene
        return
    assert isinstance(lean.surface, Plane)
    k = case.scene.gap(case.start)[0].argmin()
    point = case.start.x[0] + to_matrix(case.start.quat[0]) @ case.scene.body.hull[k]
    for along in 1e-3 * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]):
        curved, flat = (scene.surface.distance(point + along) for scene in (case.scene, lean))
        assert flat == pytest.approx(curved, abs=3e-6)


def test_every_measurement_has_its_own_key():
    for quick in (True, False):
        keys = [key for key, _thunk in ladder.cells(quick, car.body())]
        assert len(set(keys)) == len(keys)
        scenes = {key.split("/")[0] for key in keys}
        assert scenes == set(ladder.QUICK if quick else CASES)
        terms = ("nothing", *(ladder.QUICK_TERMS if quick else ladder.TERMS))
        assert all(f"{scene}/{term}" in keys for scene in scenes for term in terms)


def test_the_figure_is_drawn_from_rows_of_text(tmp_path):
    files = ladder_plot.draw(ROWS, tmp_path / "ladder")
    assert [file.suffix for file in files] == [".svg", ".png"]
    assert all(file.stat().st_size > 5000 for file in files)
