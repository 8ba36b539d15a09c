"""Maps of surveys of a field whose covariance is known."""

import numpy as np
import pytest

from helpers.point_masses import MGAL
from helpers.refusals import refusal
from helpers.surveys import (
    EAST,
    LATITUDE,
    LONGITUDE,
    NORTH,
    drawn,
    few_places,
    flight_lines,
    scattered,
    survey_at,
)
from isogal.maps.error_ellipses import axes_of
from isogal.maps.gridding.error_lengths import error_ellipses, error_lengths
from isogal.maps.gridding.gridder import GridSettings, grid_survey, learn_model

__all__ = ["few_places"]


def at(model, places):
    """Values and 1-sigmas at places (N, 2): east, north, m."""
    return model(LATITUDE + places[:, 1] / NORTH, LONGITUDE + places[:, 0] / EAST)


@pytest.fixture(scope="module")
def stations():
    """500 stations, 400 more that were left out of the survey, and what was learnt."""
    places = scattered(900, 14e3, seed=1)
    field, readings = drawn(places, seed=2)
    return places, field, learn_model(survey_at(places[:500], readings[:500]), GridSettings())


def test_places_between_stations_are_as_uncertain_as_it_says(stations):
    places, field, model = stations
    out = places[500:]
    mean, sigma = at(model.at, out)
    ratio = ((field[500:] - mean) / sigma) ** 2
    # errors of neighbours hold together: of some 150 independent ones, 3 sigma is 0.35
    assert 0.65 < ratio.mean() < 1.35
    assert np.sqrt(np.mean((field[500:] - mean) ** 2)) < 0.35 * np.std(field)
    near = sigma < np.median(sigma)
    assert 0.5 < ratio[near].mean() < 1.5


def test_between_lines_it_is_worse_than_on_them_and_says_so():
    places, line = flight_lines(9, 3000.0, 300.0, 9e3)
    between = np.array([[x, 1500.0] for x in np.arange(-8e3, 8e3, 400.0)])
    field, readings = drawn(np.concatenate([places, between]), seed=5)
    model = learn_model(survey_at(places, readings[: len(places)], line=line), GridSettings())
    assert model.report["left_out"]["by"] == "lines"
    on, beside = (at(model.at, some) for some in (places[line == 4], between))
    assert np.median(beside[1]) > 4.0 * np.median(on[1])
    assert 0.3 < np.mean(((field[len(places) :] - beside[0]) / beside[1]) ** 2) < 2.0


def test_a_few_blunders_among_stations_are_named_and_not_used_unless_their_sigma_explains_them():
    random = np.random.default_rng(3)
    places = random.uniform(-20e3, 20e3, (200, 2))
    field, readings = drawn(places, seed=5)
    wrong, number = readings.copy(), np.arange(200)
    wrong[[17, 133]] += np.array([350.0, -350.0]) * MGAL
    model = learn_model(survey_at(places, wrong), GridSettings())
    named = model.report["far_off"]
    off = sorted(one["off"] / MGAL for one in named if not one["used"])
    assert off == pytest.approx([-350.0, 350.0], abs=60.0)
    assert model.report["readings"] == 198
    rest = np.delete(number, [17, 133])
    found = at(model.at, places[rest])[0]
    assert np.abs(found - field[rest]).max() < 5.0 * MGAL
    own = np.where(number == 17, 100.0, 0.1) * MGAL
    model = learn_model(survey_at(places, wrong, sigma=own), GridSettings())
    assert model.report["readings"] == 199


def test_sources_continue_upward():
    """A point mass 4 km below the lowest reading, seen from between 0 and 400 m."""
    places, random = scattered(400, 15e3, seed=6), np.random.default_rng(7)
    height = random.uniform(0.0, 400.0, 400)

    def attraction(there, up):
        rise = up + 4000.0
        return 3.2e8 * MGAL * rise / (np.hypot(*there.T) ** 2 + rise**2) ** 1.5

    value = attraction(places, height) + 0.01 * MGAL * random.standard_normal(400)
    survey = survey_at(places, value, height=height)
    settings = {"spacing": 1500.0, "block": 0.0, "trend": 0}
    field_map, _ = grid_survey(
        survey, GridSettings("equivalent-sources", height=2000.0, **settings)
    )
    assert field_map.height == 2000.0
    some = scattered(60, 8e3, seed=9)
    error = at(field_map.value, some) - attraction(some, 2000.0)
    assert np.sqrt(np.mean(error**2)) < 0.1 * MGAL
    with refusal("below the lowest reading"):
        grid_survey(survey, GridSettings("equivalent-sources", height=-50.0))


def nodes_of(count, spacing):
    """East and north (N, 2), m, of the nodes of a square."""
    side = spacing * np.arange(count)
    return np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)


def test_error_lengths_and_ellipses_of_exponential_covariances():
    grid = nodes_of(15, 250.0)
    distance = np.hypot(*(grid[:, None] - grid).T)
    lengths = error_lengths(grid, 4.0 * np.exp(-distance / 800.0))
    np.testing.assert_allclose(lengths, 800.0, rtol=0.01)
    east, north = (grid[:, None] - grid).T
    angle = np.radians(60.0)  # from north to east
    along = north * np.cos(angle) + east * np.sin(angle)
    across = east * np.cos(angle) - north * np.sin(angle)
    covariance = 4.0 * np.exp(-np.hypot(along / 1500.0, across / 600.0))
    found = error_ellipses(grid, covariance, error_lengths(grid, covariance))
    longest, shortest, azimuth = axes_of(found)
    np.testing.assert_allclose(np.median(longest), 1500.0, rtol=0.1)
    np.testing.assert_allclose(np.median(shortest), 600.0, rtol=0.1)
    np.testing.assert_allclose(np.degrees(np.median(azimuth)), 60.0, atol=4.0)
    # where nothing lies around, all directions are alike
    few = error_ellipses(grid[:2], covariance[:2, :2], np.array([800.0, 800.0]))
    np.testing.assert_allclose(axes_of(few)[0] / axes_of(few)[1], 1.0, atol=0.3)


def test_settings_are_checked():
    for settings, words in (
        ({"method": "spline"}, "must be one of kriging, equivalent-sources, auto"),
        ({"method": "kriging", "height": 100.0}, "needs the method equivalent-sources"),
        ({"left_out": "points"}, "must be lines or blocks"),
        ({"trend": 7}, "must be 0 to 3"),
    ):
        with refusal(words):
            GridSettings(**settings)


def test_a_survey_must_have_what_is_asked_for():
    places = scattered(60, 5e3, seed=10)
    survey = survey_at(places, drawn(places, seed=11)[1])
    same = survey_at(places, np.full(60, 1e-5))
    silent = survey_at(places, survey.value, sigma=np.full(60, 1e3))
    for do, given, settings, words in (
        (learn_model, survey, {"method": "equivalent-sources", "height": 1e2}, "no column height"),
        (learn_model, survey, {"left_out": "lines"}, "no column line"),
        (learn_model, survey, {"level": True}, "no column line"),
        (grid_survey, survey, {"spacing": 2.0, "block": 0.0}, "larger --spacing"),
        (learn_model, same, {}, "all the same"),
        (grid_survey, silent, {"method": "kriging"}, "nowhere do the readings say more"),
    ):
        with refusal(words):
            do(given, GridSettings(**settings))
