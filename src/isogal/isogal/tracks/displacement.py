"""By how much a gridded map is displaced as a whole, where a track lies on it
(docs/mathematics.md, section 10.3).

Between a survey's lines a map repeats what is known beside them: anomalies that run aslant, in
directions that change from place to place, are found there, but not in their place. Along a track
this looks like a shift, of the size that turns the map's own variation into its error. No reading
tells it from a shift of the track. So it is a state of which nothing is learnt, with a prior by
the models of the map's error."""

import numpy as np

from isogal.arrays import Array
from isogal.tracks.places import Shifts

SIZE = 0.35
"""1-sigma of the displacement where a map tells nothing, in correlation lengths of the map's
error: measured (docs/evidence/real-data.md)."""


def displacement(shifts: Shifts) -> Array:
    """Return (2, 2) m², the covariance of the shift that displaced maps pass for; of several
    fields, whose maps are displaced independently, by what each says of the place."""
    each = [np.linalg.inv(shifts.covariance_by(field)) for field in range(len(shifts.seen))]
    whole = np.linalg.inv(sum(each))
    parts = [
        _variance(shifts, field) * whole @ one @ one @ whole for field, one in enumerate(each)
    ]
    return np.asarray(sum(parts))


def _variance(shifts: Shifts, field: int) -> float:
    """Return the variance per axis by a field's models, m²."""
    seen, which = shifts.seen[field], shifts.which[field]
    if not seen.gridded:
        return 0.0
    error, length = seen.map_sigma(which) ** 2, seen.models.length[which]
    size = (SIZE * length) ** 2 * error / np.maximum(error + seen.shown(shifts.likeliest), 1e-300)
    return float(shifts.of_models(field) @ size)
