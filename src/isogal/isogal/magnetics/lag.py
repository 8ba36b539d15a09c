"""Lag of the vector magnetometer behind the scalar one (docs/magnetometer.md, section 3.3).

A cross-correlation with a model that is fitted once does not see it, since a short lag looks like
eddy currents. So the model is fitted anew at each shift, and the one that leaves least is
taken."""

from collections.abc import Callable

import numpy as np

LONGEST = 1.0
"""s, beyond which no lag is looked for."""
_COARSE = 0.2
"""s between the shifts that are tried first."""
_GAIN = 0.85
"""Of what is left without a lag: less must be left with it. Otherwise the lag is zero."""


def find_lag(left: Callable[[float], float]) -> float:
    """Return the lag, s, with which a fit leaves least; zero if that is hardly less than without.

    Parameters
    ----------
    left : function
        Returns the RMS that a fit leaves at a lag, s.
    """
    from scipy.optimize import minimize_scalar

    shifts = np.arange(-LONGEST, LONGEST + 0.5 * _COARSE, _COARSE)
    tried = [left(float(shift)) for shift in shifts]
    best = float(shifts[int(np.argmin(tried))])
    found = minimize_scalar(
        left, bounds=(best - _COARSE, best + _COARSE), method="bounded", options={"xatol": 1e-3}
    )
    return float(found.x) if found.fun < _GAIN * left(0.0) else 0.0
