"""Posterior Cramér–Rao bound of the aided navigator (docs/mathematics.md, section 11.1).

Along one true trajectory the bound's information recursion (Tichavský, Muravchik, Nehorai, IEEE
Trans. Signal Processing 46(5), 1998; Taylor 1979 for a given trajectory) is the Riccati recursion
of the navigator's linear error model, with the measurement matrix taken at the truth. A reading
compares the map at the navigator's position with the field at the true one, so it depends on the
position error by the map's gradient, on velocity and latitude errors by the reductions, on the
map's own error and on white noise. The map's error, a field with covariance sigma² exp(-d / L), is
along the track a first-order Gauss-Markov process, which adds a state. The sensor's bias and its
drift add two more, its noise that is correlated in time, its cross-coupling and its low-pass
filter others where it has them (`slow_states`).

A reading of several channels is turned by the eigenvectors of its noise's covariance into as many
channels with independent noise. Map errors of the channels, independent and equal in sigma and L,
remain so, and each channel has its own state; those of one potential are turned, too, and go on
from scan to scan together (`tensor_map_error`). Channels are taken one after the other. What the
filter has as auxiliary states (residual gravity, sensor errors that change) are states here, too.

The vertical accelerometer is left out: with the height known it could measure the east velocity by
the Eötvös term, but only if gravity along the route were known to the precision of the
accelerometer (docs/mathematics.md, section 3.7)."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers
from isogal.evaluation.aids_model import aids_model, height_slope
from isogal.evaluation.beam_model import beam_channels
from isogal.evaluation.bound_recursion import Ageing, BoundModel, Readings, riccati
from isogal.evaluation.gravimeter_states import (
    SlowStates,
    effective_noise,
    effective_noise_variance,
    gradiometer_states,
    slow_states,
)
from isogal.evaluation.ins_error_model import (
    Segments,
    ageing,
    divide,
    initial_covariance,
    noise_density,
)
from isogal.evaluation.tensor_map_error import MapSteps, map_steps
from isogal.fields.known_gravity import true_residual_gravity
from isogal.fields.measured import measured_field
from isogal.fields.simulator import scan_index
from isogal.fusion.auxiliary import auxiliary_of
from isogal.fusion.model import FilterModel
from isogal.inertial.error_model import STATES
from isogal.maps.channels import RouteMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.maps.several import RunMap, each_map
from isogal.maps.tiled_map import TiledMap
from isogal.matching.batching import fix_due
from isogal.scenario import Scenario
from isogal.sensors.gravimeter_errors import missing, without_readings
from isogal.sensors.lag import SETTLING, Lag
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import Trajectory

PATTERNS = 8
"""Ways of missing readings by chance that a bound is the mean over: of half the readings, some 1 %
from those over many."""


@dataclass(frozen=True, slots=True, eq=False)
class BoundResult:
    """Smallest error covariance that an unbiased navigator can have, at the start and right after
    each scan (K = scans + 1)."""

    time: Array
    """(K,) s."""
    covariance: Array
    """(K, 2, 2) m², north and east."""

    @property
    def rms(self) -> Array:
        """(K,) m, RMS horizontal error: square root of the covariance's trace."""
        return np.sqrt(np.trace(self.covariance, axis1=1, axis2=2))

    def rms_at(self, time: Array) -> Array:
        """Return the RMS horizontal error (m) at any times (s): linear between scans, NaN before
        the start and after the last scan."""
        return np.interp(time, self.time, self.rms, left=np.nan, right=np.nan)


def posterior_cramer_rao(
    scenario: Scenario,
    trajectory: Trajectory,
    field_map: RunMap,
    *,
    batchwise: bool = False,
    map_share: Array | None = None,
) -> BoundResult:
    """Return the bound of a navigator that uses every reading at once, with the noise and map
    error of the scenario's true world, which it knows.

    A reading at which the map has no gradient (missing data, outside) tells nothing. Where a share
    of the readings is missing by chance it is the mean over `PATTERNS` ways of missing them: of
    several fields it counts that share of each reading's information, which is a little less.

    Parameters
    ----------
    scenario : Scenario
        Initial errors, IMU grade, gravimeter noise and the map error of the simulated truth.
    trajectory : Trajectory
        The true route.
    field_map : FieldMap, TiledMap or ChannelMap, or FieldMaps of several fields
        The map; its gradient is taken at the true positions. Of several fields the bound is the
        joint one.
    batchwise : bool
        Return the bound of a navigator that learns what a batch's readings say only at the end of
        the batch, as any batch matcher does.
    map_share : (S,) array, optional
        1-sigma of the map's error at each scan in units of `map_error.sigma`; default: 1.
    """
    maps, each = each_map(field_map), scenario.each_field
    if len(each) > 1:
        from isogal.evaluation.bound_several import joint_bound  # which needs this module

        return joint_bound(scenario, trajectory, maps, batchwise=batchwise)
    world = each[0].world
    if world.gravimeter.missing_fraction == 0.0:
        model = bound_model(world, trajectory, maps[0], batchwise=batchwise, map_share=map_share)
        return _solve(world, trajectory, model)
    whole = world.gravimeter.model_copy(update={"missing_fraction": 0.0})
    complete = world.model_copy(update={"gravimeter": whole})
    model = bound_model(complete, trajectory, maps[0], batchwise=batchwise, map_share=map_share)
    return _mean_over_patterns(world, trajectory, model)


