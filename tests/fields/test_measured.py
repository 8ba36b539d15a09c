"""The registry of scalar fields: each reduction undoes what its sensor measures and tells how it
depends on the navigator's errors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.fields.measured import fields, measured_field, of_instrument, unlikely_sigmas
from isogal.maps.quantities import QUANTITIES
from isogal.scenario import load_scenario
from isogal.sensors.reduction import State

VALUE = {"gravity": 9.8, "disturbance": 3e-4, "magnetic": 250.0, "terrain": 400.0, "ground": 400.0}
ROUTE = ["route.start=[55.6, -4.5]", "route.end=[56.2, -3.5]", "route.duration=600",
         "route.height=1500"]  # fmt: skip
SIGMA = {"gravity": 1e-5, "disturbance": 1e-5, "magnetic": 2.0, "terrain": 3.0, "ground": 3.0}
FIELDS = fields()
STEPS = {"north": 100.0, "east": 100.0, "v_north": 0.1, "v_east": 0.1, "up": 10.0}


def reduction_of(name):
    it = load_scenario(None, [*ROUTE, f"field={name}", f"gravimeter.sigma={SIGMA[name]}"])
    return FIELDS[name].reduction(it)


SCALARS = [name for name, field in FIELDS.items() if field.channels is None]
"""Vectors have tests of their own."""
REDUCTIONS = {name: reduction_of(name) for name in SCALARS}
speeds = st.floats(-80.0, 80.0)
places = st.builds(
    State, st.floats(0.965, 0.985), st.floats(-0.08, -0.06), st.floats(1e3, 2e3), speeds, speeds
)


def test_without_field_the_gravimeters_quantity_counts():
    for name, field in FIELDS.items():
        assert (field.name, field.unit) == (name, QUANTITIES[field.quantity].unit)
    disturbance = "gravimeter.quantity=disturbance"
    for told, name in (
        ([], "gravity"),
        ([disturbance], "disturbance"),
        ([disturbance, "field=terrain", "gravimeter.sigma=1"], "terrain"),
    ):
        assert measured_field(load_scenario(None, told)).name == name
    assert [field.name for field in of_instrument("gravimeter")] == ["disturbance", "gravity"]


def test_a_gravimeters_sigma_is_not_taken_for_another_fields():
    says = r"gravimeter\.sigma: must be in nT where field is magnetic, .* is 1e-05"
    with pytest.raises(InputError, match=says):
        measured_field(load_scenario(None, [*ROUTE, "field=magnetic"]))


@pytest.mark.parametrize(
    "key",
    ["gravimeter.sigma", "gravimeter.bias", "map_error.sigma", "matcher.map_sigma"],
)
def test_what_seems_to_be_milligals_is_said(key):
    assert unlikely_sigmas(load_scenario(None, [f"{key}=0.5"])) == [
        f"{key}: 0.5 m/s² is very much; is it mGal?"
    ]
    assert unlikely_sigmas(load_scenario(None, [f"{key}=1e-3"])) == []


@pytest.mark.parametrize("name", SCALARS)
@given(places)
@settings(max_examples=20)
def test_a_reduction_undoes_what_is_felt_and_knows_its_slopes(name, at):
    """With the true state it is exact; its slopes are finite differences."""
    reduction = REDUCTIONS[name]
    raw = reduction.raw(VALUE[name], at)
    assert reduction.reduce(raw, at) == pytest.approx(VALUE[name], rel=1e-12, abs=1e-12)
    step = 1e-3 * abs(VALUE[name])
    assert (reduction.raw(VALUE[name] + step, at) - raw) / step == pytest.approx(
        FIELDS[name].sign, rel=1e-6
    )
    assert reduction.report(raw) == pytest.approx(raw, rel=1e-7)
    north, east = metres_per_radian(at.latitude)
    expected = [*reduction.jacobian(at), reduction.height_slope(at)]
    # of latitude, longitude, height, velocity
    units = np.diag([1.0 / north, 1.0 / east, 1.0, 1.0, 1.0])[[0, 1, 4, 2, 3]]
    for slope, step, unit in zip(expected, STEPS.values(), units.T, strict=True):
        up, down = (
            reduction.reduce(raw, State(*(np.array(at[:5]) + sign * step * unit)))
            for sign in (1, -1)
        )
        # to 0.5 % of what one sigma of a good sensor is worth over 1 km, 1 m/s or 100 m
        within = {"rel": 2e-2, "abs": 1e-3 * SIGMA[name]}
        assert slope * 10 * step == pytest.approx((up - down) * 5, **within)
