"""Terms of the Tolles-Lawson model (docs/magnetometer.md, section 2)."""

import numpy as np

from isogal.arrays import Array

SCALE = 50_000.0
"""nT, field at which a coefficient of the induced and eddy terms is a number of nT."""
_AXES = "xyz"
_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
PERMANENT = tuple(_AXES)
INDUCED = tuple(_AXES[i] + _AXES[j] for i, j in _PAIRS)
EDDY = tuple(a + b for a in _AXES for b in _AXES)
COUNT = len(PERMANENT) + len(INDUCED) + len(EDDY)
"""Terms without those of currents."""


def terms(vector: Array, rate: Array, total: Array, currents: Array | None = None) -> Array:
    """Return the terms (..., 18 + 3 K) whose sum with the coefficients is what the vehicle adds to
    the total field (Tolles & Lawson 1950; Leliak 1961; in this form Gnadt et al. 2022).

    With the direction cosines u = vector / total, in this order: permanent u_i; induced u_i v_j /
    `SCALE` for i <= j; eddy u_i dv_j/dt / `SCALE`; and for each measured current I u_i I.

    Parameters
    ----------
    vector : (..., 3) array
        Field in body axes, nT, as a vector magnetometer on board measures it.
    rate : (..., 3) array
        Its rate of change, nT/s.
    total : (...) array
        Total field, nT. That of the scalar magnetometer keeps the terms linear in the vector's
        components, so that its scale and misalignment are absorbed by the coefficients.
    currents : (..., K) array, optional
        A.
    """
    u = vector / total[..., None]
    induced = np.stack([u[..., i] * vector[..., j] for i, j in _PAIRS], axis=-1)
    eddy = (u[..., :, None] * rate[..., None, :]).reshape(*u.shape[:-1], 9)
    parts = [u, induced / SCALE, eddy / SCALE]
    if currents is not None and currents.shape[-1]:
        flow = currents[..., :, None] * u[..., None, :]
        parts.append(flow.reshape(*u.shape[:-1], -1))
    return np.concatenate(parts, axis=-1)


def names(currents: tuple[str, ...] = ()) -> list[str]:
    """Return the name of each term."""
    return [
        *(f"permanent {name}" for name in PERMANENT),
        *(f"induced {name}" for name in INDUCED),
        *(f"eddy {name}" for name in EDDY),
        *(f"current {name} {axis}" for name in currents for axis in _AXES),
    ]
