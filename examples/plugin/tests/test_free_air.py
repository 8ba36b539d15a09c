"""The reduction against a published value of normal gravity."""

import math

import pytest

from isogal.scenario import Scenario
from isogal.sensors.reduction import State
from isogal_example.free_air import FREE_AIR

NORMAL_GRAVITY_45 = 9.806199203
"""m/s² at latitude 45 deg (Moritz, Geodetic Reference System 1980, J. Geodesy 74, 2000)."""


def test_a_ship_at_rest_on_the_sea_measures_normal_gravity_and_the_anomaly():
    reduction = FREE_AIR.reduction(Scenario())
    at = State(math.radians(45.0), math.radians(-30.0), 0.0, 0.0, 0.0)
    anomaly = 30e-5
    assert reduction.raw(anomaly, at) == pytest.approx(NORMAL_GRAVITY_45 + anomaly, abs=1e-8)
    assert reduction.reduce(NORMAL_GRAVITY_45 + anomaly, at) == pytest.approx(anomaly, abs=1e-8)
