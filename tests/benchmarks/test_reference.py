"""The reference of rigid tracks on a map whose error is drawn as it is stated."""

from dataclasses import replace

import numpy as np
from measured_data.lines import Line
from measured_data.reference import reference_row

from helpers.tracks import field_of
from isogal.earth.ellipsoid import metres_per_radian


def test_the_reference_finds_a_line_and_knows_how_well():
    field = field_of("disturbance")
    random = np.random.default_rng(5)
    sigma = 0.02 * float(np.std(field.values))
    field_map = replace(field, sigma=np.full(field.values.shape, sigma), correlation_length=1e3)
    north, east = metres_per_radian(float(np.mean(field.latitude)))
    way = np.linspace(-4e3, 4e3, 16)
    latitude = np.mean(field.latitude) + 0.6 * way / north
    longitude = np.mean(field.longitude) + 0.8 * way / east
    apart = np.abs(way[:, None] - way)
    nees = []
    for shift in ((300.0, -200.0), (-500.0, 100.0), (0.0, 400.0)):
        error = np.linalg.cholesky(sigma**2 * np.exp(-apart / 1e3) + 1e-18 * np.eye(16))
        value = field.value(latitude, longitude) + error @ random.standard_normal(16)
        row = reference_row(
            Line("made", latitude, longitude, value), field_map, 1e-7, shift, 400.0
        )
        assert row["error_m"] < 200.0
        assert row["sigma_long_m"] < 200.0
        nees.append(row["nees_per_axis"])
    assert 0.06 < np.mean(nees) < 3.74  # 99.8 % of right ones
