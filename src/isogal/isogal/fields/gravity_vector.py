"""Gravity beside normal gravity along a route: what the vehicle feels, and what a navigator knows.

The vehicle feels the disturbance vector of the map and of the map's error; the strapdown knows
normal gravity, and takes off the horizontal part of the map's at its own position
(docs/mathematics.md, section 3.9).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.fields.known_gravity import KnownGravity
from isogal.fields.measured import measured_field
from isogal.fields.simulator import draw_map_error, scan_index
from isogal.fields.source_map import source_map_along
from isogal.fields.vector_map_error import draw_horizontal_error
from isogal.inertial.gravity import compensation_by
from isogal.maps.channels import ChannelMap, RouteMap, channels_of
from isogal.maps.corridor import Corridor, corridor_of
from isogal.maps.field_map import FieldMap
from isogal.maps.gravity_vector import horizontal_gravity
from isogal.maps.load import check_coverage
from isogal.maps.tiled_map import ScalarMap, TiledMap
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory

REACH = 60_000.0
"""m of the disturbance around a route that its horizontal parts are computed from."""
CELL = 500.0
"""m; the disturbance is averaged over cells of this size first. What is smoother than a cell
passes within half a minute at 22 m/s and moves no position by a metre."""
MOST = 2000
"""Cells along an axis; those of a longer route are larger."""
UNTOLD_MAP_SIGMA = 2e-5
"""m/s², of a map's disturbance where nothing is told: between good surveys and terrain models."""
RESOLUTION_SIGMA = 1e-6
"""m/s², 1-sigma of what is left of horizontal gravity for the cells of a map."""


@dataclass(frozen=True)
class GravityVector:
    """The disturbance vector around a route by its map."""

    disturbance: ScalarMap
    horizontal: ChannelMap
    """Channels `gravity_north` and `gravity_east`, m/s²."""


def gravity_vector(scenario: Scenario, trajectory: Trajectory) -> GravityVector | None:
    """Return the map's disturbance vector; None where the scenario has normal gravity only, or its
    map is not one of gravity.

    Raises
    ------
    InputError
        The map cannot be read, or does not cover the route.
    """
    if scenario.gravity.field == "normal":  # there is nothing to feel, and nothing to take off
        return None
    if measured_field(scenario).instrument not in ("gravimeter", "gradiometer"):
        return None
    corridor = corridor_of(trajectory.latitude, trajectory.longitude, REACH)
    source = _gravity_map(scenario, corridor)
    check_coverage(source, trajectory.latitude, trajectory.longitude)
    if isinstance(source, TiledMap):
        gridded = source.overview(2 * MOST)
        filled = np.nan_to_num(
            disturbance_of(gridded).values.astype(np.float64)
        )  # off the corridor
        gridded = replace(gridded, values=filled, quantity="disturbance")
    else:
        gridded = source = disturbance_of(source)
    coarse = averaged(gridded, CELL)
    return GravityVector(source, horizontal_gravity(coarse, edge=0.0))


def _gravity_map(scenario: Scenario, corridor: Corridor) -> ScalarMap:
    """Return the scenario's map of the disturbance; where it has none, that of gravity."""
    try:
        return source_map_along(
            scenario.model_copy(
                update={
                    "field": "disturbance",
                    "map": scenario.map.model_copy(update={"variable": None}),
                }
            ),
            corridor,
        )
    except InputError:
        if measured_field(scenario).source not in ("gravity", "disturbance"):
            raise
        return source_map_along(scenario, corridor)


def disturbance_of(field_map: FieldMap) -> FieldMap:
    """Return a map of the gravity disturbance from one of it, or of gravity on the ellipsoid."""
    if field_map.quantity == "disturbance":
        return field_map
    normal = normal_gravity(field_map.latitude)[:, None]
    return replace(field_map, values=field_map.values - normal, quantity="disturbance")


