"""The magnetometer: the total magnetic field, and its anomaly, which is left when the Earth's main
field is subtracted (docs/mathematics.md, section 2.7).

The anomaly of total field is |B| less the main field's intensity at the navigator's estimate. The
main field is the International Geomagnetic Reference Field (Alken et al. 2021, Earth Planets Space
73:49; degree 13, wavelengths of 3000 km and more) by the package ppigrf. Only |B| is used, so the
sensor's attitude does not matter. The main field is that of the reading's own date where its time
is absolute, else that of `magnetometer.epoch`. Of the vehicle's own field `isogal.magnetics` knows
more. The daily variation (tens of nT) is not modelled; an offset that is constant within a batch
can be allowed for by `matcher.bias_sigma`."""

import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap
from isogal.sensors.reduction import Reduction, State

SPACING = 1.0
"""deg between the points at which the model is evaluated; cubic interpolation between them is
exact to 0.01 nT (tested)."""
MARGIN = 300e3
"""m by which the grid extends beyond the given points: how far off the navigator may be."""
HEIGHT_STEP = 1000.0
"""m over which the main field's change with height, about -0.02 nT/m, is computed."""
_NEAREST_POLE = 89.0
_ABSOLUTE = 631_152_000.0
"""s, 1990-01-01 UTC: smaller times count from the start of a recording or a simulation."""
_FIRST_YEAR, _LAST_YEAR = 1900.0, 2030.0
"""Of the model; beyond them the field is taken as at these."""


def is_absolute(time: ArrayLike) -> bool:
    """Return whether times (s) are since 1970 UTC, rather than since the start of something."""
    return bool(np.min(time) >= _ABSOLUTE)


def decimal_year(time: ArrayLike) -> Array:
    """Return the decimal year of times since 1970 UTC (s), leap seconds left out, within the years
    of the model."""
    seconds = np.asarray(time, dtype=float)
    year = seconds.astype("datetime64[s]").astype("datetime64[Y]")
    next_year = year + np.timedelta64(1, "Y")
    start, end = (one.astype("datetime64[s]").astype(float) for one in (year, next_year))
    share = (seconds - start) / (end - start)
    return np.clip(year.astype(float) + 1970.0 + share, _FIRST_YEAR, _LAST_YEAR)


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
        self._rows = rows[np.abs(rows) <= _NEAREST_POLE]
        self._columns = columns[: round(360.0 / SPACING)]
        self.grid, above = (self._map(h, epoch) for h in (height, height + HEIGHT_STEP))
        self._rise = replace(
            self.grid, values=(above.values - self.grid.values) / HEIGHT_STEP, unit="nT/m"
        )
        self._years: dict[int, FieldMap] = {}

    def _map(self, height: float, epoch: float) -> FieldMap:
        points = np.meshgrid(self._rows, self._columns, indexing="ij")
        values = intensity(*points, height, epoch)
        axes = np.radians(self._rows), np.radians(self._columns)
        return FieldMap(*axes, values, "nT", "magnetic_field", provenance="IGRF")

    def value(
        self,
        latitude: ArrayLike,
        longitude: ArrayLike,
        height: ArrayLike,
        year: ArrayLike | None = None,
    ) -> Array:
        """Return the intensity, nT; NaN far from the points.

        Parameters
        ----------
        latitude, longitude : (...) array_like
            rad.
        height : (...) array_like
            m above the ellipsoid.
        year : (...) array_like, optional
            Decimal; default: the epoch.
        """
        rise = self._rise.value(latitude, longitude) * (np.asarray(height) - self.height)
        if year is None:
            return self.grid.value(latitude, longitude) + rise
        return self._at_year(latitude, longitude, np.asarray(year)) + rise

    def _at_year(self, latitude: ArrayLike, longitude: ArrayLike, year: Array) -> Array:
        """Return the intensity at the grid's height, linear between years (the model's
        coefficients are; the intensity is to some hundredths of a nT)."""
        whole = np.floor(year)
        result = np.full(np.broadcast(latitude, longitude, year).shape, np.nan)
        for first in np.unique(whole):
            before, after = (self._in_year(int(one)) for one in (first, first + 1.0))
            here, there = (one.value(latitude, longitude) for one in (before, after))
            result = np.where(whole == first, here + (year - first) * (there - here), result)
        return result

    def _in_year(self, year: int) -> FieldMap:
        """Return the grid at the start of a year, which is computed at its first use."""
        if year not in self._years:
            self._years[year] = self._map(self.height, min(float(year), _LAST_YEAR))
        return self._years[year]

    def gradient(self, latitude: ArrayLike, longitude: ArrayLike) -> tuple[Array, Array, Array]:
        """Return its derivative to the north, to the east and upwards, nT/m."""
        _, north, east = self.grid.value_and_gradient(latitude, longitude)
        return north, east, self._rise.value(latitude, longitude)


def intensity(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, height: float, epoch: float
) -> Array:
    """Return the main field's intensity (...), nT; parameters are those of `field_vector`."""
    return np.sqrt((field_vector(latitude_deg, longitude_deg, height, epoch) ** 2).sum(axis=-1))


def field_vector(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, height: float, epoch: float
) -> Array:
    """Return the main field (..., 3), north, east, down, nT, by the IGRF.

    Parameters
    ----------
    latitude_deg, longitude_deg : (...) array_like
        deg.
    height : float
        m above the ellipsoid.
    epoch : float
        Decimal year, 1900 to 2030.
    """
    import ppigrf

    year = int(epoch)
    date = datetime(year, 1, 1, tzinfo=UTC) + timedelta(days=(epoch - year) * 365.25)
    east, north, up = ppigrf.igrf(
        np.asarray(longitude_deg),
        np.asarray(latitude_deg),
        height / 1000.0,
        date.replace(tzinfo=None),
    )
    return np.stack([north[0], east[0], -up[0]], axis=-1)


class MagneticReduction(Reduction):
    """Total field (nT) to anomaly (nT).

    Parameters
    ----------
    main_field : MainField
    year : float, optional
        Of the main field, decimal; None = its epoch.
    """

    def __init__(self, main_field: MainField, year: float | None = None) -> None:
        self.main_field, self.year = main_field, year

    def dated(self, time: float) -> "MagneticReduction":
        """Return the reduction of readings at a time, s: of its date, if it is since 1970 UTC."""
        if not is_absolute(time):
            return self
        return MagneticReduction(self.main_field, float(decimal_year(time)))

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return the total field over a point of a given anomaly."""
        return np.asarray(value) + self._main(at)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return the anomaly: the total field less the main field at the navigator's position.
        Of readings with the terms of what the vehicle adds (..., 1 + C), the first number."""
        raw, main = np.asarray(raw), self._main(at)
        if raw.ndim == main.ndim:
            return raw - main
        return np.concatenate([raw[..., :1] - main[..., None], raw[..., 1:]], axis=-1)

    def _main(self, at: State) -> Array:
        return self.main_field.value(at.latitude, at.longitude, at.height, self.year)

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
