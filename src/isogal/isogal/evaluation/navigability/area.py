"""Where can one navigate? The expected error of the navigator over an area, by heading."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.evaluation.navigability.kernels import (
    Approach,
    Ground,
    Leg,
    errors_on_arrival,
    second_places,
)
from isogal.evaluation.navigability.leg import leg_to
from isogal.fields.measured import measured_field
from isogal.maps.error_ellipses import mean_length
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import Grid
from isogal.maps.variability import feature_variability
from isogal.scenario import MapError, Truth

HEADINGS = 8
MOST_NODES = 1000
"""Along each side of the area; of finer maps every so many-th node is taken."""
_THINNED = 3
"""Of the readings of a leg every third counts for the probability of a second place, with the
noise of a mean of three."""
_COMPUTED = 400
"""Along each side the probability of a second place is computed at so many nodes at most."""
_REACH = 3.0
"""1-sigmas of the prior, each way, within which second places are looked for."""
_CELLS = 24
"""Of the grid of places that are tried, along each side, at most."""
_SEPARATION = 4.0
"""Two places are different ones where sqrt(2) |m1 - m2| / sqrt(s1² + s2²) along an axis exceeds
this (Ashman, Bird & Zepf 1994, AJ 108:2348, who call 2 clean for two Gaussians; the two halves of
one cut Gaussian already reach 2.7)."""

_QUARTERS = "least", "quarter", "median", "three_quarters", "largest"


@dataclass(frozen=True, slots=True, eq=False)
class Navigability:
    """What is to be expected at the nodes of an area, (N, M) each."""

    latitude: Array
    """(N,) rad."""
    longitude: Array
    """(M,) rad."""
    heading: Array
    """(H,) rad."""
    error: Array
    """(H, N, M) m, RMS horizontal error on arrival on each heading."""
    ambiguity: Array
    """Probability of a second place, mean of some headings."""
    variability: Array
    """Root of the map feature variability (paper eq. CV), map's unit."""
    prior: float
    """m, RMS horizontal error on arrival without any reading."""
    unit: str

    def layers(self) -> dict[str, tuple[Array, str, str]]:
        """Return the grids by name, with unit and description."""
        known = np.isfinite(self.error).all(axis=0)
        best = np.argmin(np.where(known, self.error, 0.0), axis=0)
        heading = np.where(known, np.degrees(self.heading)[best], np.nan)
        mean, error = np.sqrt((self.error**2).mean(axis=0)), "RMS horizontal error on arrival"
        return {
            "error_worst": (self.error.max(axis=0), "m", f"{error}, worst heading"),
            "error_mean": (mean, "m", f"{error}, all headings"),
            "error_best": (self.error.min(axis=0), "m", f"{error}, best heading"),
            "best_heading": (heading, "degree", "best heading, clockwise from north"),
            "ambiguity": (self.ambiguity, "1", "probability of a second place"),
            "variability": (self.variability, self.unit, "root of map feature variability"),
        }

    def summary(self) -> dict[str, Any]:
        """Return quantiles of each layer."""
        parts = np.linspace(0.0, 1.0, len(_QUARTERS))
        return {
            "nodes": list(self.ambiguity.shape),
            "headings": len(self.heading),
            "unaided_m": self.prior,
            **{
                name: dict(zip(_QUARTERS, np.nanquantile(grid, parts).tolist(), strict=True))
                for name, (grid, _, _) in self.layers().items()
                if np.isfinite(grid).any()
            },
        }


