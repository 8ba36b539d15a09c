"""From survey readings to a map with its own 1-sigma and correlation length at every node."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.field_map import FieldMap
from isogal.maps.gridding.amplitude import Amplitude
from isogal.maps.gridding.covariance import Covariance, Readings
from isogal.maps.gridding.error_lengths import error_ellipses, error_lengths
from isogal.maps.gridding.kriging import GROUP, Kriging, groups
from isogal.maps.gridding.learning import learn
from isogal.maps.gridding.levelling import cross_overs, levelled
from isogal.maps.gridding.reduction import Trend, block_reduced
from isogal.maps.gridding.survey import Survey
from isogal.maps.gridding.validation import leave_out

METHODS = {"kriging": "matern", "sources": "harmonic"}
"""Ways of gridding, and their covariances."""
_UNKNOWN = 0.95
"""Nodes whose 1-sigma is at least this share of the field's own have no value."""
_MOST_NODES = 4_000_000
_FEWEST_LINES = 4  # that lines are left out of


@dataclass(frozen=True, slots=True)
class GridSettings:
    """How a survey is gridded.

    Raises
    ------
    InputError
        A setting is out of range.
    """

    method: str = "kriging"
    spacing: float | None = None
    """m between nodes; None = a third of the shortest correlation length."""
    block: float | None = None
    """m, side of the blocks that readings are averaged in; None = half the spacing where that is
    given, else none; 0 = none."""
    trend: int = 1
    """Degree of the polynomial taken off first."""
    height: float | None = None
    """m above the ellipsoid, of the map; None = that of the readings."""
    level: bool = False
    """Whether lines are levelled at their crossings."""
    left_out: str | None = None
    """`lines` or `blocks`; None = lines where the survey has some."""

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(
                f"method (--method) '{self.method}' must be one of {', '.join(METHODS)}"
            )
        if self.height is not None and self.method != "sources":
            raise InputError("a map at a chosen height needs the method sources")
        if self.left_out not in (None, "lines", "blocks"):
            raise InputError(f"left out (--leave-out) '{self.left_out}': must be lines or blocks")
        if not 0 <= self.trend <= 3:
            raise InputError(f"degree of the trend must be 0 to 3, is {self.trend}")


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """What was learnt from a survey, without its map."""

    survey: Survey
    """As gridded: levelled, in blocks."""
    trend: Trend
    kriging: Kriging
    amplitude: Amplitude
    report: dict[str, object] = field(default_factory=dict)

    def at(
        self, latitude: Array, longitude: Array, height: Array | float | None = None
    ) -> tuple[Array, Array]:
        """Return the field and the 1-sigma of its error at places (P,), rad and m above the
        ellipsoid (sources only)."""
        places = self.places(latitude, longitude, height)
        mean, variance = self.kriging.at(places)
        sigma = np.sqrt(variance * self.amplitude.at(places))
        return mean + self.trend.at(places), sigma

    def places(
        self, latitude: Array, longitude: Array, height: Array | float | None = None
    ) -> Array:
        """Return (P, 3) places as the kriging takes them."""
        plane, floor = self.survey.plane, self.survey.floor
        turned = np.remainder(longitude - plane.longitude + math.pi, 2.0 * math.pi)
        east, north = plane.project(latitude, plane.longitude + turned - math.pi)
        up = self.default_height if height is None else height
        return np.stack([east, north, np.broadcast_to(up, east.shape) - floor], axis=1)

    @property
    def default_height(self) -> float:
        """Of a map whose height nobody has chosen, m: the median of the readings'."""
        return self.survey.floor + float(np.median(self.kriging.readings.places[:, 2]))

    @property
    def covariance(self) -> Covariance:
        """Of the field."""
        return self.kriging.covariance


def learn_model(survey: Survey, settings: GridSettings) -> Model:
    """Learn covariance, amplitude and noise from a survey, and check them on readings left out.

    Raises
    ------
    InputError
        Settings that do not fit the survey: no heights, no lines, no crossings.
    """
    kind, by = METHODS[settings.method], _left_out_by(survey, settings)
    survey, report = _prepared(survey, settings)
    places = survey.places
    trend = Trend.fitted(places, survey.value, settings.trend)
    value = survey.value - trend.at(places)
    readings = Readings(places, value, survey.sigma, survey.line)
    covariance = learn(readings, kind=kind)
    kriging = Kriging(readings, covariance)
    shortest = _shortest(covariance)
    out = leave_out(kriging, by, 2.0 * shortest)
    errors = np.stack([out.error**2, out.variance - out.noise, out.noise])
    amplitude = Amplitude.learnt(places, value, (out.rows, out.part), errors, shortest)
    honest = out.scaled(amplitude.at(places[out.rows], out.part[out.rows]))
    report |= {
        "covariance": covariance.describe(),
        "left_out": {"by": by} | honest.figures(),
        "amplitude": amplitude.describe(),
    }
    return Model(survey, trend, kriging, amplitude, report)


