"""Banks of few models for the tests of `pmht`, and what they must be equal to."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from helpers.batches import field_map_of, make_batch
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch, Fix
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.pmht.models import Assumed, Models, models_of
from isogal.matching.pmht.states import UNKNOWN, States
from isogal.passage import History
from isogal.scenario import Matcher

SLOPE = np.array([4e-8, -3e-8])
PLANE = field_map_of(
    lambda north, east: SLOPE[0] * north + SLOPE[1] * east, half=60e3, step=2000.0
)
VELOCITY = np.array([14.0, 17.0])
LETTER = {"options": {"trust": 1.0}}
"""What is told is believed to the letter: one model."""


def pmht(**keys: Any) -> Pmht:
    """The matcher, told to the letter that the map is exact unless it is told something else."""
    exact = {"map_sigma": 0.0, **LETTER} if "map_sigma" not in keys else {}
    return Pmht.from_settings(Matcher(**(exact | keys)))


def states_of(channels: int = 1) -> States:
    """The instrument's states of plain readings."""
    more = len(UNKNOWN)
    return States(UNKNOWN, np.zeros(more), np.full(more, np.inf), np.zeros(more), channels, more)


def models(**keys: Any) -> Models:
    """Those of plain readings of 1 mGal on a map of 10 mGal."""
    return models_of(
        Assumed(**({"noise": 1e-5, "scale": 1e-4, "rough": 1e-5} | keys)),
        states_of(),
    )


HERE = np.eye(2, 8 + len(UNKNOWN))
"""Where a reading is taken per unit of the states: at the navigator's place."""


def random_bank(seed: int, count: int = 12, which: Models | None = None) -> Hypotheses:
    """Hypotheses of random models, places and covariances over all states."""
    random = np.random.default_rng(seed)
    which = models() if which is None else which
    n = 7 + which.initial.shape[1]
    of_instrument = [1e-5, 1e-9, 10.0, 1e-3, 1e-3, 10.0, 1e-4]
    scale = np.array([300.0, 300.0, 0.3, 0.3, 1e-4, 1e-4, 1e-3, 1.0, *of_instrument])
    roots = (np.eye(n) + 0.3 * random.standard_normal((count, n, n))) * scale[:, None]
    return Hypotheses(
        which,
        np.sort(random.integers(0, len(which.sigma), count)),
        random.normal(0.0, 2.0, count),
        random.standard_normal((count, n)) * scale,
        roots @ roots.swapaxes(1, 2),
    )


def moments_of(bank: Hypotheses) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of all states."""
    weight = np.exp(bank.log_weight - np.logaddexp.reduce(bank.log_weight))
    mean = weight @ bank.mean
    apart = bank.mean - mean
    return mean, np.einsum("k,kij->ij", weight, bank.covariance) + (apart.T * weight) @ apart


def posterior_of(fix: Fix, prior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of a navigator's error after a fix."""
    n = len(prior)
    matrix, vector = fix.information.matrix[:n, :n], fix.information.vector[:n]
    covariance = np.linalg.inv(np.linalg.inv(prior) + matrix)
    return covariance @ vector, covariance


def distances(batch: Batch) -> np.ndarray:
    """Between scans of a straight track, m."""
    away = np.hypot(*VELOCITY) * batch.time
    return np.abs(away[:, None] - away)


def noise_of(
    batch: Batch, map_sigma: float = 0.0, length: float = 4000.0, bias: float = 0.0
) -> np.ndarray:
    """(T, T) covariance of the readings' errors; a bias drifts as `pmht` assumes."""
    since = batch.time - batch.time[0]
    R = np.diag(batch.sigma**2) + map_sigma**2 * np.exp(-distances(batch) / length)
    return R + bias**2 * (1.0 + np.outer(since, since) / 10800.0**2)


def kalman(batch: Batch, R: np.ndarray, field_map: FieldMap = PLANE):
    """Posterior of xi on a plane, in closed form."""
    value, north, east = field_map.value_and_gradient(batch.latitude, batch.longitude)
    gradient = np.stack([north, east], axis=-1)
    H = -np.einsum("ti,tij->tj", gradient, batch.transition) + batch.reading_jacobian
    information = H.T @ np.linalg.solve(R, H)
    covariance = np.linalg.inv(np.linalg.inv(batch.prior) + information)
    return covariance @ H.T @ np.linalg.solve(R, batch.reading - value), covariance


def by_grid(batch: Batch, field_map: FieldMap, R: np.ndarray, half: float, step: float):
    """Places (N, 2) of a grid of errors and their exact probabilities, where the velocity is as
    good as known."""
    side = np.arange(-half, half + step / 2, step)
    place = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    north, east = metres_per_radian(batch.latitude)
    there = field_map.value(
        batch.latitude - place[:, :1] / north, batch.longitude - place[:, 1:] / east
    )
    residual = (batch.reading - there).T
    log = -0.5 * (np.linalg.solve(np.linalg.cholesky(R), residual) ** 2).sum(axis=0)
    log -= 0.5 * np.einsum("ni,ij,nj->n", place, np.linalg.inv(batch.prior[:2, :2]), place)
    weight = np.exp(log - log.max())
    return place, weight / weight.sum()


def close(got, expected, within: float) -> None:
    """Assert that two means and covariances differ by less, in 1-sigmas."""
    mean, covariance = expected
    deviation = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((got[0] - mean) / deviation, 0.0, atol=within)
    np.testing.assert_allclose(
        (got[1] - covariance) / deviation / deviation[:, None], 0.0, atol=2.0 * within
    )


def flown(
    field_map: FieldMap,
    matcher: Pmht,
    legs: int,
    error=(100.0, -80.0, 0.02, 0.01),
    prior_sigma=(150.0, 0.03),
    *,
    taken: bool = True,
    change=lambda batch, number: batch,
    **keys: Any,
) -> Iterator[tuple[Batch, Fix, Any, np.ndarray]]:
    """Yield batch, fix, memory and the error before the fix of a navigator that flies straight
    with a constant velocity error, batch after batch; `taken` = takes the fixes. Other keys are
    those of `make_batch`."""
    scans, start = keys.pop("scans", 15), keys.pop("start", (-6000.0, -6000.0))
    error, memory, correction = np.array(error), None, None
    covariance = np.diag(np.repeat(np.square(prior_sigma), 2))
    age = 10.0 * scans
    forward = np.eye(4)
    forward[:2, 2:] = age * np.eye(2)
    for number in range(legs):
        if number:
            error, covariance = forward @ error, forward @ covariance @ forward.T
        batch, _ = make_batch(
            field_map, error, scans,
            start=np.array(start) + VELOCITY * age * number,
            time=1000.0 + age * number + 10.0 * np.arange(scans),
            prior=covariance, history=History(correction), **({"seed": number} | keys),
        )  # fmt: skip
        batch = change(batch, number)
        fix, memory = matcher.match(batch, field_map, memory)
        yield batch, fix, memory, error
        correction = np.zeros(7)
        if taken and fix.published:
            mean, covariance = posterior_of(fix, covariance)
            error = error - mean
            correction[:4] = -mean
        if fix.widening is not None:
            covariance = covariance + fix.widening[:4, :4]


def with_map_error(batch: Batch, sigma: float, length: float, seed: int) -> Batch:
    """The batch with an error of the map drawn along the track."""
    root = np.linalg.cholesky(np.exp(-distances(batch) / length) + 1e-12 * np.eye(len(batch)))
    drawn = np.random.default_rng(seed).standard_normal(len(batch))
    return replace(batch, reading=batch.reading + sigma * root @ drawn)
