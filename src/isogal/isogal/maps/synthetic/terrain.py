"""The terrain and the gravity of the synthetic map.

Every number is a function of the place alone, so that tiles can be made one by one:

terrain     h = h0 + s·b + s·Σ octaves: noise from 120 km down to 1.1 km lattice spacing,
            amplitude ~ spacing^0.55, times a slowly varying relief s (log-normal), so that there
            are plains and mountains; mountains stand high (b).
gravity     2πGρ·Σ w_o·octaves - c at 2670 kg/m³. w_o = 1 - exp(-k_o D) compensates long waves
            isostatically (Airy, depth D; Watts 2001, Isostasy and Flexure of the Lithosphere,
            sec. 5.3). c is the terrain correction, half Gρ times the integral of (h - h_P)²/r³
            (Forsberg 1985, Bull. Geod. 59:342-360; the first order of Parker's series at the
            ground), by FFT.
long waves  noise from 1200 to 20 km lattice spacing, not correlated with the terrain, as of a
            geopotential model.

disturbance ``dg`` = gravity of the terrain + long waves; gravity ``ga`` = normal gravity at the
ground + dg. Cells of 0.002°, at the centres of GGMplus, rounded to 0.1 mGal as GGMplus is
(docs/mathematics.md, section 12.3); beside the real terrain of SE Australia: docs/maps.md."""

import math

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.gravity import normal_gravity
from isogal.maps.ggmplus.tiles import PER_DEGREE, STEP_DEG
from isogal.maps.interpolation import Grid, values_at
from isogal.maps.synthetic.lattice_noise import sum_of_octaves

SIZE_DEG = 1
CELLS = SIZE_DEG * PER_DEGREE
"""Cells along a side of a tile."""
QUANTA = {"disturbance": 1e-6, "gravity": 1e-6, "height": 1e-3}
"""Steps of the numbers kept: 0.1 mGal and 1 mm."""

_SEED = 84
_EARTH = 6.371e6
_PLATE = 2.0 * math.pi * 6.67430e-11 * 2670.0  # 2 pi G rho, 1/s²: 0.112 mGal per metre
_TERRAIN: Array = 120e3 / 1.8 ** np.arange(9.0)
_TERRAIN_RMS: Array = 210.0 * (_TERRAIN / _TERRAIN[0]) ** 0.55
_WAVELENGTH = 1.6  # of gradient noise, in lattice spacings
_COMPENSATION_DEPTH = 30e3
_BASE, _BASE_HEIGHT, _BASE_COMPENSATION = 50.0, 2.0, 0.2
_RELIEF = np.array([400e3, 200e3, 100e3])
_RELIEF_RMS = 0.85 * np.array([0.70, 0.55, 0.45])
_LONG = np.array([1200e3, 600e3, 300e3, 150e3, 80e3, 40e3, 20e3])
_LONG_RMS = 0.75e-5 * np.array([14.0, 14.0, 12.0, 8.0, 5.0, 3.0, 1.5])
_SMOOTH, _STRIDE = 20e3, 10  # octaves from this spacing (m) on are computed on every so many cells
_REACH = 10e3  # of the terrain correction, m
_MOST_COLUMNS = 600  # its reach near the poles, where meridians are close


def make_tile(south: int, west: int) -> dict[str, NDArray[np.int32]]:
    """Compute the tile with this south-west corner (deg): disturbance, gravity and height (500,
    500), in `QUANTA`."""
    height, attraction = terrain(south, west)
    long_waves = _octaves((south, west), (0, 0), _LONG, _LONG_RMS[None], _SEED + 2000)[0]
    disturbance = np.rint((attraction + long_waves) / QUANTA["disturbance"])
    ground = (
        normal_gravity(_axis(south, 0, CELLS)[:, None], height)
        + disturbance * QUANTA["disturbance"]
    )
    return {
        "disturbance": disturbance.astype(np.int32),
        "gravity": np.rint(ground / QUANTA["gravity"]).astype(np.int32),
        "height": np.rint(height / QUANTA["height"]).astype(np.int32),
    }