class Area:
    """A map, and what reads it, as the kernels take them.

    Raises
    ------
    InputError
        See `fitting`.
    """

    def __init__(self, truth: Truth, field_map: FieldMap) -> None:
        self.truth, self.field_map = fitting(truth, field_map), field_map
        metres = np.stack(metres_per_radian(field_map.latitude, truth.route.height), axis=1)
        values = np.ascontiguousarray(field_map.values, dtype=np.float64)
        self.ground = Ground(
            Grid(values, len(values), 0.0, 1.0, 0.0, 1.0),
            np.ascontiguousarray(metres * np.array(field_map.step)),
            *map_error_at_nodes(truth.map_error, field_map),
        )

    def leg(self, heading: float) -> Leg:
        """Return the leg on a heading (rad) in the middle of the area."""
        axes = self.field_map.latitude, self.field_map.longitude
        middle = [float(axis[axis.size // 2]) for axis in axes]
        return leg_to(self.truth, middle[0], middle[1], heading, self.field_map.quantisation)

    def errors(self, leg: Leg, rows: Integers, columns: Integers) -> Array:
        """Return (N, M) the RMS horizontal error (m) on arrival at nodes."""
        return errors_on_arrival(rows, columns, self.ground, leg)

    def ambiguity(self, leg: Leg, rows: Integers, columns: Integers) -> Array:
        """Return (N, M) the probability of a second place at nodes."""
        prior = math.sqrt((leg.position[0] ** 2).sum() / 2.0)
        reach = _REACH * prior
        cell = 0.5 * float(self.ground.cell.min())
        count = math.ceil(min(reach / max(2.0 * reach / _CELLS, cell), _CELLS / 2))
        whole = leg.approach
        thinned = Approach(
            np.ascontiguousarray(whole.offset[len(whole.offset) % _THINNED :: _THINNED]),
            whole.step * _THINNED,
            whole.noise / _THINNED,
            whole.by_place,
        )
        places = np.linspace(-reach, reach, 2 * count + 1)
        step = 0.25 * float(self.ground.cell.min())
        return second_places(rows, columns, self.ground, thinned, prior, _SEPARATION, places, step)


def fitting(truth: Truth, field_map: FieldMap) -> Truth:
    """Return a truth with the reduction that a map of gravity or of any kind of gravity
    disturbance or anomaly needs.

    Raises
    ------
    InputError
        What is measured has several channels, or is not what the map is of.
    """
    field = measured_field(truth)
    if field.channels is not None:
        raise InputError(f"field {field.name}: has several channels; the area needs one map")
    if field_map.unit != field.unit:
        raise InputError(
            f"{field_map.provenance}: is a map of {field_map.quantity}, the scenario measures"
            f" {field.quantity}; give --set field=... and --set gravimeter.sigma=..."
        )
    if field.instrument != "gravimeter":
        return truth
    quantity = "gravity" if field_map.quantity == "gravity" else "disturbance"
    gravimeter = truth.gravimeter.model_copy(update={"quantity": quantity})
    return truth.model_copy(update={"gravimeter": gravimeter})


def navigability(
    truth: Truth,
    field_map: FieldMap,
    headings: int = HEADINGS,
    progress: Callable[[int, int], None] | None = None,
) -> Navigability:
    """Compute the navigability of the area of a map.

    Parameters
    ----------
    truth : Truth
        Sensors, speed, initial errors and batch length; its route does not count. The map's error
        is what the map says, or `map_error` where that is larger.
    field_map : FieldMap
        Of what is measured.
    headings : int
        How many, evenly spread.
    progress : function, optional
        Called with the number of headings that are done, and of all.

    Raises
    ------
    InputError
        See `Area`.
    """
    area = Area(truth, field_map)
    rows, columns = (
        np.arange(0, count, -(-count // MOST_NODES), dtype=np.int64) for count in field_map.shape
    )
    bearing = 2.0 * math.pi * np.arange(headings) / headings
    error = np.empty((headings, rows.size, columns.size))
    ambiguity = np.zeros((rows.size, columns.size))
    among = range(0, headings, max(1, headings // 4))
    prior = 0.0
    for k in range(headings):
        leg = area.leg(float(bearing[k]))
        error[k] = area.errors(leg, rows, columns)
        prior += ((leg.position[-1] ** 2).sum() + leg.rest) / headings
        if k in among:
            ambiguity += between(partial(area.ambiguity, leg), rows, columns) / len(among)
        if progress is not None:
            progress(k + 1, headings)
    latitude, longitude = field_map.latitude[rows], field_map.longitude[columns]
    variability = np.sqrt(feature_variability(field_map, latitude[:, None], longitude))
    return Navigability(
        latitude,
        longitude,
        bearing,
        error,
        np.where(np.isfinite(error[0]), ambiguity, np.nan),
        variability,
        math.sqrt(prior),
        field_map.unit,
    )


def between(
    compute: Callable[[Integers, Integers], Array], rows: Integers, columns: Integers
) -> Array:
    """Return (N, M) what is computed at nodes: of many at every so many-th, linear between them;
    NaN beside one that is not known."""
    steps = [-(-one.size // _COMPUTED) for one in (rows, columns)]
    coarse = rows[:: steps[0]], columns[:: steps[1]]
    found = compute(*coarse)
    if max(steps) == 1:
        return found
    from scipy.interpolate import RegularGridInterpolator

    at = [np.minimum(one, part[-1]) for one, part in zip((rows, columns), coarse, strict=True)]
    return np.asarray(RegularGridInterpolator(coarse, found)(np.ix_(*at)))


def map_error_at_nodes(error: MapError, field_map: FieldMap) -> tuple[Array, Array]:
    """Return (n, m) 1-sigma and correlation length (m) of the map's error: what the map says, or
    `error` where that is larger."""
    own = np.broadcast_to(np.nan_to_num(field_map.sigma), field_map.shape)
    length = np.full(field_map.shape, error.correlation_length)
    if field_map.error_ellipses is not None:
        said = mean_length(field_map.error_ellipses)
        length = np.where((own > error.sigma) & np.isfinite(said), said, length)
    elif field_map.correlation_length is not None:
        length = np.where(own > error.sigma, field_map.correlation_length, length)
    return np.maximum(own, error.sigma), length