def _mean_over_patterns(world: Scenario, trajectory: Trajectory, model: BoundModel) -> BoundResult:
    """Return the mean bound over readings that are missing by chance, as the first runs miss
    them."""
    scans = scan_index(world, trajectory)
    results = []
    for run in range(PATTERNS):
        sensitivity = model.readings.sensitivity.copy()
        sensitivity[missing(world.gravimeter, world.seed, run, trajectory, scans)] = np.nan
        readings = model.readings._replace(sensitivity=sensitivity)
        results.append(_solve(world, trajectory, model._replace(readings=readings)))
    mean = np.mean([one.covariance for one in results], axis=0)
    return BoundResult(results[0].time, mean)


def bound_model(
    scenario: Scenario,
    trajectory: Trajectory,
    field_map: RouteMap,
    *,
    batchwise: bool = False,
    map_share: Array | None = None,
) -> BoundModel:
    """Return the linear model whose recursion `posterior_cramer_rao` is, which see."""
    scenario = scenario.world
    readings = readings_of(scenario, trajectory, field_map, batchwise, map_share)
    return _model(scenario, trajectory, readings)


def readings_of(
    scenario: Scenario,
    trajectory: Trajectory,
    field_map: RouteMap,
    batchwise: bool = False,
    map_share: Array | None = None,
) -> Readings:
    """Return how the readings of a scenario's field depend on the navigator's error; see
    `posterior_cramer_rao`."""
    scans = scan_index(scenario, trajectory)
    field = measured_field(scenario)
    maps = channels_of(field_map)
    if field.name == "terrain" and scenario.altimeter.sounds:
        sensitivity, noise, of_map, common = beam_channels(scenario, trajectory, maps[0], scans)
    else:
        each = [_sensitivity(scenario, trajectory, one, scans) for one in maps]
        sensitivity = np.stack(each, axis=1)
        of_map, common = np.ones(len(maps)), np.ones(len(maps))
        noise = np.array([effective_noise_variance(scenario.gravimeter, maps[0].quantisation)])
    sensitivity[without_readings(scenario.gravimeter, trajectory, scans)] = np.nan
    steps, turn = MapSteps.none(), np.eye(len(of_map))
    if (covariance := field.covariance(scenario)) is not None:
        rounding = np.array([one.quantisation for one in maps]) ** 2 / 12.0
        noise, turn = np.linalg.eigh(effective_noise(scenario.gravimeter, covariance, rounding))
        sensitivity = np.einsum("ci,scj->sij", turn, sensitivity)
        steps = map_steps(scenario, trajectory, scans, turn)
    used = np.ones(len(scans), dtype=np.bool_)
    if batchwise:
        used[:] = [fix_due(count + 1, scenario.matcher) for count in range(len(scans))]
    if field.name == "gradient":
        slow = gradiometer_states(scenario.gradiometer, trajectory, scans, turn)
    else:
        slow = slow_states(scenario.gravimeter, trajectory, scans)
        slow = slow._replace(of_channel=common[:, None] * slow.of_channel)
        if scenario.gravimeter.delay_sigma > 0.0 and len(of_map) == 1:
            moved = (sensitivity[:, 0, :2] * trajectory.velocity[scans, :2]).sum(axis=1)
            slow = slow.with_delay(scenario.gravimeter.delay_sigma, np.nan_to_num(moved))
    slope = height_slope(scenario, trajectory, scans)
    # an array of its own, of one layout: the recursion is compiled once
    share = np.full(len(scans), 1.0 if map_share is None else map_share)
    return Readings(sensitivity, slope, noise, used, slow, share, of_map, common, steps)


