"""Stage 1 of `pmht`: what is assumed of a batch before it is matched."""

from dataclasses import replace

import numpy as np

from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture, largest_sigma
from isogal.matching.pmht.map_error import MapErrorEstimate
from isogal.matching.pmht.memory import Memory, prior_of
from isogal.matching.pmht.noise_model import NoiseModel, uneven
from isogal.matching.pmht.sensor_bias import BiasEstimate
from isogal.matching.pmht.settings import Settings
from isogal.matching.pmht.state import State, Verdict, likelihood_of
from isogal.matching.usability import unusable


def refusal(batch: Batch, field_map: AnyMap, settings: Settings) -> str | None:
    """Return why a batch cannot be matched at all, in one line; None where it can."""
    if reason := unusable(batch):
        return reason
    channels = 1 if batch.channel is None else int(batch.channel.max()) + 1
    if channels > len(channels_of(field_map)):
        return f"the readings have {channels} channels, the map {len(channels_of(field_map))}"
    return None


def prepare(batch: Batch, field_map: AnyMap, memory: Memory | None, settings: Settings) -> State:
    """Return the state of a batch whose prior, noise model, bias and likelihood are known."""
    prior = prior_of(batch, memory)
    batch = without(batch, memory.outlier_times if memory else frozenset())
    batch = _shortened(batch, prior)
    estimate = _bias(batch, field_map, memory, settings)
    bias = None if estimate is None else estimate.at_end(batch)
    as_read, batch = batch, batch if bias is None else bias.added_to(batch)
    map_error = _map_error(batch, field_map, memory, settings)
    noise = settings.noise if map_error is None else map_error.model(settings.noise)
    if bias is not None:
        noise = without_bias(noise, field_map)
    factor = memory.variance_factor.value if memory else 1.0
    likelihood = likelihood_of(batch, field_map, noise, prior, factor)
    state = State(
        batch=batch,
        as_read=as_read,
        field_map=field_map,
        settings=settings,
        memory=memory,
        prior=prior,
        noise=noise,
        bias=bias,
        map_error=map_error,
        likelihood=likelihood,
        outlier=np.zeros(len(likelihood.rows), dtype=np.bool_),
        learnt=map_error,
        variance_factor=factor,
    )
    if not np.isfinite(batch.reading[-batch.new :]).any():
        return state.decided(Verdict("no new reading in the batch", hypotheses=prior))
    return state


def _shortened(batch: Batch, prior: Mixture) -> Batch:
    """Return a batch with fewer of its older readings where it has many and the place is searched
    for: they say next to nothing of it, and each of its many candidates asks for them all."""
    first = len(batch) - batch.new - batch.rows_per_scan * CONSTANTS.conditioning_readings
    many = len(batch) > CONSTANTS.search_batch_readings and first > 0
    wide = many and largest_sigma(prior.moments()[1]) > CONSTANTS.wide_prior_m
    return batch.part(first) if wide else batch


def without(batch: Batch, stamps: frozenset[float]) -> Batch:
    """Return the batch with the readings of the given stamps removed."""
    if not stamps:
        return batch
    drop = np.isin(batch.time, list(stamps))
    return replace(batch, reading=np.where(drop, np.nan, batch.reading))


def without_bias(noise: NoiseModel, field_map: AnyMap) -> NoiseModel:
    """Return a noise model without the bias that is estimated along: that of one channel."""
    return noise if len(channels_of(field_map)) > 1 else replace(noise, bias_sigma=0.0)


def unknown_bias(batch: Batch, field_map: AnyMap, settings: Settings) -> BiasEstimate:
    """Return the prior of the readings' bias: as told, else that of who knows nothing."""
    sigma, drift = settings.noise.bias_sigma, settings.options.bias_drift_sigma
    if not sigma > 0.0:
        sigma = CONSTANTS.unknown_bias_share * channels_of(field_map)[0].scale
    drift = sigma / CONSTANTS.bias_drift_time_s if drift is None else drift
    more = batch.delay_sigma, batch.parameters
    return BiasEstimate.unknown(float(batch.time[0]), sigma, drift, *more)


def _bias(
    batch: Batch, field_map: AnyMap, memory: Memory | None, settings: Settings
) -> BiasEstimate | None:
    """Return what is known of the readings' bias; that of several channels is in R instead, beside
    their parameters."""
    estimate = memory.bias if memory else None
    if len(channels_of(field_map)) > 1:
        if estimate is None and batch.parameters is not None:
            start = float(batch.time[0])
            return BiasEstimate.unknown(start, 0.0, 0.0, parameters=batch.parameters)
        return estimate
    known = memory is not None and memory.unbiased
    possible = settings.noise.bias_sigma > 0.0 or (
        settings.adaptive and not known and not _states_error(field_map)
    )
    if estimate is None and possible:
        estimate = unknown_bias(batch, field_map, settings)
    more = batch.delay_sigma, batch.parameters
    if estimate is None and (batch.bias_walk > 0.0 or more != (0.0, None)):
        # no bias at first, but it will not stay so
        estimate = BiasEstimate.unknown(float(batch.time[0]), 0.0, 0.0, *more)
    return estimate


def _map_error(
    batch: Batch, field_map: AnyMap, memory: Memory | None, settings: Settings
) -> MapErrorEstimate | None:
    """Return what is known of the map error; None where it is not in question."""
    if memory is not None and memory.map_error is not None:
        return memory.map_error
    if settings.adaptive and not _states_error(field_map):
        return MapErrorEstimate.unknown(batch, field_map, settings.noise.correlation_length)
    if len(channels_of(field_map)) > 1 or uneven(field_map):
        return None
    noise = _stated(channels_of(field_map)[0], settings) if settings.adaptive else settings.noise
    if settings.options.trust == 1.0 or noise.map_sigma == 0.0:
        return None
    return MapErrorEstimate.told(noise, settings.options.trust)


def _states_error(field_map: AnyMap) -> bool:
    """Whether a map says how wrong it is."""
    return any(one.states_error for one in channels_of(field_map))


def _stated(field_map: FieldMap, settings: Settings) -> NoiseModel:
    """Return what a map that is equally wrong everywhere says of itself."""
    length = field_map.correlation_length or settings.noise.correlation_length
    sigma = float(np.nanmax(field_map.sigma))
    return replace(settings.noise, map_sigma=sigma, correlation_length=length)
