"""The track of a whole voyage, afterwards.

Smoothing (`isogal.fusion.smoothing`) takes fixes as they were. One case it cannot settle: where
the navigator was found to be lost, what it had taken for fixes before was of wrong places. There
the readings themselves come in place of all fixes (`isogal.fusion.relinearised`), with errors as
the matcher has found them to be in the end. Elsewhere that gains nothing (measured:
docs/evidence/smoothing.md)."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.fields.measured import measured_field
from isogal.fix import LOST_COVARIANCE
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import Widening
from isogal.fusion.relinearised import Readings, smoothed_by_readings
from isogal.fusion.state import FilterState
from isogal.maps.channels import RouteMap, channels_of
from isogal.scenario import Assumed, Gravimeter, Matcher

LIKELY = 0.5
"""Probability from which on a fault is taken for true."""
FAULTS = "biased", "noisier", "late", "filtered", "shaken", "coarse"
"""Of instrument and map, which a reading as a measurement does not model
(`isogal.matching.pmht.models`)."""


class Sensed(NamedTuple):
    """All readings of a field."""

    time: Array
    """(K,) s."""
    readings: Array
    """(K,) or (K, C) as sensed; NaN = none."""

    @classmethod
    def joined(cls, parts: "Sequence[Sensed]") -> "Sensed":
        """Return several parts, one after the other."""
        return cls(*(np.concatenate(one) for one in zip(*parts, strict=True)))


def smoothed_voyage(
    navigator: InertialNavigator,
    time: Array,
    assumed: Assumed,
    maps: Sequence[RouteMap],
    sensed: Sequence[Sensed | None],
    figures: Mapping[str, float],
) -> list[FilterState]:
    """Return the states at times (K,), s, rising, as all data of a voyage have them.

    Parameters
    ----------
    navigator : InertialNavigator
        With its whole history; it is not changed.
    time : (K,) array
    assumed : Assumed
        Of instruments and maps.
    maps : sequence of RouteMap
        Of each field.
    sensed : sequence of Sensed
        Readings of each field; None = they are not known.
    figures : mapping
        What the last fix has said of map and readings (`isogal.fix.Fix.diagnostics`).
    """
    found_at = _lost(navigator)
    readings = None if found_at is None else readings_of(assumed, maps, sensed, figures)
    if found_at is None or readings is None:
        return navigator.smoothed(time)
    return smoothed_by_readings(navigator, readings, time, LOST_COVARIANCE, found_at)


def _lost(navigator: InertialNavigator) -> float | None:
    """Return when a navigator was found to be lost the last time, s; None = never."""
    found = None
    for segment in navigator.history(np.empty(0)):
        for one in segment.measurements:
            if isinstance(one, Widening) and one.covariance[0, 0] >= LOST_COVARIANCE[0, 0]:
                found = segment.end
    return found


def readings_of(
    assumed: Assumed,
    maps: Sequence[RouteMap],
    sensed: Sequence[Sensed | None],
    figures: Mapping[str, float],
) -> list[Readings] | None:
    """Return the readings of all fields with their errors; None where these are not such as a
    measurement models, or readings have several channels. Parameters as of `smoothed_voyage`."""
    found = []
    each = assumed.each_field
    for one, name, field_map, read in zip(each, assumed.field_names, maps, sensed, strict=True):
        prefix = "" if one is each[0] else f"{name}."
        of_field = {
            key.removeprefix(prefix): value
            for key, value in figures.items()
            if key.startswith(prefix)
        }
        errors = _errors(one.gravimeter, one.matcher, name, of_field)
        channels = channels_of(field_map)
        if errors is None or read is None or len(channels) > 1 or read.readings.ndim > 1:
            return None
        white = one.gravimeter.sigma**2 + channels[0].quantisation ** 2 / 12.0
        reduction = measured_field(one).reduction(one)
        found.append(Readings(*read, reduction, channels[0], white, errors))
    return found


def _errors(
    settings: Gravimeter, matcher: Matcher, name: str, figures: Mapping[str, float]
) -> tuple[AuxiliaryState, ...] | None:
    """Return the slow errors of a field's readings; None where there are others."""
    others = (
        *(settings.filter_time, settings.delay, settings.delay_sigma),
        *(settings.cross_coupling, settings.dynamic_pressure, settings.platform_tilt),
    )
    if any(others) or any(figures.get(fault, 0.0) > LIKELY for fault in FAULTS):
        return None
    sigma, length = matcher.map_sigma, matcher.map_correlation_length
    if isinstance(sigma, str):
        sigma = figures.get("map_sigma", math.nan)
        length = figures.get("map_correlation_length_m", math.nan)
    if math.isnan(sigma):
        return None
    noise, walk = settings.correlated_sigma, settings.bias_walk
    states = (
        AuxiliaryState(f"map of {name}", "none", 0, sigma, length=length),
        AuxiliaryState(f"bias of {name}", "none", 0, matcher.bias_sigma, walk=walk),
        AuxiliaryState(f"noise of {name}", "none", 0, noise, time=settings.correlation_time),
    )
    return tuple(one for one in states if one.sigma > 0.0)
