"""How wrong a map is, by tracks whose positions are known (docs/mathematics.md, section 10.4).

Of such a track the shift is known, so that its evidence is of the models of the map's error alone.
Their posterior by all reference tracks gives the map a 1-sigma and a correlation length, which
for other tracks count as said by the map."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import softmax

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import SecondaryBatch
from isogal.scenario import Matcher
from isogal.tracks.continued_map import rms_gradient
from isogal.tracks.evidence import GRADIENT_SHARE, Seen
from isogal.tracks.fields import TrackField
from isogal.tracks.matching import Uncertainty
from isogal.tracks.models import BY_GRADIENT, pattern_of
from isogal.tracks.track import Track


def with_learnt_error(references: Sequence[Track], field_map: FieldMap) -> tuple[FieldMap, float]:
    """Return a map with the error that tracks with true positions show, a 1-sigma at each node and
    its correlation length: place by place in the proportions that the map says, or even; and as
    far as they show it with its gradient. And the RMS of the 1-sigma along the tracks.

    Raises
    ------
    InputError
        None of the tracks has enough readings on the map.
    """
    nowhere, field_map = np.zeros((1, 2)), field_map.resolved
    fields = [TrackField("", track, field_map) for track in references]
    prior = Uncertainty(position=1.0).prior
    batches = [one.batch(slice(None), len(one.track), np.zeros(4), prior) for one in fields]
    found = [Seen.of(SecondaryBatch(0, batch, field_map), Matcher(), "") for batch in batches]
    seen = [one.placed(nowhere, np.ones(1)) for one in found if one is not None]
    if not seen:
        raise InputError("no reference track lies on the map")
    models = seen[0].models
    every = np.arange(len(models.sigma))
    log = models.log_prior + sum(
        one.at(nowhere, 0.0, every).parts.sum(axis=(1, 2)) for one in seen
    )
    weight = softmax(log)
    square = np.mean([one.map_sigma**2 for one in seen], axis=0)
    sigma = math.sqrt(float(weight @ square))
    of_gradient = GRADIENT_SHARE * float(weight @ (pattern_of(models) == BY_GRADIENT))
    latitude = np.concatenate([one.latitude for one in references])
    longitude = np.concatenate([one.longitude for one in references])

    def share(nodes: Array) -> Array:
        """Return the variance at nodes, where its mean along the tracks is 1."""
        along = field_map.linear(nodes, latitude, longitude)
        return np.asarray(nodes**2 / np.nanmean(along**2))

    own = np.broadcast_to(field_map.sigma if field_map.usual_sigma else 1.0, field_map.shape)
    variance = (1.0 - of_gradient) * share(own) + of_gradient * share(rms_gradient(field_map))
    length = math.exp(float(weight @ np.log(models.length)))
    learnt = replace(field_map, sigma=sigma * np.sqrt(variance), correlation_length=length)
    return learnt, sigma


def reading_sigma(references: Sequence[Track], field_map: FieldMap) -> float:
    """Return the 1-sigma of readings by what varies from one to the next of tracks with true
    positions, the map's own error over so short a way included: the RMS of successive differences
    of residuals over the root of two (von Neumann et al. 1941, Ann. Math. Stat. 12:153-162). Of
    readings that are the map's own values a millionth of its spread."""
    residuals = (
        one.value - one.offset - field_map.value(one.latitude, one.longitude) for one in references
    )
    steps = np.concatenate([np.diff(one[np.isfinite(one)]) for one in residuals])
    return max(math.sqrt(0.5 * float(np.mean(steps**2))), 1e-6 * field_map.scale)
