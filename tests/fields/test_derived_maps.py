"""Maps of several channels that a scenario's map is turned into, in another process."""

import subprocess

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.refusals import refusal
from isogal.fields import derived_maps as derived
from isogal.fields.scenario_map import map_for_scenario
from isogal.fields.source_map import MapSource
from isogal.maps.corridor import corridor_of
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map
from isogal.maps.potential import derivatives
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory


@pytest.fixture(scope="module", autouse=True)
def other_processes():
    """As in use, where each map is computed by another process, and for one process alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(derived, "subprocess", subprocess)
        patch.delenv(derived.SHARED)
        yield


@pytest.fixture(scope="module")
def disturbance(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "wavy.nc"
    write_netcdf(
        field_map_of(wavy, half=60e3, step=500.0, sigma=1e-5, correlation_length=5000.0), path
    )
    return path


def scenario(path, *more):
    return load_scenario(
        None,
        ["field=gradient", f"map.source={path}", "route.start=[-36.55, 146.95]",
         "route.end=[-36.4, 147.1]", "route.duration=600", "gradiometer.components=[nd,ee]",
         *more],
    )  # fmt: skip


@pytest.fixture(scope="module")
def there(disturbance):
    """Maps that another process has computed."""
    return map_for_scenario(scenario(disturbance), margin=5000.0)


def test_the_maps_are_those_of_the_tensor_along_the_route(disturbance, there):
    it = scenario(disturbance)
    expected = derivatives(load_map(disturbance), ("nd", "ee"), height=100.0)
    route = build_trajectory(it)
    found = there.value(route.latitude, route.longitude)
    assert found.shape == (len(route) + 1, 2)
    # cut out of the file 25 km away
    difference = found - expected.value(route.latitude, route.longitude)
    assert np.abs(difference).max() < 0.02 * found.std()
    assert there.values.dtype == np.float64  # for which kernels are compiled
    first, second = there.channels
    assert np.shares_memory(second.values, there.values)
    assert first.values.size < 0.3 * expected.channels[0].values.size
    sigma = [one.sigma for one in expected.channels]
    assert [first.sigma, second.sigma] == pytest.approx(sigma, rel=1e-3)
    assert first.sigma > 0.0
    window = corridor_of(route.latitude, route.longitude).window
    assert MapSource.of(it)(window).quantity == "disturbance"


def none_left(*_, **__):
    """No other process can be started."""
    raise BlockingIOError


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["route.height=-50"], "route.height: must not be below the map's level where field is"),
        (
            ["route.end=[-36.0, 147.6]", "route.duration=null"],
            "does not cover the route: no value",
        ),
        (["map.source=nowhere.nc"], "nowhere.nc: no such file or folder"),
        (["map.source=synthetic", "map.variable=ga"], "is a gravity map, and one of dist"),
    ],
)
def test_refusals_are_one_line(disturbance, overrides, words, monkeypatch):
    """One of them comes from another process."""
    if "map.source=nowhere.nc" not in overrides:
        monkeypatch.setattr(subprocess, "run", none_left)
    with refusal(words):
        map_for_scenario(scenario(disturbance, *overrides))
