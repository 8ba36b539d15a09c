"""The magnetometer: the total magnetic field, and its anomaly, which is left when the Earth's main
field is subtracted (docs/mathematics.md, section 2.7).

The anomaly of total field is |B| less the main field's intensity at the navigator's estimate. The
main field is the International Geomagnetic Reference Field (Alken et al. 2021, Earth Planets Space
73:49; degree 13, wavelengths of 3000 km and more) by the package ppigrf. Only |B| is used, so the
sensor's attitude does not matter. Neither the daily variation (tens of nT) nor the vehicle's own
field is modelled; an offset that is constant within a batch can be allowed for by
`matcher.bias_sigma`."""

import math
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap
from isogal.sensors.reduction import State

SPACING = 1.0
"""deg between the points at which the model is evaluated; cubic interpolation between them is
exact to 0.01 nT (tested)."""
MARGIN = 300e3
"""m by which the grid extends beyond the given points: how far off the navigator may be."""
HEIGHT_STEP = 1000.0
"""m over which the main field's change with height, about -0.02 nT/m, is computed."""
_NEAREST_POLE = 89.0


class MainField:
    """Intensity of the Earth's main field around given points: the model on a coarse grid, with
    cubic interpolation between.

    Parameters
    ----------
    latitude, longitude : (K,) arrays
        Points of a route, rad.
    height : float
        Of the grid, m above the ellipsoid.
    epoch : float
        Decimal year, 1900 to 2030.
    """

    def __init__(self, latitude: Array, longitude: Array, height: float, epoch: float) -> None:
        self.height = height
        turned = np.unwrap(longitude)
        window = Window(latitude.min(), latitude.max(), turned.min(), turned.max()).grown(MARGIN)
        south, north, west, east = np.degrees(window[:4])
        south, north = max(south, -_NEAREST_POLE), min(north, _NEAREST_POLE)
        rows = SPACING * np.arange(math.floor(south / SPACING) - 1, math.ceil(north / SPACING) + 2)
        columns = SPACING * np.arange(
            math.floor(west / SPACING) - 1, math.ceil(east / SPACING) + 2
        )
        rows, columns = rows[np.abs(rows) <= _NEAREST_POLE], columns[: round(360.0 / SPACING)]
        # row by row, because the package needs 3 kB of memory for each point
        here, above = (
            np.stack([intensity(row, columns, h, epoch) for row in rows])
            for h in (height, height + HEIGHT_STEP)
        )
        axes = np.radians(rows), np.radians(columns)
        self.grid = FieldMap(*axes, here, "nT", "magnetic_field", provenance="IGRF")
        self._rise = FieldMap(
            *axes, (above - here) / HEIGHT_STEP, "nT/m", "magnetic_field", provenance="IGRF"
        )

    def value(self, latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike) -> Array:
        """Return the intensity, nT; NaN far from the points."""
        rise = self._rise.value(latitude, longitude)
        return self.grid.value(latitude, longitude) + rise * (np.asarray(height) - self.height)

    def gradient(self, latitude: ArrayLike, longitude: ArrayLike) -> tuple[Array, Array, Array]:
        """Return its derivative to the north, to the east and upwards, nT/m."""
        _, north, east = self.grid.value_and_gradient(latitude, longitude)
        return north, east, self._rise.value(latitude, longitude)


def intensity(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, height: float, epoch: float
) -> Array:
    """Return the main field's intensity (nT) at points in deg and a height in m, by the IGRF."""
    import ppigrf

    year = int(epoch)
    date = datetime(year, 1, 1, tzinfo=UTC) + timedelta(days=(epoch - year) * 365.25)
    parts = ppigrf.igrf(
        np.asarray(longitude_deg),
        np.asarray(latitude_deg),
        height / 1000.0,
        date.replace(tzinfo=None),
    )
    return np.sqrt(sum(part[0] ** 2 for part in parts))


class MagneticReduction:
    """Total field (nT) to anomaly (nT).

    Parameters
    ----------
    main_field : MainField
    """

    def __init__(self, main_field: MainField) -> None:
        self.main_field = main_field

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return the total field over a point of a given anomaly."""
        return np.asarray(value) + self.main_field.value(at.latitude, at.longitude, at.height)

    def report(self, raw: ArrayLike) -> Array:
        """Return it as it is."""
        return np.asarray(raw, dtype=float)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return the anomaly: the total field less the main field at the navigator's position."""
        return np.asarray(raw) - self.main_field.value(at.latitude, at.longitude, at.height)

    def jacobian(self, at: State) -> Array:
        """Return minus the main field's gradient: at a wrong position a wrong main field is
        subtracted."""
        north, east, _ = self.main_field.gradient(at.latitude, at.longitude)
        jacobian = np.zeros((*np.shape(north), 4))
        jacobian[..., 0], jacobian[..., 1] = -north, -east
        return jacobian

    def height_slope(self, at: State) -> Array:
        """Return the main field's decrease with height, nT/m."""
        return -self.main_field.gradient(at.latitude, at.longitude)[2]
