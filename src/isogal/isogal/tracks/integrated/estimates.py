"""What a batch says of the errors of map and readings."""

import math
from collections.abc import Mapping

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.tracks.integrated.search import ShiftPosterior

OUTLIER_SIGMA = 6.0
"""1-sigmas beyond which a row, predicted from all others, is left out."""


def figures(posterior: ShiftPosterior) -> Mapping[str, float]:
    """Return estimates with their names; lengths in m, the rest in the map's unit."""
    models, weight = posterior.models, posterior.by_model
    lengths = np.log([c.length for c in models.correlations])
    shape = np.array([math.sqrt(float(np.mean(d**2))) for d in _shapes(posterior)])
    sigma = shape[:, None] * models.scales
    offset, offset_sigma, misfit = _at_best(posterior)
    return {
        "map_sigma": float(np.einsum("ijkb,jk->", weight, sigma)),
        "map_correlation_length": math.exp(float(np.einsum("ijkb,i->", weight, lengths))),
        "map_error_by_gradient": float(weight[:, 1:].sum()),
        "offset": offset,
        "offset_sigma": offset_sigma,
        "readings": float(posterior.readings.count),
        "misfit": misfit,
        "probability": posterior.probability,
        "places": float(posterior.places),
    }


def outliers(posterior: ShiftPosterior) -> Booleans:
    """Return (m,) which rows do not fit the others at the likeliest shift: residuals e of each row
    predicted from the others, with e_i = (R⁻¹ r)_i / (R⁻¹)_ii and variance 1 / (R⁻¹)_ii
    (Rasmussen & Williams 2006, eq. 5.12)."""
    precision = np.linalg.inv(_best_covariance(posterior))
    residual = posterior.residual[:, int(np.argmax(posterior.weight))]
    return np.asarray(np.abs(precision @ residual) > OUTLIER_SIGMA * np.sqrt(np.diag(precision)))


def _shapes(posterior: ShiftPosterior) -> list[Array]:
    return [posterior.around.shapes[name] for name in posterior.models.shapes]


def _best_covariance(posterior: ShiftPosterior, with_offset: bool = True) -> Array:
    i, j, k, b = np.unravel_index(np.argmax(posterior.by_model), posterior.by_model.shape)
    models = posterior.models
    return posterior.around.covariance(
        models.correlations[i],
        models.shapes[j],
        models.scales[k],
        models.offsets[b] if with_offset else 0.0,
    )


def _at_best(posterior: ShiftPosterior) -> tuple[float, float, float]:
    """Return the readings' offset, its 1-sigma, and the misfit per row by the likeliest noise
    model, with the residuals of the posterior's mean."""
    residual = posterior.residual @ posterior.weight
    precision = np.linalg.inv(_best_covariance(posterior, with_offset=False))
    prior = float(posterior.models.offsets.max())
    known = float(precision.sum()) + (1.0 / prior**2 if prior > 0.0 else math.inf)
    offset = float(precision.sum(axis=0) @ residual) / known
    left = residual - offset
    return offset, 1.0 / math.sqrt(known), float(left @ precision @ left) / residual.size