def terrain(south: int, west: int) -> tuple[Array, Array]:
    """Return height (m) and the attraction of the terrain (m/s²) on the cells of a tile, (500,
    500) each."""
    metres_north, metres_east = (
        STEP_DEG * math.radians(1.0) * m for m in metres_per_radian(math.radians(south + 0.5))
    )
    rows, columns = (
        math.ceil(_REACH / metres_north),
        min(math.ceil(_REACH / metres_east), _MOST_COLUMNS),
    )
    compensation = 1.0 - np.exp(-2.0 * math.pi / (_WAVELENGTH * _TERRAIN) * _COMPENSATION_DEPTH)
    weights = np.stack([_TERRAIN_RMS, _TERRAIN_RMS * compensation * _PLATE])
    rough, plate = _octaves((south, west), (rows, columns), _TERRAIN, weights, _SEED)
    scale = _octaves((south, west), (rows, columns), _RELIEF, _RELIEF_RMS[None], _SEED + 1000)[0]
    relief: Array = np.exp(scale - 0.5 * np.sum(_RELIEF_RMS**2))
    usual = _BASE_HEIGHT * math.sqrt(np.sum(_TERRAIN_RMS**2))
    base = usual * relief
    height = _BASE + base + relief * rough
    inner = np.s_[rows : rows + CELLS, columns : columns + CELLS]
    attraction = (relief * plate + _BASE_COMPENSATION * _PLATE * (base - usual))[inner]
    return height[inner], attraction - _terrain_correction(
        height, (rows, columns), (float(metres_north), float(metres_east))
    )


def _axis(corner: int, low: int, high: int, stride: int = 1) -> Array:
    """Return every ``stride``-th cell centre, rad, from cell ``low`` to before ``high`` of the
    tile at ``corner`` deg."""
    return np.radians(corner + STEP_DEG * (np.arange(low, high, stride) + 0.5))


def _octaves(
    corner: tuple[int, int], margin: tuple[int, int], spacing: Array, rms: Array, seed: int
) -> Array:
    """Return sums of octaves (P, rows, columns) on a tile (south, west deg) with a margin of so
    many cells.

    Octaves of more than `_SMOOTH` are computed on every `_STRIDE`-th cell, counted from the tile's
    corner so that tiles agree where they meet, and interpolated."""
    fine = [_axis(c, -m, CELLS + m) for c, m in zip(corner, margin, strict=True)]
    smooth = spacing >= _SMOOTH
    low = [-_STRIDE * (m // _STRIDE + 3) for m in margin]
    coarse = [
        _axis(c, start, CELLS - start, _STRIDE) for c, start in zip(corner, low, strict=True)
    ]
    rms_coarse, rms_fine = (np.ascontiguousarray(rms[:, which]) for which in (smooth, ~smooth))
    nodes = np.empty((rms.shape[0], coarse[0].size, coarse[1].size))
    out = np.empty((rms.shape[0], fine[0].size, fine[1].size))
    sum_of_octaves(*coarse, spacing[smooth] / _EARTH, rms_coarse, seed, nodes)
    sum_of_octaves(*fine, spacing[~smooth] / _EARTH, rms_fine, seed + 500, out)
    latitude, longitude = (axis.reshape(-1) for axis in np.meshgrid(*fine, indexing="ij"))
    step = math.radians(STEP_DEG * _STRIDE)
    for index, part in enumerate(nodes):
        grid = Grid(part, part.shape[0], coarse[0][0], step, coarse[1][0], step)
        out[index] += values_at(grid, latitude, longitude).reshape(out.shape[1:])
    return out


def _terrain_correction(height: Array, reach: tuple[int, int], cell: tuple[float, float]) -> Array:
    """Return G rho / 2 times the integral of (h - h_P)² / r³ (m/s²) over ``reach`` cells of size
    ``cell`` (m) around each P.

    The square multiplies out to two convolutions with 1/r³ and a constant, so that FFTs do it.
    """
    from scipy.fft import irfft2, next_fast_len, rfft2  # scipy.signal takes seconds to import

    north, east = (size * np.arange(-n, n + 1) for n, size in zip(reach, cell, strict=True))
    distance = np.hypot(north[:, None], east[None, :])
    near = (distance > 0.0) & (distance <= _REACH)
    kernel = np.divide(1.0, distance**3, out=np.zeros_like(distance), where=near)
    level = height - height.mean()  # keeps the differences below small against rounding
    here = level[reach[0] : -reach[0], reach[1] : -reach[1]]
    shape = [next_fast_len(size, real=True) for size in height.shape]
    spectrum = rfft2(kernel, shape)
    first, second = (
        irfft2(rfft2(power, shape) * spectrum, shape)[
            2 * reach[0] : height.shape[0], 2 * reach[1] : height.shape[1]
        ]  # where the kernel lies on the map
        for power in (level, level**2)
    )
    integral = second - 2.0 * here * first + here**2 * kernel.sum()
    return _PLATE / (4.0 * math.pi) * cell[0] * cell[1] * integral
