"""Fixes that say less than the prior, or contradict it, are declined; what they tell of the place
together with the prior is kept."""

import numpy as np
import pytest

from helpers.batches import ORIGIN
from helpers.tracks import field_of, made_track
from isogal.earth.ellipsoid import metres_per_radian
from isogal.matching.interfaces import Fix
from isogal.scenario import Matcher
from isogal.tracks.informative import wider_than
from isogal.tracks.matching import Uncertainty, match_track
from isogal.tracks.results import as_objects

DISTURBANCE = field_of("disturbance")
TRACK, *_ = made_track(DISTURBANCE, count=90)
PRIOR = Uncertainty(position=1000.0)
NORTH = metres_per_radian(ORIGIN[0])[0]


class Says:
    """A matcher that finds the vehicle some metres north of where the track is, with 1-sigmas
    north and east."""

    name, context = "says", 0

    def __init__(self, *each):
        self.each = each

    def match(self, batch, field_map, memory):
        north, *sigma = self.each[0 if memory is None else memory]
        latitude, longitude = batch.end
        covariance = np.diag(np.square(sigma))
        place = latitude + north / metres_per_radian(latitude)[0], longitude
        return Fix(float(batch.time[-1]), *place, covariance), (memory or 0) + 1


def matched(*each, chained=False):
    settings, matcher = Matcher(), Says(*each)
    return match_track(TRACK, DISTURBANCE, settings, PRIOR, chained=chained, matcher=matcher)


def test_a_fix_wider_than_the_prior_is_declined_and_counts_with_it():
    matches = matched((-400.0, 300.0, 2e5), (-400.0, 300.0, 990.0), (-400.0, 2e5, 2e5))
    assert [match.fix.reason for match in matches] == [
        "wider than the prior: 1-sigma of 200 km where 1 km were known",
        None,
        "wider than the prior: 1-sigma of 200 km where 1 km were known",
    ]
    one_way, both, nothing = as_objects(matches)
    assert one_way["status"] == "no_fix" and one_way["covariance_enu"] is None
    assert one_way["latitude"] == pytest.approx(np.degrees(TRACK.latitude[29]), abs=1e-9)
    # 400 m off, 300 m 1-sigma, with a prior of 1 km
    moved = np.radians(one_way["with_prior_latitude"]) - TRACK.latitude[29]
    assert moved * NORTH == pytest.approx(-400.0 / 1.09, rel=1e-2)
    (east, _), (_, north) = one_way["with_prior_covariance_enu"]
    assert np.sqrt([north, east]) == pytest.approx([300.0 / np.sqrt(1.09), 1000.0], rel=1e-2)
    assert both["with_prior_latitude"] != both["latitude"]
    assert np.sqrt(nothing["with_prior_covariance_enu"][0][0]) == pytest.approx(1e3, rel=1e-3)


def test_it_is_the_direction_in_which_it_compares_worst():
    slanted = np.array([[5.0, 4.0], [4.0, 5.0]]) * 1e4  # 300 m and 100 m
    known = np.diag([200.0, 1e3]) ** 2
    fix = Fix(0.0, 0.1, 0.2, slanted)
    assert wider_than(fix, known).startswith("wider than the prior: 1-sigma of 0.22")
    assert wider_than(fix, known + slanted) is None


def test_a_fix_that_the_prior_contradicts_is_declined_and_not_used():
    matches = matched((7e3, 900.0, 900.0), (6e3, 900.0, 900.0), (5.5e3, 500.0, 500.0))
    assert matches[0].fix.reason == (
        "contradicts the prior: 7 km from where the track was thought to be,"
        " 5.2 sigmas of both together"
    )
    assert matches[1].fix.published
    assert matches[2].fix.published
    there = as_objects(matches)[0]
    assert there["with_prior_latitude"] == there["latitude"]
    assert there["with_prior_covariance_enu"] == [[1e6, 0.0], [0.0, 1e6]]


def test_chained_a_fix_may_be_wider_than_what_the_chain_knows():
    one = (-400.0, 500.0, 500.0)
    matches = matched(one, (0.0, 700.0, 700.0), (0.0, 700.0, 2e5), chained=True)
    assert [match.fix.published for match in matches] == [True, True, False]
    knows = [np.sqrt(match.covariance[0, 0]) for match in matches]
    assert knows == sorted(knows, reverse=True) and knows[2] < 0.95 * knows[1]
    # after a good fix one 5 km away contradicts what is known
    matches = matched((0.0, 100.0, 100.0), (5e3, 500.0, 500.0), one, chained=True)
    assert [match.fix.published for match in matches] == [True, False, True]
    assert matches[1].covariance[0, 0] == pytest.approx(matches[0].covariance[0, 0], rel=1e-3)
