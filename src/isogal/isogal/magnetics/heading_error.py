"""How much of a magnetometer's readings depends on heading."""

import numpy as np

from isogal.arrays import Array

SECTORS = 8


def by_heading(heading: Array, residual: Array) -> Array:
    """Return (8,) the mean of residuals (N,) on headings (N,; rad) around north, north-east, ...;
    NaN where there are none."""
    sector = np.round(heading / (2.0 * np.pi) * SECTORS).astype(int) % SECTORS
    known = np.isfinite(residual)
    return np.array(
        [
            residual[known & (sector == k)].mean() if (known & (sector == k)).any() else np.nan
            for k in range(SECTORS)
        ]
    )


def heading_error(heading: Array, residual: Array) -> float:
    """Return the largest difference between such means. Where the residuals hold an anomaly, that
    is in it, too."""
    means = by_heading(heading, residual)
    return float(np.nanmax(means) - np.nanmin(means))
