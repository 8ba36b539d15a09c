"""Posterior Cramér–Rao bound of a navigator that has readings of several fields: that of one
(`bound`), with the states of each field beside the navigator's own (docs/mathematics.md, section
11.1)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.evaluation.aids_model import AidsModel, aids_model
from isogal.evaluation.bound import (
    BoundResult,
    field_variances,
    map_correlation,
    readings_of,
)
from isogal.evaluation.bound_recursion import (
    Readings,
    discretise,
    propagate,
    step_map,
    update,
)
from isogal.evaluation.gravimeter_states import fill_slow
from isogal.evaluation.ins_error_model import (
    Segments,
    ageing,
    divide,
    fill_auxiliary,
    initial_covariance,
    noise_density,
)
from isogal.fields.known_gravity import true_residual_gravity
from isogal.fusion.auxiliary import auxiliary_of
from isogal.fusion.model import FilterModel
from isogal.inertial.error_model import STATES, fill_dynamics
from isogal.maps.channels import RouteMap
from isogal.matching.several import Rhythm
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class _Field:
    """One field's states, readings and what becomes of the states over a stretch."""

    variance: Array
    """(n,) at the start: the map's error by channel, slow errors, bias and drift."""
    transition: Array
    """(n, n), but for the map's error."""
    half_noise: Array
    """(n, n)."""
    correlation: Array
    """(S,) of the map's error over each stretch."""
    readings: Readings
    every: int
    """Scans of the run from one of its own to the next."""
    aids: AidsModel

    @classmethod
    def of(
        cls,
        whole: Scenario,
        one: Scenario,
        model: FilterModel,
        segments: Segments,
        trajectory: Trajectory,
        field_map: RouteMap,
    ) -> "_Field":
        readings = readings_of(one, trajectory, field_map)
        variance, count = field_variances(one, trajectory, readings), readings.map_states
        transition = np.diag(np.ones(len(variance)))
        half_noise = np.zeros_like(transition)
        fill_slow(transition, half_noise, readings.slow, 0, segments.dt)
        transition[-2, -1] = segments.dt
        scans = np.arange(1, len(readings.slope) + 1) * one.steps_per_scan
        height = trajectory.height[scans]
        return cls(
            variance,
            transition,
            half_noise,
            np.repeat(map_correlation(one, segments)[:, None], count, axis=1),
            readings,
            one.steps_per_scan // whole.steps_per_scan,
            aids_model(one, model, segments, readings.slope, height),
        )

    def age(self, k: int, transition: Array, half_noise: Array) -> None:
        """Write what becomes of the states over stretch k."""
        transition[:], half_noise[:] = self.transition, self.half_noise
        if self.readings.map_steps.joint:
            return
        for j, c in enumerate(self.correlation[k]):
            transition[j, j] = c
            half_noise[j, j] = self.variance[j] * (1.0 - c**2) / (1.0 + c**2)

    def step_map(self, scan: int, first: int, covariances: Sequence[Array], work: Array) -> None:
        """Let the map's errors that go on together do so to a scan of the run, counted from 1, in
        place; see `rows`."""
        steps, (own, rest) = self.readings.map_steps, divmod(scan, self.every)
        if steps.joint and not rest and own <= len(steps.gain):
            for covariance in covariances:
                step_map(covariance, steps.gain[own - 1], steps.root[own - 1], first, work)

    def rows(self, scan: int, size: int, first: int) -> list[tuple[Array, float]]:
        """Return derivatives (size,) by all states, the field's own from `first` on, and noise of
        the readings at a scan of the run, counted from 1."""
        own, rest = divmod(scan, self.every)
        if rest or own > len(self.readings.slope):
            return []
        k, readings, found = own - 1, self.readings, []
        filtered = readings.slow.filter_time > 0.0
        end = first + len(self.variance)
        for channel, noise in enumerate(readings.noise):
            sensitivity = readings.sensitivity[k, channel]
            if np.isnan(sensitivity).any():
                continue
            row = np.zeros(size)
            row[:4] = sensitivity
            by_height = self.aids.by_height[k]
            common = readings.common[channel]
            row[STATES : STATES + len(by_height)] = common * by_height
            row[first + readings.map_states : end - 2] = (
                readings.slow.of_channel[channel] * readings.slow.share[k]
            )
            row[end - 3 if filtered else first + channel] = readings.map_share[k]
            row[end - 2] = common
            found.append((row, float(noise)))
        return found


