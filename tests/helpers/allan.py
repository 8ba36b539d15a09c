"""The Allan deviation, the oracle of slow errors of instruments."""

import numpy as np
from numpy.typing import ArrayLike


def allan_deviation(errors: np.ndarray, rate: float, taus: ArrayLike) -> np.ndarray:
    """Root of the mean overlapping Allan variance of several series (n, K) of a rate (Hz)
    (IEEE Std 952-1997, annex C)."""
    integral = np.cumsum(errors, axis=1) / rate
    result = []
    for m in (np.asarray(taus) * rate).astype(int):
        second = integral[:, 2 * m :] - 2.0 * integral[:, m:-m] + integral[:, : -2 * m]
        result.append(np.sqrt(np.mean(second**2) / 2.0) / (m / rate))
    return np.array(result)