def _left_out_by(survey: Survey, settings: GridSettings) -> str:
    """Return whether lines or blocks are left out; raises InputError where the survey lacks what
    is asked for."""
    if METHODS[settings.method] == "harmonic" and survey.height is None:
        raise InputError(f"{survey.where}: has no column height, which method sources needs")
    by = settings.left_out or ("blocks" if survey.line is None else "lines")
    if by == "lines":
        if survey.line is None:
            raise InputError(f"{survey.where}: has no column line; leave out blocks")
        if np.unique(survey.line).size < _FEWEST_LINES:
            return "blocks"
    return by


def _prepared(survey: Survey, settings: GridSettings) -> tuple[Survey, dict[str, object]]:
    """Return the survey levelled and in blocks, as asked for, and what there is to say of that."""
    report: dict[str, object] = {"readings": len(survey)}
    if survey.line is not None:
        report["lines"] = int(np.unique(survey.line).size)
    if settings.level:
        crossings = cross_overs(survey)
        survey = levelled(survey, crossings)
        report["cross_overs"] = {
            "before": crossings.figures(),
            "after": cross_overs(survey).figures(),
        }
    block = settings.block
    if block is None:
        block = 0.5 * settings.spacing if settings.spacing else 0.0
    survey = block_reduced(survey, block)
    return survey, report | {"blocks": len(survey)}


def _shortest(covariance: Covariance) -> float:
    """Return the distance (m) that matters across the strike."""
    across = min(covariance.length) / math.sqrt(max(covariance.ratio, 1.0 / covariance.ratio))
    return across if covariance.kind == "matern" else 2.0 * across


def grid_survey(
    survey: Survey,
    settings: GridSettings,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[FieldMap, Model]:
    """Make a map of a survey.

    Parameters
    ----------
    survey : Survey
    settings : GridSettings
    progress : function, optional
        Called with the number of nodes that are done, and of all.

    Raises
    ------
    InputError
        Settings that do not fit, or more nodes than are made at once.
    """
    model = learn_model(survey, settings)
    latitude, longitude = _nodes(model, settings)
    shape, count = (latitude.size, longitude.size), latitude.size * longitude.size
    nodes = np.meshgrid(latitude, longitude, indexing="ij")
    places = model.places(nodes[0].ravel(), nodes[1].ravel(), settings.height)
    values, variance, length = (np.full(count, np.nan) for _ in range(3))
    ellipses, done = np.full((count, 3), np.nan), 0
    for rows in groups(places, GROUP):
        values[rows], covariance = model.kriging.together(places[rows])
        variance[rows] = np.maximum(np.diag(covariance), 0.0)
        length[rows] = error_lengths(places[rows], covariance)
        ellipses[rows] = error_ellipses(places[rows], covariance, length[rows])
        done += rows.size
        if progress is not None:
            progress(done, count)
    unknown = variance > _UNKNOWN**2 * model.covariance.variance_at(places)
    values += model.trend.at(places)
    sigma = np.sqrt(variance * model.amplitude.at(places))
    for one in (values, sigma, length, ellipses):
        one[unknown] = np.nan
    field_map = FieldMap(
        latitude,
        longitude,
        values.reshape(shape),
        unit=survey.unit,
        quantity=survey.quantity,
        sigma=sigma.reshape(shape),
        correlation_length=float(np.nanmedian(length)),
        correlation_lengths=length.reshape(shape),
        error_ellipses=ellipses.reshape(*shape, 3),
        provenance=f"{settings.method} of {model.report['readings']} readings of {survey.where}",
        file_unit=survey.file_unit,
        file_factor=survey.file_factor,
        height=_level(model, settings),
    )
    return field_map, model


def _nodes(model: Model, settings: GridSettings) -> tuple[Array, Array]:
    """Return the map's axes, rad; raises InputError where there would be too many nodes, or the
    height is below the readings."""
    survey = model.survey
    plane = survey.plane
    if settings.height is not None and settings.height < survey.floor:
        raise InputError(
            f"{survey.where}: height {settings.height:g} m is below the lowest reading"
            f" ({survey.floor:.0f} m)"
        )
    spacing = settings.spacing or _shortest(model.covariance) / 3.0
    latitude = _axis(survey.latitude, spacing / plane.north_scale)
    longitude = _axis(survey.longitude, spacing / plane.east_scale)
    count = latitude.size * longitude.size
    if count > _MOST_NODES:
        raise InputError(
            f"{survey.where}: nodes {spacing:.4g} m apart would be {count:,}, at most"
            f" {_MOST_NODES:,} are made; give a larger --spacing"
        )
    return latitude, longitude


def _axis(readings: Array, step: float) -> Array:
    """Return nodes from before the first reading to after the last."""
    low, high = float(readings.min()), float(readings.max())
    count = max(math.ceil((high - low) / step), 3) + 1
    from_middle = np.arange(count, dtype=np.float64) - 0.5 * (count - 1)
    return np.asarray(0.5 * (low + high) + step * from_middle, dtype=np.float64)


def _level(model: Model, settings: GridSettings) -> float | None:
    """Return the height of the map, where it lies on one level."""
    height = model.survey.height
    if settings.method == "sources":
        return model.default_height if settings.height is None else settings.height
    if height is not None and float(np.std(height)) < 20.0:
        return float(np.median(height))
    return None
