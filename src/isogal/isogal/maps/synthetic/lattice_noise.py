"""Gradient noise on the sphere: a smooth random field whose value at a place depends on that place
alone.

Perlin's lattice noise (Perlin 2002, "Improving noise", SIGGRAPH) in three dimensions, evaluated on
the unit sphere: isotropic everywhere, without seams at the date line or the poles. The gradient at
a lattice point comes from an integer hash of the point (the finaliser of SplitMix64, Steele et al.
2014), so nothing needs to be stored or generated in order."""

import math

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel

RMS = 0.270
"""RMS of one octave over the sphere, measured (tested)."""


@kernel(error_model="numpy")
def _corner(i: int, j: int, k: int, seed: np.uint64, x: float, y: float, z: float) -> float:
    """Return gradient · offset at a lattice point; the gradient is one of the twelve edge
    directions of a cube."""
    h = (
        seed
        ^ (np.uint64(i) * np.uint64(0x9E3779B97F4A7C15))
        ^ (np.uint64(j) * np.uint64(0xC2B2AE3D27D4EB4F))
        ^ (np.uint64(k) * np.uint64(0x165667B19E3779F9))
    )
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    h ^= h >> np.uint64(31)
    first = x if h & np.uint64(1) else -x
    second = y if h & np.uint64(2) else -y
    third = z if h & np.uint64(4) else -z
    axis = (h >> np.uint64(8)) % np.uint64(3)
    if axis == np.uint64(0):
        return first + second
    if axis == np.uint64(1):
        return second + third
    return first + third


@kernel(error_model="numpy")
def gradient_noise(x: float, y: float, z: float, seed: np.uint64) -> float:
    """Return the noise at a point; zero mean, RMS `RMS`, twice continuously differentiable.

    Parameters
    ----------
    x, y, z : float
        In units of the lattice.
    seed : uint64
        Each gives another field.
    """
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    x, y, z = x - i, y - j, z - k
    u = x * x * x * (x * (x * 6.0 - 15.0) + 10.0)
    v = y * y * y * (y * (y * 6.0 - 15.0) + 10.0)
    w = z * z * z * (z * (z * 6.0 - 15.0) + 10.0)
    a = (1.0 - u) * _corner(i, j, k, seed, x, y, z) + u * _corner(i + 1, j, k, seed, x - 1.0, y, z)
    b = (1.0 - u) * _corner(i, j + 1, k, seed, x, y - 1.0, z) + u * _corner(
        i + 1, j + 1, k, seed, x - 1.0, y - 1.0, z
    )
    c = (1.0 - u) * _corner(i, j, k + 1, seed, x, y, z - 1.0) + u * _corner(
        i + 1, j, k + 1, seed, x - 1.0, y, z - 1.0
    )
    d = (1.0 - u) * _corner(i, j + 1, k + 1, seed, x, y - 1.0, z - 1.0) + u * _corner(
        i + 1, j + 1, k + 1, seed, x - 1.0, y - 1.0, z - 1.0
    )
    return (1.0 - w) * ((1.0 - v) * a + v * b) + w * ((1.0 - v) * c + v * d)


@kernel(error_model="numpy")
def sum_of_octaves(
    latitude: Array, longitude: Array, spacing: Array, amplitude: Array, seed: int, out: Array
) -> None:
    """Fill a grid with a sum of octaves.

    Parameters
    ----------
    latitude, longitude : (n,), (m,) rad
        Axes.
    spacing : (O,)
        Lattice spacing of each octave, in Earth radii.
    amplitude : (P, O)
        RMS of each octave in each of P sums of the same octaves.
    seed : int
        Each octave has its own lattice.
    out : (P, n, m)
        Filled.
    """
    for i in range(latitude.shape[0]):
        sin_lat, cos_lat = math.sin(latitude[i]), math.cos(latitude[i])
        for j in range(longitude.shape[0]):
            x, y = cos_lat * math.cos(longitude[j]), cos_lat * math.sin(longitude[j])
            for p in range(out.shape[0]):
                out[p, i, j] = 0.0
            for o in range(spacing.shape[0]):
                scale = 1.0 / spacing[o]
                lattice = np.uint64(seed * 1000003 + o * 7919 + 1)
                noise = gradient_noise(x * scale, y * scale, sin_lat * scale, lattice) / RMS
                for p in range(out.shape[0]):
                    out[p, i, j] += amplitude[p, o] * noise
