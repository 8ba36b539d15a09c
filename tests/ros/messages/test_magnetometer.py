"""Messages of a magnetometer, and what cannot be used."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import MagneticField

from isogal.scenario import load_scenario
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.magnetometer import read_total


def magnetic(*vector, covariance=(0.0,) * 9, frame="anything"):
    message = MagneticField(magnetic_field_covariance=np.array(covariance, dtype=float))
    message.header.frame_id = frame
    message.magnetic_field.x, message.magnetic_field.y, message.magnetic_field.z = map(
        float, vector
    )
    return message


def test_only_the_length_of_the_magnetic_vector_counts() -> None:
    for vector in ((5e-5, 0.0, 0.0), (0.0, -3e-5, 4e-5), (3e-5, 4e-5, 0.0)):
        assert read_total(magnetic(*vector))[0] == pytest.approx(5e4, rel=1e-14)
    # the variance of the length is that of the component along the vector
    covariance = np.diag([1e-18, 4e-18, 9e-18])
    assert read_total(magnetic(3e-5, 0.0, 4e-5, covariance=covariance.ravel()))[
        1
    ] == pytest.approx(0.36 * 1.0 + 0.64 * 9.0)


def test_zero_variance_is_an_unknown_one() -> None:
    assert read_total(magnetic(0.0, 0.0, 5e-5))[1] is None


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (magnetic(math.nan, 0.0, 5e-5), "not finite"),
        (magnetic(math.nan, math.nan, 5e-5), "needs all three"),
        (magnetic(math.inf, 0.0, 5e-5), "not finite"),
        (magnetic(0.0, 0.0, 0.0), "a total field of 0 T is not the Earth's"),
        (magnetic(0.0, 30.0, 40.0), "a total field of 50 T is not the Earth's; the unit is tesla"),
        (magnetic(0.0, 0.3, 0.4), "the unit is tesla"),
        (magnetic(0.0, 0.0, 5e-5, covariance=[-1e-18] + [0.0] * 8), "negative variance"),
        (magnetic(0.0, 0.0, 5e-5, covariance=[math.nan] + [0.0] * 8), "covariance is not finite"),
    ],
)  # fmt: skip
def test_magnetic_fields_that_cannot_be_used(message, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        read_total(message)


def test_an_anomaly_is_reported_along_the_main_field_only() -> None:
    message = adapter_of(load_scenario(), "magnetic").write_reduced(0, 100.0, 4.0, None)
    assert math.isnan(message.magnetic_field.x)
    assert math.isnan(message.magnetic_field.y)
    assert message.magnetic_field.z == pytest.approx(1e-7)
    assert message.magnetic_field_covariance[8] == pytest.approx(4e-18)
