"""The gravity vector around a route by a scenario's map, and what the vehicle senses of it
(docs/mathematics.md, section 3.9)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from isogal.arrays import Array
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.fields.map_error import TrueMapError
from isogal.fields.measured import measured_field
from isogal.fields.simulator import scan_index
from isogal.fields.source_map import MapSource
from isogal.maps import potential
from isogal.maps.channels import ChannelMap
from isogal.maps.corridor import Corridor, corridor_of
from isogal.maps.field_map import FieldMap
from isogal.maps.load import check_coverage
from isogal.maps.tiled_map import ScalarMap, TiledMap
from isogal.scenario import Settings, Truth
from isogal.sensors.trajectory import Trajectory

REACH = 60_000.0
"""m of the disturbance around a route that its horizontal parts are computed from."""
CELL = 500.0
"""m; the disturbance is averaged over cells of this size first. What is smoother than a cell
passes within half a minute at 22 m/s and moves no position by a metre."""
MOST = 2000
"""Cells along an axis; those of a longer route are larger."""
_KEPT = 2
"""Vectors that a process keeps: a study has one, a true world with another map a second one."""


@dataclass(frozen=True)
class GravityVector:
    """The disturbance vector around a route by its map."""

    disturbance: ScalarMap
    source: MapSource
    """Of the scenario's map."""
    corridor: Corridor

    @cached_property
    def horizontal(self) -> ChannelMap:
        """Channels `gravity_north` and `gravity_east`, m/s², computed when first asked for: from
        maps of the deflection of the vertical, where the scenario's map has them (variables xi and
        eta, as GGMplus names them), else from the disturbance."""
        try:
            xi, eta = (
                _coarse(self.source.other(None, name).along(self.corridor))
                for name in ("xi", "eta")
            )
            return potential.from_deflections(xi, eta)
        except InputError:
            coarse = _coarse(self.disturbance, potential.disturbance_of)
        sideways = potential.VECTOR[1:]
        return potential.derivatives(coarse, sideways, edge=0.0)


def gravity_vector(settings: Settings, trajectory: Trajectory) -> GravityVector | None:
    """Return the map's disturbance vector; None where the scenario has normal gravity only, or its
    map is not one of gravity.

    Raises
    ------
    InputError
        The map cannot be read, or does not cover the route.
    """
    if settings.gravity.field == "normal":  # there is nothing to sense, and nothing to take off
        return None
    if measured_field(settings).instrument not in ("gravimeter", "gradiometer"):
        return None
    return _vector(MapSource.of(settings), trajectory, settings.route.track is not None)


@lru_cache(maxsize=_KEPT)
def _vector(source: MapSource, trajectory: Trajectory, partly: bool) -> GravityVector | None:
    """Return the vector; None where the map may cover a route partly, and does."""
    corridor = corridor_of(trajectory.latitude, trajectory.longitude, REACH)
    disturbance = _gravity_map(source, corridor)
    if disturbance is None:
        return None
    if not partly:
        check_coverage(disturbance, trajectory.latitude, trajectory.longitude)
    elif not disturbance.covers(trajectory.latitude, trajectory.longitude).all():
        return None  # nobody knows it where the map has ended
    return GravityVector(disturbance, source, corridor)


def _coarse(
    source: ScalarMap, of: Callable[[FieldMap], FieldMap] = lambda whole: whole
) -> FieldMap:
    """Return what a map holds along the route, in memory and averaged; 0 off the corridor of a
    long route."""
    if not isinstance(source, TiledMap):
        return averaged(of(source), CELL)
    shown = of(source.overview(2 * MOST))
    values = np.nan_to_num(shown.values.astype(np.float64))
    return averaged(replace(shown, values=values), CELL)


def _gravity_map(source: MapSource, corridor: Corridor) -> ScalarMap | None:
    """Return the scenario's map of the disturbance; where it has none, that of gravity, or None if
    another field is measured."""
    try:
        return source.other("disturbance").along(corridor)
    except InputError:
        if source.quantity not in ("gravity", "disturbance"):
            return None
        return source.along(corridor)


def averaged(field_map: FieldMap, cell: float) -> FieldMap:
    """Return a map of means over blocks of nodes: of about the size of a cell (m), or larger, so
    that there are no more than `MOST` along an axis."""
    shape = field_map.shape
    rows, columns = (
        max(1, round(cell / one), -(-count // MOST))
        for one, count in zip(field_map.cell, shape, strict=True)
    )
    if rows == columns == 1:
        return field_map
    n, m = shape[0] // rows, shape[1] // columns

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


def sensed_gravity(truth: Truth, trajectory: Trajectory, runs: Sequence[int]) -> Array | None:
    """Return (R, K, 3) what gravity is in a world beside normal gravity, mean over each IMU
    interval: north, east, down, m/s². None where it is nothing.

    Includes the map error that the gravimeter of the same run senses, all three components of it.
    """
    vector = gravity_vector(truth, trajectory)
    if vector is None:
        return None
    place = trajectory.latitude, trajectory.longitude
    north, east = vector.horizontal.value(*place).T
    down = vector.disturbance.value(*place)
    if vector.disturbance.quantity != "disturbance":
        down = down - normal_gravity(trajectory.latitude)
    sensed = np.stack([north, east, down], axis=-1)
    if not np.isfinite(sensed).all():
        raise InputError(
            f"map {vector.disturbance.provenance}: its gravity vector does not cover the route"
        )
    index = scan_index(truth, trajectory)
    map_error = TrueMapError(truth, trajectory, index, runs)
    vertical = map_error.at_scans()
    stations, horizontal = map_error.horizontal(vertical)
    time = trajectory.time
    result = np.empty((len(runs), len(trajectory), 3))
    for row in range(len(runs)):
        error = [
            *(np.interp(time, time[stations], part) for part in horizontal[row].T),
            np.interp(time, time[index], vertical[row]),
        ]
        ends = sensed + np.stack(error, axis=-1)
        result[row] = 0.5 * (ends[1:] + ends[:-1])
    return result
