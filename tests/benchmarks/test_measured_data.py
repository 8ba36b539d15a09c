"""What docs/evidence/real-data.md says of measured lines, from one direction."""

import sys

import numpy as np
import pytest
import real_data
from measured_data.lines import clear_lake, scotland
from measured_data.matches import nis, noise_of, rigid_search, summary_of, whole_line
from measured_data.scotland import LEAST_SENSOR

from isogal.tracks.map_error import fit_map_error

AWAY = 2598.0, 1500.0
"""m north and east, 3 km."""


@pytest.fixture(scope="module")
def lake(shared_data):
    """Map, lines, and for each line the settings from the other three."""
    field_map, lines, _ = clear_lake(shared_data)
    fits = [
        fit_map_error([o.track(1.0) for o in lines if o is not line], field_map) for line in lines
    ]
    return field_map, lines, fits


def row_of(lake, number, readings=None, aided=False):
    field_map, lines, fits = lake
    line = lines[number].part(slice(readings))
    return whole_line(line, field_map, noise_of(fits[number]), AWAY, aided=aided)


def nis_of(lake, number):
    """NIS per reading and of the mean, with independent and with correlated map errors."""
    field_map, lines, fits = lake
    noise = noise_of(fits[number])
    return [
        *nis(lines[number], field_map, noise.white),
        *nis(lines[number], field_map, noise),
    ]


def test_clear_lake_errors_are_as_large_as_the_map_says_and_shared_by_neighbours(lake):
    _, lines, fits = lake
    figures = np.array([nis_of(lake, number) for number in range(len(lines))])
    sizes = np.array([line.value.size for line in lines])
    white, _, correlated, _ = sizes @ figures / sizes.sum()
    assert 0.7 < white < 1.3
    assert 0.7 < correlated < 1.3
    # the mean residual of a line: with independent errors it would be a hundred times smaller,
    # squared, than it is
    assert figures[[0, 1, 3], 1].min() > 5.0
    assert figures[:, 3].max() < 4.0
    for fit in fits:
        assert 1500.0 < fit.correlation_length < 3500.0


@pytest.mark.parametrize(("number", "limit"), [(0, 150.0), (2, 1100.0), (3, 2300.0)])
def test_clear_lake_lines_are_found_from_3_km_away(lake, number, limit):
    row = row_of(lake, number)
    assert "error_m" in row, row
    assert row["error_m"] < limit or row["in_sigma"] < 2.5
    assert row["nees_per_axis"] < 4.0


def test_clear_lake_line_1_is_uncertain_at_first_and_no_false_fix_later(lake):
    field_map, lines, _ = lake
    assert rigid_search(lines[1], field_map, AWAY) > 1500.0  # where least squares goes
    assert row_of(lake, 1, readings=15, aided=True)["sigma_long_m"] > 600.0
    row = row_of(lake, 1)
    assert "error_m" not in row or row["in_sigma"] < 2.5


@pytest.mark.slow
def test_scotland_tie_lines_with_what_the_flight_lines_say(shared_data):
    field_map, flights, ties = scotland(shared_data)
    every_third = slice(None, None, 3)
    fit = fit_map_error([line.part(every_third).track(1.0) for line in flights], field_map)
    own, noise = fit.apply(field_map), noise_of(fit, LEAST_SENSOR)
    # every second line: those whose medians are nearest to those of all
    summary = summary_of([whole_line(line, own, noise, AWAY) for line in ties[1::2]])
    assert summary["fixes"] >= 5
    assert summary["error_median_m"] < 450.0
    assert summary["error_90_m"] < 800.0
    # 6 lines, 12 degrees of freedom: 99.5 % of a consistent filter's are below 2.36; that flight
    # lines are worse mapped than ties makes fixes modest
    assert 0.1 < summary["nees_per_axis"] < 2.36


def test_a_folder_that_does_not_exist_is_one_line(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["real_data.py", "/none"])
    with pytest.raises(SystemExit) as end:
        real_data.main()
    assert end.value.code == 2
    message = capsys.readouterr().err.splitlines()[-1]
    assert message.endswith("/none: no such folder; name the folder of the data")
