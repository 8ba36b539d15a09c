"""The terms of the model."""

import numpy as np

from isogal.magnetics.terms import COUNT, SCALE, names, terms


def test_columns_in_the_order_and_scale_of_the_literature():
    # Gnadt et al. 2022, by hand for one reading
    vector, rate, total = np.array([3.0e4, 0.0, 4.0e4]), np.array([10.0, 20.0, 30.0]), 5.0e4
    row = terms(vector[None], rate[None], np.array([total]), np.array([[2.0]]))[0]
    u = np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(row[:3], u)
    np.testing.assert_allclose(row[3:9], np.array([0.36, 0.0, 0.48, 0.0, 0.0, 0.64]) * 1.0)
    np.testing.assert_allclose(row[9:18], np.outer(u, rate).ravel() / SCALE)
    np.testing.assert_allclose(row[18:], 2.0 * u)
    assert len(names(("strobe",))) == len(row) == COUNT + 3
