"""A field that the tests of all formats use."""

import numpy as np


def disturbance(lat_deg, lon_deg):
    """Gravity disturbance, m/s², of places in deg: tens of mGal, smooth, without symmetry."""
    lat, lon = np.asarray(lat_deg), np.asarray(lon_deg)
    return 1e-5 * (
        20.0 * np.sin(9.0 * lat) + 15.0 * np.cos(7.0 * lon + lat) + 5.0 * lon - 700.0 - 0.4 * lat
    )
