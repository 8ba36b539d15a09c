import numpy as np

from isogal.earth.ellipsoid import metres_per_radian
from isogal.paper.cases import Plan, Setting
from isogal.paper.lookups import PROFILE_WINDOW, profile_example, window_example
from isogal.paper.published import FIGURE_54_READING_SIGMA


def plan(two_maps):
    return Plan(2, str(two_maps), 1200.0)


def test_profile_has_its_candidates_where_the_map_has_the_reading(two_maps):
    example = profile_example(plan(two_maps))
    assert len(example.candidates) >= 2
    there = np.interp(example.candidates, example.offset, example.profile)
    np.testing.assert_allclose(there, example.reading, atol=1e-9)
    assert (np.abs(example.candidates - example.centre) <= PROFILE_WINDOW).all()
    assert (
        0.1 < example.ambiguous < 0.5
    )  # the waves to the east are 19 km long, the window is 8 km wide


def test_window_holds_fifty_candidates(two_maps):
    example = window_example(plan(two_maps))
    assert len(example.candidates) == len(example.weight) == 50
    assert np.abs(example.candidates).max() <= 2500.0
    assert abs(example.weight.sum() - 1.0) < 1e-12
    np.testing.assert_allclose(example.combined, example.weight @ example.candidates)


def test_candidates_read_what_was_read(two_maps):
    field_map = plan(two_maps).field_map(Setting())
    example = window_example(plan(two_maps))
    north, east = metres_per_radian(example.latitude)
    values = field_map.value(
        example.latitude + example.candidates[:, 0] / north,
        example.longitude + example.candidates[:, 1] / east,
    )
    assert np.abs(values - example.reading).max() < 10 * FIGURE_54_READING_SIGMA
    at_truth = field_map.value(
        example.latitude + example.truth[0] / north, example.longitude + example.truth[1] / east
    )
    assert abs(at_truth - example.reading) < 4 * FIGURE_54_READING_SIGMA
