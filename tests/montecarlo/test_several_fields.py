"""Several fields in the closed loop: a list of one changes nothing, two are better than the better
one, each has its own rate."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.command_line import answer, refusal
from helpers.navigators import ROUTE
from isogal.evaluation.figures import style
from isogal.maps.several import FieldMaps
from isogal.montecarlo.engine import simulate
from isogal.scenario import validate_scenario

GRAVITY_MAP = field_map_of(wavy)
MAGNETIC_MAP = replace(
    field_map_of(lambda north, east: 1e6 * wavy(-east + 7e3, north)),
    unit="nT",
    quantity="magnetic_anomaly",
)
GRAVITY = {"field": "disturbance", "map_error": {"sigma": 1e-5}, "matcher": {"map_sigma": 1e-5}}
MAGNETIC = {
    "field": "magnetic", "sigma": 5.0, "map_error": {"sigma": 10.0}, "matcher": {"map_sigma": 10.0}
}  # fmt: skip
MAPS = {"disturbance": GRAVITY_MAP, "magnetic": MAGNETIC_MAP}


def scenario(*fields, duration=900.0):
    return validate_scenario(
        {
            "route": ROUTE.model_copy(update={"duration": duration}).model_dump(),
            "initial_error": {"position": 300.0},
            "gravity": {"field": "normal"},
            "matcher": {"batch_length": 15},
            "fields": list(fields),
        }
    )


def ran(*fields, runs=2, **keys):
    maps = FieldMaps(tuple(MAPS[one["field"]] for one in fields))
    return simulate(scenario(*fields, **keys), range(runs), maps)


@pytest.fixture(scope="module")
def gravity():
    return ran(GRAVITY)


@pytest.fixture(scope="module")
def two():
    return ran(GRAVITY, MAGNETIC)


def test_each_field_has_its_own_rate(two):
    """Twice as many readings of the magnetometer: batches end with it, scans are recorded at its
    rate, and the gravimeter's are those of its own rate."""
    fast = ran(GRAVITY, MAGNETIC | {"interval": 5.0}, runs=1)
    np.testing.assert_allclose(np.diff(fast.time), 5.0)
    np.testing.assert_allclose(np.diff(two.time), 10.0)
    assert fast.fix_time[0] == 75.0  # fifteen scans of the faster one
    np.testing.assert_allclose(np.diff(fast.fix_time), 25.0)
    np.testing.assert_allclose(np.diff(fast.detail.scan_time), 10.0)
    assert np.isfinite(fast.detail.reading).all()
    np.testing.assert_array_equal(fast.unaided_error[0, ::2], two.unaided_error[0])


def test_slow_scans_that_miss_the_batch_ends_count(gravity):
    """A field whose scans are never at a batch end: its readings are matched all the same."""
    slow = ran(GRAVITY, MAGNETIC | {"interval": 35.0, "matcher": {"batch_length": 5}}, runs=1)
    np.testing.assert_allclose(np.diff(slow.fix_time), 50.0)
    both, alone = (
        np.trace(one.posterior_covariance[0], axis1=1, axis2=2) for one in (slow, gravity)
    )
    assert (both < 0.95 * alone)[slow.fix_time > 300.0].all()


def test_command_line(tmp_path, monkeypatch):
    """Gravity and terrain of the synthetic map, from the command to its report."""
    path = tmp_path / "two.yaml"
    path.write_text(
        "fields:\n- {field: gravity, matcher: {map_sigma: 0}}\n"
        "- {field: terrain, sigma: 20, interval: 20, matcher: {map_sigma: 5}}\n"
        "route: {duration: 900, height: 4500}\ngravity: {field: normal}\n"
        "map: {continuation: none}\nmatcher: {batch_length: 15}\n"
    )
    monkeypatch.setattr(style, "png", lambda _: b"not drawn")
    out = tmp_path / "out"
    command = ["montecarlo", "--scenario", path, "--runs", 1, "--workers", 1, "--out", out]
    answer(*command)
    page = (out / "report.html").read_text()
    assert "gravity matching" in page
    assert "terrain matching, sigma 20 m" in page
    assert "Figures of map and readings show the first, gravity." in page
    assert "fields: must have an entry" in refusal(*command, "--set", "fields=[]")
