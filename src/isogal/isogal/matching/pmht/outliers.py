"""Readings that cannot be right, and whether a whole batch agrees with the map."""

import numpy as np

from isogal.arrays import Array, Booleans


def leave_one_out(residual: Array, covariance: Array) -> Array:
    """Return (T,) each residual's deviation from what the others predict for it, in its own
    1-sigma.

    For r ~ N(0, S): (S⁻¹ r)_i / sqrt((S⁻¹)_ii) (Rasmussen & Williams 2006, eqs. 5.10-5.12).
    """
    inverse = np.linalg.inv(covariance)
    return (inverse @ residual) / np.sqrt(np.diag(inverse))


def outliers(residual: Array, covariance: Array, gate: float, most: float = 0.4) -> Booleans:
    """Return (T,) which residuals are spikes: taken out worst first while the worst deviates by
    more than the gate.

    Parameters
    ----------
    residual : (T,) array
    covariance : (T, T) array
        Of the residuals, with everything smooth along the track in it.
    gate : float
        In 1-sigma.
    most : float
        Share of the residuals at most; a batch with more is not cleaned at all: then the model is
        wrong, not the readings.
    """
    bad = np.zeros(len(residual), dtype=np.bool_)
    for _ in range(int(most * len(residual)) + 1):
        keep = np.flatnonzero(~bad)
        if len(keep) < 3:
            break
        deviation = np.abs(leave_one_out(residual[keep], covariance[np.ix_(keep, keep)]))
        worst = int(np.argmax(deviation))
        if deviation[worst] <= gate:
            return bad
        bad[keep[worst]] = True
    return np.zeros(len(residual), dtype=np.bool_)


def smooth_misfit(latitude: Array, longitude: Array, sigma: float, length: float) -> Array:
    """Return (T, T) covariance sigma² exp(-d² / 2 length²) of a smooth misfit along the track
    (positions rad, length m).

    It stands for the wrong place's map values before the place is known: smooth over the map's
    features, unlike a spike."""
    from isogal.earth.frames import horizontal_difference

    apart = horizontal_difference(latitude[:, None], longitude[:, None], latitude, longitude)
    return sigma**2 * np.exp(-0.5 * (apart**2).sum(axis=-1) / length**2)
