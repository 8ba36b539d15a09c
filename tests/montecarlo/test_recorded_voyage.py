"""The closed loop along a recorded track."""

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from isogal.errors import InputError
from isogal.fields.scenario_map import maps_for_scenario
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.montecarlo.engine import simulate
from isogal.scenario import validate_scenario


def voyage(tmp_path, field_map):
    """A track of ten minutes to the north-east, with readings of the whole map."""
    write_netcdf(field_map, tmp_path / "map.nc")
    time = np.arange(0.0, 601.0, 10.0)
    latitude, longitude = -36.6 + 1.4e-4 * time, 146.9 + 1.6e-4 * time
    value = field_map_of(wavy).value(np.radians(latitude), np.radians(longitude)) / 1e-5
    value += np.random.default_rng(1).normal(0.0, 1.0, len(time))
    rows = np.column_stack([time, latitude, longitude, value])
    np.savetxt(tmp_path / "voyage.csv", rows, "%.10g", ",", header="time,lat,lon,faa", comments="")
    return validate_scenario(
        {
            "route": {"track": str(tmp_path / "voyage.csv")},
            "readings": {"source": str(tmp_path / "voyage.csv")},
            "field": "disturbance",
            "map": {"source": str(tmp_path / "map.nc"), "continuation": "none"},
            "gravity": {"field": "normal"},
            "matcher": {"batch_length": 6, "map_sigma": 0.0},
            "initial_error": {"position": 300.0},
        }
    )


def test_readings_aid_an_ins_along_the_track(tmp_path):
    found = simulate(voyage(tmp_path, field_map_of(wavy)), range(8))
    assert found.published.mean() > 0.8
    rms, unaided = (
        np.sqrt((error[:, -20:] ** 2).mean())
        for error in (found.horizontal_error, found.unaided_horizontal_error)
    )
    assert rms < 0.3 * unaided


@pytest.mark.parametrize("recorded", [True, False])
def test_a_map_that_ends_on_the_way_ends_the_aiding_there(tmp_path, recorded):
    whole = field_map_of(wavy)
    south, north, west, _ = whole.extent[:4]
    scenario = voyage(tmp_path, whole.window(south, north, west, np.radians(146.95)))
    if not recorded:
        scenario = scenario.model_copy(update={"readings": type(scenario.readings)()})
    found = simulate(scenario, [0])
    gone = np.interp(found.fix_time, found.time, np.degrees(found.longitude)) > 146.97
    assert np.isfinite(found.error).all()
    assert found.published[0, ~gone].any()
    assert not found.published[0, gone].any()


def test_a_map_that_is_elsewhere_is_refused(tmp_path):
    whole = field_map_of(wavy)
    south, north, _, east = whole.extent[:4]
    scenario = voyage(tmp_path, whole.window(south, north, np.radians(147.05), east))
    with pytest.raises(InputError, match="does not cover the route"):
        maps_for_scenario(scenario)
