"""What docs/evidence/real-data.md says of measured lines, from one direction."""

from dataclasses import replace

import pytest
from measured_data.lines import clear_lake, scotland
from measured_data.matches import AWAY, WHOLE, row_of, summary_of
from measured_data.untold import GRAVITY_SIGMA, MAGNETIC_SIGMA

from isogal.scenario import Matcher
from isogal.tracks.map_error import with_learnt_error
from isogal.tracks.matching import Uncertainty, match_track
from isogal.tracks.track import fit_to_map

SHIFT = 2598.0, 1500.0
"""m north and east, 3 km."""


def matched(line, field_map, sigma):
    track, _ = fit_to_map(line.track(sigma, SHIFT), field_map)
    settings = Matcher(batch_length=WHOLE)
    return row_of(line, match_track(track, field_map, settings, Uncertainty(AWAY))[0])


def thinned(line):
    columns = {name: getattr(line, name)[::3] for name in ("latitude", "longitude", "value")}
    return replace(line, **columns)


def test_clear_lake_lines_are_found_from_3_km_away(shared_data):
    field_map, lines, _ = clear_lake(shared_data)
    for line, limit in zip(lines[:2], (150.0, 400.0), strict=True):
        row = matched(line, field_map, GRAVITY_SIGMA)
        assert "error_m" in row, row
        assert row["error_m"] < limit or row["in_sigma"] < 2.5
        assert row["nees_per_axis"] < 4.0


@pytest.mark.slow
def test_scotland_tie_lines_with_what_the_flight_lines_say(shared_data):
    field_map, flights, ties = scotland(shared_data)
    learnt, sigma = with_learnt_error([line.track(MAGNETIC_SIGMA) for line in flights], field_map)
    assert 30.0 < sigma < 120.0  # residuals of the flight lines are of 59 nT
    # every third reading, some 600 m apart, of every third line
    summary = summary_of([matched(thinned(tie), learnt, MAGNETIC_SIGMA) for tie in ties[1::3]])
    assert summary["fixes"] == 4
    assert summary["error_median_m"] < 450.0
    assert summary["error_90_m"] < 800.0
    # 8 degrees of freedom: 99.5 % of a consistent filter's are below 2.75; that flight lines are
    # worse mapped than ties makes fixes modest
    assert 0.1 < summary["nees_per_axis"] < 2.75