def _sensitivity(
    scenario: Scenario, trajectory: Trajectory, field_map: FieldMap | TiledMap, scans: Integers
) -> Array:
    """Return (S, 4) how a reading's difference from the map at the navigator's position depends on
    the navigator's error xi at the scan: (jacobian - gradient) xi, a mean over the path where the
    readings are late; NaN = the reading tells nothing."""
    reduction = measured_field(scenario).reduction(scenario)
    lag, time = Lag.of(scenario.gravimeter), trajectory.time
    total = np.zeros((len(scans), 4))
    for age, weight in zip(*lag.ages(), strict=True):
        then = time[scans] - age
        place = [
            np.interp(then, time, values)
            for values in (
                trajectory.latitude,
                trajectory.longitude,
                trajectory.height,
                trajectory.velocity[:, 0],
                trajectory.velocity[:, 1],
            )
        ]
        at = State(*place)
        _, north, east = field_map.value_and_gradient(at.latitude, at.longitude)
        jacobian = reduction.jacobian(at)
        jacobian[:, 0] -= north
        jacobian[:, 1] -= east
        jacobian[:, 2:] -= age * jacobian[:, :2]  # position was another by velocity
        total += weight * jacobian
    if lag.mean > 0.0:
        total[time[scans] < lag.delay + SETTLING * lag.filter_time] = np.nan
    return total


def unaided_covariance(scenario: Scenario, trajectory: Trajectory) -> BoundResult:
    """Return the error covariance of the navigator without any reading, by the same linear
    model, in the scenario's true world."""
    scenario = scenario.world
    scans = len(trajectory) // scenario.steps_per_scan
    nothing = np.full((scans, 1, 4), np.nan)
    used = np.ones(scans, dtype=np.bool_)
    slow, ones = SlowStates.none(scans), np.ones(scans)
    each = np.ones(1)
    readings = Readings(nothing, ones, each, used, slow, ones, each, each, MapSteps.none())
    return _solve(scenario, trajectory, _model(scenario, trajectory, readings))


def _model(scenario: Scenario, trajectory: Trajectory, readings: Readings) -> BoundModel:
    segments = divide(scenario, trajectory)
    gravity = true_residual_gravity(scenario.felt_field, trajectory)
    model = FilterModel.from_scenario(scenario, gravity)
    auxiliary = model.auxiliary
    m, beside = STATES + len(auxiliary), field_variances(scenario, trajectory, readings)
    start = np.zeros((m + len(beside), m + len(beside)))
    start[:m, :m] = initial_covariance(scenario, auxiliary)
    start[m:, m:] = np.diag(beside)
    aged = Ageing(
        auxiliary_of(auxiliary), *ageing(segments, auxiliary), map_correlation(scenario, segments)
    )
    scans = np.arange(1, len(readings.slope) + 1) * scenario.steps_per_scan
    aids = aids_model(scenario, model, segments, readings.slope, trajectory.height[scans])
    return BoundModel(start, segments, noise_density(scenario), aged, aids, readings)


def field_variances(scenario: Scenario, trajectory: Trajectory, readings: Readings) -> Array:
    """Return the variances at the start of the states that a field has beside the navigator's: the
    map's error in each channel, slow errors of the sensor, its bias and drift."""
    one = measured_field(scenario).channels is None
    bias = bias_and_drift(scenario, trajectory) if one else (0.0, 0.0)
    of_map = scenario.map_error.sigma**2 * readings.map_variance
    if readings.map_steps.joint:
        of_map = np.zeros(readings.map_states)  # known by nothing before the first scan
    return np.array([*of_map, *readings.slow.variance, *np.square(bias)])


def _solve(scenario: Scenario, trajectory: Trajectory, model: BoundModel) -> BoundResult:
    covariance = riccati(*model)
    time = trajectory.time[np.arange(covariance.shape[0]) * scenario.steps_per_scan]
    return BoundResult(time, covariance)


def bias_and_drift(scenario: Scenario, trajectory: Trajectory) -> tuple[float, float]:
    """Return the 1-sigma of the readings' offset and of its drift (per s): those of the sensor and
    of the map's datum, whose tilt is a drift on a straight route at a constant speed, for which it
    is taken here."""
    sensor, datum = scenario.gravimeter, scenario.map_error
    speed = float(np.hypot(trajectory.velocity[:, 0], trajectory.velocity[:, 1]).mean())
    return math.hypot(sensor.bias, datum.offset), math.hypot(sensor.drift, datum.tilt * speed)


def map_correlation(scenario: Scenario, segments: Segments) -> Array:
    """Return (S,) the correlation of the map's error between the ends of each stretch."""
    speed = np.hypot(segments.geometry[:, 1], segments.geometry[:, 2])
    return np.exp(-speed * segments.dt / scenario.map_error.correlation_length)
