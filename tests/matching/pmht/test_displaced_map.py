"""A gridded map that shows its anomalies beside their place, as between a survey's lines."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.bank import flown, pmht, posterior_of
from helpers.batches import field_map_of, wavy
from isogal.evaluation.consistency import nees_per_axis
from isogal.maps.error_ellipses import ellipses_of

LENGTH, SIGMA = 2000.0, 4e-5
BESIDE = ((69.0, 164.0), (66.0, -261.0), (181.0, 89.0))
"""m; drawn with 200 m, where the map says 210 to 230 m."""


class OnDisplacedMap:
    """A matcher whose map is not where the readings were taken."""

    def __init__(self, by: tuple[float, float], *, lengths: bool) -> None:
        def beside(north, east):
            return wavy(north - by[0], east - by[1])

        plain = field_map_of(beside)
        ellipse = ellipses_of(*(np.array(one) for one in (LENGTH, LENGTH, 0.0)))
        nodes = np.broadcast_to(ellipse, (*plain.shape, 3)) if lengths else None
        self.matcher = pmht(map_sigma="auto")
        self.field_map = field_map_of(
            beside,
            sigma=np.full(plain.shape, SIGMA),
            correlation_length=LENGTH,
            error_ellipses=nodes,
        )

    def match(self, batch, _, memory):
        """Match a batch on the displaced map."""
        return self.matcher.match(batch, self.field_map, memory)


def nees_of(matcher: OnDisplacedMap) -> np.ndarray:
    """Per axis of a navigator that knows its place to 20 m, after each of ten fixes."""
    legs = flown(
        field_map_of(wavy),
        matcher,
        legs=10,
        scans=10,
        error=(15.0, -10.0, 0.0, 0.0),
        prior_sigma=(20.0, 0.02),
        sigma=1e-6,
    )
    result = []
    for batch, fix, _, error in legs:
        mean, covariance = np.zeros(4), batch.prior
        if fix.published:
            mean, covariance = posterior_of(fix, batch.prior)
        result.append(nees_per_axis(error[:2] - mean[:2], covariance[:2, :2]))
    return np.array(result)


def test_a_sure_navigator_is_not_pulled_away():
    nees = [nees_of(OnDisplacedMap(by, lengths=True)).mean() for by in BESIDE]
    assert np.mean(nees) < 1.5


@pytest.mark.filterwarnings("error")
def test_a_map_that_lacks_the_usual_length_is_believed():
    matcher = OnDisplacedMap(BESIDE[0], lengths=True)
    matcher.field_map = replace(matcher.field_map, correlation_length=None)
    assert nees_of(matcher).mean() > 8.0


def test_a_map_that_does_not_say_its_lengths_is_believed():
    assert nees_of(OnDisplacedMap(BESIDE[0], lengths=False)).mean() > 8.0
