"""The closed loop along a recorded track."""

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from isogal.fields.simulator import recorded
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.montecarlo.engine import simulate
from isogal.scenario import validate_scenario
from isogal.sensors.recorded_track import read_positions
from isogal.sensors.trajectory import build_trajectory


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


def test_a_leg_of_a_real_ship(shared_data):
    """Its readings are at whole minutes, but for those that are lost, and none is made up."""
    file = str(shared_data / "ships" / "ew0007_lines.nc")
    scenario = validate_scenario(
        {
            "route": {"track": file, "track_line": "95", "height": 0.0},
            "readings": {"source": file},
            "fields": [
                {"field": "disturbance", "interval": 60.0},
                {"field": "magnetic", "sigma": 3.0, "interval": 60.0},
                {"field": "terrain", "sigma": 10.0, "interval": 60.0},
            ],
        }
    )
    trajectory, positions = build_trajectory(scenario), read_positions(file, "95")
    assert len(positions.time) == 224
    since = (positions.time - positions.time[0])[1:]
    for one in scenario.each_field:
        found = recorded(one, trajectory)
        np.testing.assert_array_equal(found.time[np.isfinite(found.value)], since)
