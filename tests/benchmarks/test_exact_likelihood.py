"""Lines with all that kriging knows, on a survey of a field whose covariance is known."""

import numpy as np
from measured_data.exact import log_likelihood, shapes
from measured_data.lines import Line

from helpers.surveys import EAST, LATITUDE, LONGITUDE, NORTH, drawn, flight_lines, survey_at
from isogal.maps.gridding.gridder import GridSettings, grid_survey


def test_a_line_is_likeliest_where_it_was_and_its_errors_are_smooth():
    places, number = flight_lines(9, 1500.0, 300.0, 9e3)
    beside = np.stack([np.arange(-7e3, 7e3, 200.0), np.full(70, 750.0)], axis=1)
    _, readings = drawn(np.concatenate([places, beside]), seed=5, sigma=100.0, noise=2.0)
    survey = survey_at(places, readings[: len(places)], line=number)
    field_map, model = grid_survey(survey, GridSettings(spacing=500.0, block=0.0))
    where = LATITUDE + beside[:, 1] / NORTH, LONGITUDE + beside[:, 0] / EAST
    line = Line("beside", *where, readings[len(places) :])
    shifts = [np.zeros(2), *(800.0 * np.array(way) for way in ((1, 0), (-1, 0), (0, 1), (0, -1)))]
    found = [log_likelihood(model, line, shift) for shift in shifts]
    assert np.argmax(found) == 0
    assert found[0] - max(found[1:]) > 10.0
    gains = shapes(field_map, model, line)
    assert gains["exp, 1 L"] == 0.0
    assert gains["kriging"] > gains["smooth, L"] > 10.0
    assert gains["smooth, ellipses"] > gains["smooth, L"]
    # no longer length makes up for errors that are smooth
    assert max(gains[f"exp, {f} L"] for f in (2, 4, 8)) < 0.5 * gains["smooth, L"]