def joint_bound(
    scenario: Scenario,
    trajectory: Trajectory,
    maps: Sequence[RouteMap],
    *,
    batchwise: bool = False,
) -> BoundResult:
    """Return the bound of a navigator that uses every reading of every field at once; see
    `isogal.evaluation.bound.posterior_cramer_rao`."""
    world = scenario.world
    worlds = [one.world for one in scenario.each_field]
    segments = divide(world, trajectory)
    felt = scenario.felt_field.world
    model = FilterModel.from_scenario(world, true_residual_gravity(felt, trajectory))
    fields = [
        _Field.of(world, one, model, segments, trajectory, its_map)
        for one, its_map in zip(worlds, maps, strict=True)
    ]
    lead = Rhythm.of(worlds).lead
    scans = len(segments.geometry) // segments.per_scan
    used = np.ones(scans, dtype=np.bool_)
    if batchwise:
        own = readings_of(worlds[lead], trajectory, maps[lead], batchwise=True).used
        used[:] = False
        used[fields[lead].every - 1 :: fields[lead].every] = own
    covariance = _recursion(world, model, segments, fields, used)
    time = trajectory.time[np.arange(scans + 1) * world.steps_per_scan]
    return BoundResult(time, covariance)


def _recursion(
    scenario: Scenario,
    model: FilterModel,
    segments: Segments,
    fields: Sequence[_Field],
    used: Booleans,
) -> Array:
    """Return (scans + 1, 2, 2) the position covariances: `bound_recursion.riccati` with the states
    of several fields."""
    m = STATES + len(model.auxiliary)
    firsts = np.cumsum([m, *(len(one.variance) for one in fields)])
    n = int(firsts[-1])
    P = np.zeros((n, n))
    P[:m, :m] = initial_covariance(scenario, model.auxiliary)
    for first, one in zip(firsts[:-1], fields, strict=True):
        here = slice(first, first + len(one.variance))
        P[here, here] = np.diag(one.variance)
    alone, result = P.copy(), np.empty((len(used) + 1, 2, 2))
    result[0] = P[:2, :2]
    transition, half_noise, work = np.zeros((n, n)), np.zeros((n, n)), np.empty((2, n, n))
    navigator = _Navigator(scenario, model, segments)
    aids = fields[0].aids
    for k in range(len(segments.geometry)):
        navigator.age(k, transition, half_noise)
        for first, one in zip(firsts[:-1], fields, strict=True):
            here = slice(first, first + len(one.variance))
            one.age(k, transition[here, here], half_noise[here, here])
        for covariance in (P, alone):
            propagate(covariance, transition, half_noise, work)
            if (k + 1) % aids.every == 0:
                for velocity in aids.velocity[k]:
                    update(covariance, np.concatenate([velocity, np.zeros(n - m)]), aids.noise)
        scan, rest = divmod(k + 1, segments.per_scan)
        if rest:
            continue
        for first, one in zip(firsts[:-1], fields, strict=True):
            one.step_map(scan, int(first), (P, alone), work)
            for row, noise in one.rows(scan, n, int(first)):
                update(P, row, noise)
        if used[scan - 1]:
            alone[:] = P
        result[scan] = alone[:2, :2]
    return result


class _Navigator:
    """What becomes of the navigator's own states over each stretch."""

    def __init__(self, scenario: Scenario, model: FilterModel, segments: Segments) -> None:
        self._segments, self._density = segments, noise_density(scenario)
        self._states = auxiliary_of(model.auxiliary)
        self._correlation, self._half_noise = ageing(segments, model.auxiliary)
        self._size = m = STATES + len(model.auxiliary)
        # `discretise` writes two states behind them
        self._F = np.zeros((m, m))
        self._transition, self._noise = np.zeros((m + 2, m + 2)), np.zeros((m + 2, m + 2))

    def age(self, k: int, transition: Array, half_noise: Array) -> None:
        """Write transition and half of the noise of stretch k into the first rows and columns."""
        geometry, force, rotation, rate, dt, _ = self._segments
        m = self._size
        fill_dynamics(self._F, geometry[k], force[k], rotation[k])
        fill_auxiliary(self._F, self._states, force[k], rotation[k], rate[k])
        discretise(self._transition, self._noise, self._F, rotation[k], self._density, dt)
        transition[:m, :m], half_noise[:m, :m] = self._transition[:m, :m], self._noise[:m, :m]
        for j in range(STATES, m):
            transition[j, j] = self._correlation[k, j - STATES]
            half_noise[j, j] = self._half_noise[k, j - STATES]
