"""The track of a voyage, afterwards: what the smoother needs of readings and fixes is kept under
way, and the readings' errors are what the matcher has found them to be."""

import math
from collections.abc import Sequence

import numpy as np

from isogal.arrays import Array
from isogal.fix import LOST_COVARIANCE, Fix
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import Measurement, Widening
from isogal.fusion.relinearised import Readings, smoothed_by_readings
from isogal.fusion.state import FilterState
from isogal.maps.channels import RouteMap, channels_of
from isogal.scenario import Scenario
from isogal.sensors.reduction import Reduction

LIKELY = 0.5
"""Probability from which on a fault of the instrument is taken for true."""
FAULTS = "noisier", "late", "filtered", "shaken", "coarse"
"""What a reading as a measurement does not model (`isogal.matching.pmht.models`)."""


class Afterwards:
    """Keeps readings and fixes of one navigator.

    Parameters
    ----------
    scenario : Scenario
    maps : sequence of RouteMap
        Of each field.
    reductions : sequence of Reduction
    """

    def __init__(
        self, scenario: Scenario, maps: Sequence[RouteMap], reductions: Sequence[Reduction]
    ) -> None:
        self._fields, self._maps = scenario.each_field, tuple(maps)
        self._names, self._reductions = scenario.field_names, tuple(reductions)
        self._read: list[list[tuple[Array, Array]]] = [[] for _ in self._fields]
        self._of_fixes: set[int] = set()
        self._kept: list[Measurement] = []
        self._lost: Widening | None = None
        self._since = -math.inf
        self._figures: dict[str, float] = {}

    def read(self, field: int, time: Array, readings: Array) -> None:
        """Keep readings as sensed, see `isogal.navigator.Navigator.read`."""
        self._read[field].append((np.array(time, dtype=float), np.array(readings, dtype=float)))

    def fixed(self, fix: Fix, measurements: Sequence[Measurement]) -> None:
        """Keep what a fix consists of."""
        self._kept += measurements  # as long as their identities are asked for
        self._of_fixes |= {id(one) for one in measurements}
        self._figures = dict(fix.diagnostics) or self._figures
        if fix.reset:
            self._lost, self._since = Widening(LOST_COVARIANCE), fix.time

    def smoothed(self, navigator: InertialNavigator, time: Array) -> list[FilterState]:
        """Return the states at times (K,), s, rising: by the readings themselves where their
        errors are known and the history is whole, else by the fixes."""
        readings = self._readings() if math.isinf(navigator.horizon) else None
        if readings is None:
            return navigator.smoothed(time)
        return smoothed_by_readings(
            navigator,
            readings,
            time,
            of_fixes=lambda one: id(one) in self._of_fixes,
            lost=None if self._lost is None else self._lost.covariance,
            since=self._since,
        )

    def _readings(self) -> list[Readings] | None:
        """Return the readings of all fields with their errors; None where these are not such as a
        measurement models."""
        found = []
        for field, read in enumerate(self._read):
            if not read or not self._figures:
                return None
            errors = self._errors(field)
            channels = channels_of(self._maps[field])
            sensed = np.concatenate([readings for _, readings in read])
            if errors is None or len(channels) > 1 or sensed.ndim > 1:
                return None
            found.append(
                Readings(
                    np.concatenate([time for time, _ in read]),
                    sensed,
                    self._reductions[field],
                    channels[0],
                    self._fields[field].gravimeter.sigma ** 2
                    + channels[0].quantisation ** 2 / 12.0,
                    *errors,
                )
            )
        return found

    def _errors(self, field: int) -> tuple[tuple[AuxiliaryState, ...], str] | None:
        """Return the slow errors of a field's readings, and which of them grows with time; None
        where there are others."""
        scenario, settings = self._fields[field], self._fields[field].gravimeter
        prefix = "" if field == 0 else f"{self._names[field]}."
        figures, name = self._figures, self._names[field]
        others = settings.filter_time, settings.delay, settings.delay_sigma
        others += settings.cross_coupling, settings.platform_tilt
        if any(others) or any(figures.get(prefix + fault, 0.0) > LIKELY for fault in FAULTS):
            return None
        if figures.get(f"{prefix}navigator", 0.0) > LIKELY and self._lost is None:
            return None
        sigma: float | str = scenario.matcher.map_sigma
        length = scenario.matcher.map_correlation_length
        if isinstance(sigma, str):
            if f"{prefix}map_sigma" not in figures:
                return None
            sigma = figures[f"{prefix}map_sigma"]
            length = figures[f"{prefix}map_correlation_length_m"]
        bias, drift = scenario.matcher.bias_sigma, 0.0
        states = [
            AuxiliaryState(f"map of {name}", "none", 0, float(sigma), length=length),
            AuxiliaryState(f"bias of {name}", "none", 0, bias, walk=settings.bias_walk),
            AuxiliaryState(f"drift of {name}", "none", 0, drift),
            AuxiliaryState(
                f"noise of {name}",
                "none",
                0,
                settings.correlated_sigma,
                time=settings.correlation_time,
            ),
        ]
        if figures.get(f"{prefix}biased", 0.0) > LIKELY:
            return None
        used = tuple(one for one in states if one.sigma > 0.0)
        return used, f"drift of {name}" if drift > 0.0 else ""
