"""A map of measured stations, against readings that were held back from it."""

import netCDF4
import numpy as np
import pytest

from isogal.maps.gridding.gridder import GridSettings, learn_model
from isogal.maps.gridding.reading import read_survey
from isogal.maps.load import load_map

pytestmark = pytest.mark.slow


def test_readings_held_back_are_as_near_as_the_map_says(shared_data):
    """In the middle of a survey, which holds a share of its latitudes and of its longitudes: 353
    readings, of whose mean square three 1-sigmas are 0.23 if they are independent."""
    name, variable, share = "clear_lake_gravity", "bouguer_disturbance", 0.55
    survey = shared_data / f"{name}_survey.nc"
    if not survey.is_file():
        pytest.skip(f"{survey.name} is not among the shared test data")
    whole = read_survey(survey, variable)
    ends = 0.5 - 0.5 * share, 0.5 + 0.5 * share
    (south, north), (west, east) = (
        np.quantile(axis, ends) for axis in (whole.latitude, whole.longitude)
    )

    def middle(latitude, longitude):
        return (
            (south <= latitude) & (latitude <= north) & (west <= longitude) & (longitude <= east)
        )

    model = learn_model(whole.part(middle(whole.latitude, whole.longitude)), GridSettings())
    with netCDF4.Dataset(shared_data / f"{name}_stations.nc") as dataset:
        place = [np.radians(np.ma.filled(dataset[key][:], np.nan)) for key in ("lat", "lon")]
        value = np.ma.filled(dataset[variable][:].astype(float), np.nan)
    within = middle(*place)
    place, value = [axis[within] for axis in place], value[within]
    found, sigma = model.at(*place)
    error = value - found
    assert 0.8 < np.mean((error / sigma) ** 2) < 1.2
    shipped = load_map(shared_data / f"{name}_map.nc", variable).value(*place)
    known = np.isfinite(shipped)
    assert np.sqrt(np.mean(error[known] ** 2)) <= np.sqrt(np.mean((value - shipped)[known] ** 2))