def averaged(field_map: FieldMap, cell: float) -> FieldMap:
    """Return a map of means over blocks of nodes: of about the size of a cell (m), or larger, so
    that there are no more than `MOST` along an axis."""
    size = field_map.cell_size_m(float(np.mean(field_map.latitude)))
    rows, columns = (
        max(1, round(cell / one), -(-count // MOST))
        for one, count in zip(size, field_map.values.shape, strict=True)
    )
    if rows == columns == 1:
        return field_map
    n, m = (
        length // step
        for length, step in zip(field_map.values.shape, (rows, columns), strict=True)
    )

    def centres(axis: Array, step: int, count: int) -> Array:
        return np.asarray(axis[: step * count].reshape(count, step).mean(axis=1))

    values = field_map.values[: n * rows, : m * columns].reshape(n, rows, m, columns)
    return replace(
        field_map,
        latitude=centres(field_map.latitude, rows, n),
        longitude=centres(field_map.longitude, columns, m),
        values=values.mean(axis=(1, 3)),
        sigma=0.0,
    )


def felt_and_known_gravity(
    scenario: Scenario, trajectory: Trajectory, field_map: RouteMap, runs: Sequence[int]
) -> tuple[Array | None, KnownGravity]:
    """Return `felt_gravity` of the world that a scenario simulates, and what its navigator, with a
    map of what is measured, knows of it: `known_gravity`."""
    world = scenario.world
    vector = gravity_vector(scenario, trajectory)
    true = vector if world.gravity.field == scenario.gravity.field else None
    if true is None:
        true = gravity_vector(world, trajectory)
    known = known_gravity(scenario, trajectory, vector, told_map_sigma(scenario, field_map))
    return felt_gravity(world, trajectory, true, runs), known


def felt_gravity(
    scenario: Scenario, trajectory: Trajectory, vector: GravityVector | None, runs: Sequence[int]
) -> Array | None:
    """Return (R, K, 3) what gravity is beside normal gravity, mean over each IMU interval: north,
    east, down, m/s². None where it is nothing.

    Includes the map error that the gravimeter of the same run feels, all three components of it.
    """
    if scenario.gravity.field == "normal" or vector is None:
        return None
    place = trajectory.latitude, trajectory.longitude
    north, east = vector.horizontal.value(*place).T
    felt = np.stack([north, east, _disturbance_along(vector.disturbance, *place)], axis=-1)
    if not np.isfinite(felt).all():
        raise InputError(
            f"map {vector.disturbance.provenance}: its gravity vector does not cover the route"
        )
    index = scan_index(scenario, trajectory)
    vertical = draw_map_error(scenario, trajectory, index, runs)
    stations, horizontal = draw_horizontal_error(scenario, trajectory, index, runs, vertical)
    time = trajectory.time
    result = np.empty((len(runs), len(trajectory), 3))
    for row in range(len(runs)):
        error = [
            *(np.interp(time, time[stations], part) for part in horizontal[row].T),
            np.interp(time, time[index], vertical[row]),
        ]
        ends = felt + np.stack(error, axis=-1)
        result[row] = 0.5 * (ends[1:] + ends[:-1])
    return result


def _disturbance_along(field_map: ScalarMap, latitude: Array, longitude: Array) -> Array:
    value = field_map.value(latitude, longitude)
    return value if field_map.quantity == "disturbance" else value - normal_gravity(latitude)


def known_gravity(
    scenario: Scenario, trajectory: Trajectory, vector: GravityVector | None, map_sigma: float
) -> KnownGravity:
    """Return what the navigator of a scenario knows of horizontal gravity.

    Parameters
    ----------
    map_sigma : float
        What it takes for the 1-sigma of the map's disturbance, m/s²: each horizontal component is
        wrong by that over sqrt(2).
    """
    settings = scenario.gravity
    if vector is None:
        return KnownGravity()
    share = settings.compensated_share if settings.compensation == "map" else 0.0
    along = vector.horizontal.value(trajectory.latitude, trajectory.longitude)
    spread = float(np.sqrt(np.nanmean(along**2)))
    left = (1.0 - share) * spread
    sigma, length = settings.residual_sigma, settings.residual_correlation_length
    if sigma == "auto":
        sigma = float(np.sqrt(left**2 + 0.5 * map_sigma**2 + RESOLUTION_SIGMA**2))
    if length == "auto":
        of_map = _correlation_length(trajectory, along)
        of_error = scenario.matcher.map_correlation_length
        weight = left**2 / (left**2 + 0.5 * map_sigma**2 + RESOLUTION_SIGMA**2)
        length = float(np.exp(weight * np.log(of_map) + (1.0 - weight) * np.log(of_error)))
    return KnownGravity(compensation_by(vector.horizontal, share), float(sigma), float(length))


def true_residual_gravity(scenario: Scenario, trajectory: Trajectory) -> KnownGravity:
    """Return what is really left of horizontal gravity after its compensation."""
    if scenario.gravity.field == "normal":
        return KnownGravity()
    as_it_is = scenario.gravity.model_copy(
        update={"residual_sigma": "auto", "residual_correlation_length": "auto"}
    )
    world = scenario.model_copy(
        update={
            "gravity": as_it_is,
            "matcher": scenario.matcher.model_copy(
                update={"map_correlation_length": scenario.map_error.correlation_length}
            ),
        }
    )
    vector = gravity_vector(scenario, trajectory)
    return known_gravity(world, trajectory, vector, scenario.map_error.sigma)


def told_map_sigma(scenario: Scenario, field_map: RouteMap) -> float:
    """Return the 1-sigma that a navigator takes for the map's error of the disturbance, m/s²: as
    the matcher is told, else as the map says."""
    told = scenario.matcher.map_sigma
    said = float(np.nanmean([np.nanmean(one.sigma) for one in channels_of(field_map)]))
    return max(said, UNTOLD_MAP_SIGMA if told == "auto" else float(told))


def _correlation_length(trajectory: Trajectory, along: Array) -> float:
    """Return the distance (m) along a route at which the horizontal components' autocorrelation
    falls to 1/e."""
    speed = float(np.hypot(*trajectory.velocity[:, :2].T).mean())
    step = max(1, round(500.0 / max(speed * trajectory.dt, 1e-3)))
    values = along[::step] - along.mean(axis=0)
    count = len(values)
    power = np.abs(np.fft.rfft(values, 2 * count, axis=0)) ** 2
    correlation = np.fft.irfft(power.sum(axis=1))[:count] / (count - np.arange(count))
    below = np.flatnonzero(correlation < correlation[0] / np.e)
    lag = float(below[0]) if below.size else float(count)
    return max(lag, 1.0) * step * speed * trajectory.dt
