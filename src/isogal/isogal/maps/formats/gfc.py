"""Gravity disturbance of spherical harmonic models (ICGEM ``.gfc``), computed on a grid.

With T the model's potential less that of GRS80, whose even zonal coefficients are taken off
(Moritz 2000; Heiskanen & Moritz 1967, section 2-9), the disturbance is its derivative downwards
along the normal of the ellipsoid, at one height above it:

    T = GM/r sum (a/r)^l P_lm(sin) (C_lm cos m lon + S_lm sin m lon).

pyshtools reads the coefficients and gives the Legendre functions and their derivatives."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import E2, GM, A, radii
from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.axes import Window, check_size
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.format import Asked, FileGrid, Format

_J2 = 108263e-8
"""Of GRS80, its second zonal coefficient."""
_ZONALS = 6
"""Even zonal coefficients of GRS80, from 0; those that follow are below 1e-14."""
_PER_WAVE = 8
"""Nodes to the shortest wave of the model."""
_RIM = 4
"""Nodes around a window, of which interpolation needs three."""


class Model(NamedTuple):
    """A model's disturbing potential."""

    coefficients: Array
    """(2, L + 1, L + 1) of cosines and sines by degree and order, fully normalised, less those of
    the normal field."""
    gm: float
    """m³/s²."""
    radius: float
    """m, to which the coefficients refer."""

    @property
    def degree(self) -> int:
        """L."""
        return int(self.coefficients.shape[1]) - 1


def read_model(path: Path) -> Model:
    """Read a model; raises InputError."""
    from pyshtools.shio import read_icgem_gfc

    if not path.is_file():
        raise InputError(f"{path}: no such file")
    with reading(path, "ICGEM model"):
        coefficients, gm, radius = read_icgem_gfc(str(path), quiet=True)
    left = np.array(coefficients, dtype=np.float64)
    if not np.isfinite(left).all() or left.shape[1] < 3:
        raise InputError(f"{path}: has no coefficients of degree 2 and more")
    for n in range(min(_ZONALS, (left.shape[1] + 1) // 2)):
        j = 3.0 * (-1.0) ** (n + 1) * E2**n / ((2 * n + 1) * (2 * n + 3))
        j *= 1.0 - n + 5.0 * n * _J2 / E2
        scale = GM / gm * (A / radius) ** (2 * n)
        left[0, 2 * n, 0] += j * scale / math.sqrt(4 * n + 1)
    return Model(left, float(gm), float(radius))


def disturbance(model: Model, latitude: Array, longitude: Array, height: float) -> Array:
    """Return (n, m) the gravity disturbance of a model, m/s², positive downwards.

    Parameters
    ----------
    model : Model
    latitude, longitude : (n,), (m,) arrays
        Geodetic, rad.
    height : float
        m above the ellipsoid.
    """
    from pyshtools.legendre import PlmBar_d1

    top = model.degree
    n, m = np.tril_indices(top + 1)
    waves = np.outer(np.arange(top + 1), longitude)
    cosine, sine = np.cos(waves), np.sin(waves)
    of_cosine, of_sine = model.coefficients[0, n, m], model.coefficients[1, n, m]
    result = np.empty((len(latitude), len(longitude)))
    for row, phi in enumerate(latitude):
        normal = float(radii(phi)[1])
        x, z = (normal + height) * math.cos(phi), (normal * (1.0 - E2) + height) * math.sin(phi)
        r, geocentric = math.hypot(x, z), math.atan2(z, x)
        P, by_z = PlmBar_d1(top, math.sin(geocentric))
        up = model.gm / r**2 * (model.radius / r) ** n
        tilt = phi - geocentric
        # the normal is the radius turned northwards by the tilt
        kernel = up * ((n + 1) * math.cos(tilt) * P - math.sin(tilt) * math.cos(geocentric) * by_z)
        result[row] = (
            np.bincount(m, kernel * of_cosine, top + 1) @ cosine
            + np.bincount(m, kernel * of_sine, top + 1) @ sine
        )
    return result


def _read(path: Path, asked: Asked, window: Window | None) -> FieldMap:
    """Compute the disturbance in a window at the height that the variable says, m; 0 where it says
    none."""
    try:
        height = float(asked.variable or 0.0)
    except ValueError:
        height = math.nan
    if not -1e4 < height < 1e7:
        raise InputError(
            f"{path}: the variable of a .gfc model is the height of the map above the ellipsoid,"
            f" in m, not '{asked.variable}'"
        )
    model = read_model(path)
    step = 2.0 * math.pi / (max(model.degree, 90) * _PER_WAVE)
    south, north, west, east = (window or Window(-math.pi / 2, math.pi / 2, -math.pi, math.pi))[:4]
    rows, columns = (
        np.arange(math.floor(low / step) - _RIM, math.ceil(high / step) + _RIM + 1)
        for low, high in ((south, north), (west, east if east >= west else east + 2.0 * math.pi))
    )
    latitude, longitude = (np.asarray(one * step, dtype=np.float64) for one in (rows, columns))
    latitude = latitude[np.abs(latitude) < math.pi / 2]
    where = f"{path}:disturbance at {height:g} m"
    check_size(latitude.size * longitude.size, where)
    if window is None and model.degree > 360:
        raise InputError(f"{where}: a model of degree {model.degree} needs a window")
    if window is None:
        longitude = longitude[_RIM:-_RIM]
    values = disturbance(model, latitude, longitude, height)
    return FileGrid(
        where=where,
        latitude=latitude,
        longitude=longitude,
        values=values,
        unit="m/s²",
        quantity="disturbance",
        height=height,
    ).load(asked, window)


FORMAT = Format("gfc", lambda path: path.suffix.casefold() == ".gfc", _read)
