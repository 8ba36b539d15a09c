"""From survey readings to a map with its own 1-sigma and correlation length at every node."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.errors import InputError
from isogal.maps.field_map import FieldMap
from isogal.maps.gridding.amplitude import Factor, learn_amplitude
from isogal.maps.gridding.blunders import FAR, Named, named, spikes
from isogal.maps.gridding.covariance import Covariance, Readings
from isogal.maps.gridding.error_lengths import error_ellipses, error_lengths
from isogal.maps.gridding.kriging import Kriging, in_groups
from isogal.maps.gridding.learning import learn
from isogal.maps.gridding.levelling import cross_overs, levelled
from isogal.maps.gridding.reduction import block_reduced, fitted_trend
from isogal.maps.gridding.spacing import gap_of, spacing_of
from isogal.maps.gridding.strike import can_be_local, with_local_strike
from isogal.maps.gridding.survey import Survey
from isogal.maps.gridding.validation import LeftOut, far_off, leave_out

METHODS = {"kriging": "matern", "equivalent-sources": "harmonic"}
"""Ways of gridding, and their covariances."""
LOCAL = "kriging with local strike"
"""What is tried as well where kriging is."""
AUTO = "auto"
"""The method that predicts readings better which were left out."""
_UNKNOWN = 0.95
"""Nodes whose 1-sigma is at least this share of the field's own have no value."""
_MOST_NODES = 4_000_000
_MOST_DEFAULT_NODES = 500_000
"""Where nobody says how far apart they are."""
_BLOCKS_IN_GAP = 16.0
"""Blocks between lines, where nobody says how large they are."""
_FEWEST_LINES = 4  # that lines are left out of
_LEVEL = 20.0  # m, 1-sigma of heights of readings that are taken to be on one level
Progress = Callable[[str, int, int], None]
"""Called with the name of a step, how much of it is done, and of how much."""


@dataclass(frozen=True, slots=True)
class GridSettings:
    """How a survey is gridded.

    Raises
    ------
    InputError
        A setting is out of range.
    """

    method: str = AUTO
    spacing: float | None = None
    """m between nodes; None = as near as interpolation between them asks for."""
    block: float | None = None
    """m, side of the blocks that readings are averaged in; None = half the spacing where that is
    given, else a sixteenth of the gap between lines; 0 = none."""
    trend: int = 1
    """Degree of the polynomial taken off first."""
    height: float | None = None
    """m above the ellipsoid, of the map; None = that of the readings."""
    level: bool = False
    """Whether lines are levelled at their crossings."""
    left_out: str | None = None
    """`lines` or `blocks`; None = lines where the survey has some."""

    def __post_init__(self) -> None:
        if self.method not in (*METHODS, AUTO):
            raise InputError(
                f"method (--method) '{self.method}' must be one of {', '.join((*METHODS, AUTO))}"
            )
        if self.height is not None and self.method == "kriging":
            raise InputError("a map at a chosen height needs the method equivalent-sources")
        if self.left_out not in (None, "lines", "blocks"):
            raise InputError(f"left out (--leave-out) '{self.left_out}': must be lines or blocks")
        if not 0 <= self.trend <= 3:
            raise InputError(f"degree of the trend must be 0 to 3, is {self.trend}")


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """What was learnt from a survey, without its map."""

    survey: Survey
    """As gridded: levelled, in blocks."""
    trend: Callable[[Array], Array]
    """Of the field, at places."""
    kriging: Kriging
    amplitude: Factor
    gap: float
    """m between lines (`spacing.gap_of`)."""
    report: dict[str, object] = field(default_factory=dict)

    def at(
        self, latitude: Array, longitude: Array, height: Array | float | None = None
    ) -> tuple[Array, Array]:
        """Return the field and its `sigma` at places (P,), rad and m above the ellipsoid
        (equivalent sources only)."""
        places = self.places(latitude, longitude, height)
        mean, variance = self.kriging.at(places)
        return mean + self.trend(places), self.sigma(places, variance)

    def sigma(self, places: Array, variance: Array) -> Array:
        """Return the 1-sigma of what is read at places (P, 3) about the map, where the
        covariance leaves a variance (P,) of the field: with what varies between neighbouring
        readings, which may be the field as well as noise, and with offsets of lines. A reading's
        known sigma is not part of it."""
        share = variance / self.covariance.variance_at(places)
        of_field = variance * self.amplitude(places, share, None)
        return np.asarray(np.sqrt(of_field + self.covariance.unresolved))

    def places(
        self, latitude: Array, longitude: Array, height: Array | float | None = None
    ) -> Array:
        """Return (P, 3) places as the kriging takes them."""
        north, east = self.survey.plane.metres(latitude, longitude).T
        up = self.default_height if height is None else height
        return np.stack([east, north, np.broadcast_to(up, east.shape) - self.survey.floor], axis=1)

    @property
    def default_height(self) -> float:
        """Of a map whose height nobody has chosen, m: the median of the readings'."""
        return self.survey.floor + float(np.median(self.kriging.readings.places[:, 2]))

    @property
    def covariance(self) -> Covariance:
        """Of the field."""
        return self.kriging.covariance


def learn_model(
    survey: Survey, settings: GridSettings, progress: Progress = lambda step, done, most: None
) -> Model:
    """Learn covariance, amplitude and noise from a survey, and check them on readings left out.
    Readings that those around them contradict are set aside (`isogal.maps.gridding.blunders`).

    Raises
    ------
    InputError
        Settings that do not fit the survey: no heights, no lines, no crossings; or readings
        that are all the same.
    """
    every = np.arange(len(survey))
    apart = np.flatnonzero(spikes(survey))
    model, far = _learnt(survey.part(np.delete(every, apart)), settings, progress)
    if not apart.size:
        return model
    place = survey.latitude[apart], survey.longitude[apart]
    height = None if survey.height is None else survey.height[apart]
    predicted, sigma = model.at(*place, height)
    sigma = np.hypot(sigma, 0.0 if survey.sigma is None else survey.sigma[apart])
    sigmas = np.abs(survey.value[apart] - predicted) / sigma
    wrong = sigmas > FAR
    if not wrong.all():
        model, far = _learnt(survey.part(np.delete(every, apart[wrong])), settings, progress)
    far[:0] = named(survey, apart[wrong], predicted[wrong], sigmas[wrong], used=False)
    return model


def _learnt(
    survey: Survey, settings: GridSettings, progress: Progress
) -> tuple[Model, list[Named]]:
    """Return what `learn_model` does by all readings, and the report's list of those far off."""
    by = _left_out_by(survey, settings)
    if np.ptp(survey.value) == 0.0:
        raise InputError(
            f"{survey.where}: the readings are all the same; there is no field to map"
        )
    gap = gap_of(survey)
    given, (survey, report) = survey, _prepared(survey, settings, gap)
    places = survey.places
    trend = fitted_trend(places, survey.value, settings.trend)
    value = survey.value - trend(places)
    readings = Readings(places, value, survey.sigma, survey.line)
    found = _candidates(readings, settings, by, gap, progress)
    # of the mean error, not of its RMS, which a few readings decide
    off = {method: float(np.mean(np.abs(out.error))) for method, (_, out) in found.items()}
    # what has more to learn is taken where it is better by more than chance (the rule of one
    # standard error; Breiman et al. 1984, section 3.4.3)
    sure = LOCAL in found and found[LOCAL][1].surely_nearer(found["kriging"][1])
    method = min((one for one in off if sure or one != LOCAL), key=off.__getitem__)
    kriging, out = found[method]
    amplitude, apart = learn_amplitude(places, value, out)
    out = out.scaled(apart)
    far = far_off(given, survey, out)
    report |= {
        "method": method,
        "mean_absolute_error": off,
        "covariance": kriging.covariance.describe(),
        "left_out": {"by": by} | out.figures(),
        "far_off": far,
    }
    return Model(survey, trend, kriging, amplitude, gap, report), far


def _candidates(
    readings: Readings, settings: GridSettings, by: str, gap: float, progress: Progress
) -> dict[str, tuple[Kriging, LeftOut]]:
    """Return what is tried: kriging by name, and the readings predicted that are left out."""
    chosen = "equivalent-sources" if settings.height is not None else settings.method
    found: dict[str, tuple[Kriging, LeftOut]] = {}

    def tried(
        name: str, kriging: Kriging, without: Callable[[Booleans], Kriging] | None = None
    ) -> None:
        shown = partial(progress, f"left out: {name}")
        found[name] = kriging, leave_out(kriging, by, shown, without)

    for method, kind in METHODS.items():
        if chosen not in (AUTO, method):
            continue
        covariance = learn(
            readings, kind=kind, progress=partial(progress, f"covariance: {method}")
        )
        tried(method, Kriging(readings, covariance))
        if kind == "matern" and can_be_local(readings.places, gap):
            local = partial(with_local_strike, readings, covariance, gap)
            tried(LOCAL, local(), local)
    return found


def _left_out_by(survey: Survey, settings: GridSettings) -> str:
    """Return whether lines or blocks are left out; raises InputError where the survey lacks what
    is asked for."""
    if settings.height is not None and survey.height is None:
        raise InputError(
            f"{survey.where}: has no column height without gaps, which a chosen height needs"
        )
    by = settings.left_out or ("blocks" if survey.line is None else "lines")
    if by == "lines":
        if survey.line is None:
            raise InputError(f"{survey.where}: has no column line without gaps; leave out blocks")
        if np.unique(survey.line).size < _FEWEST_LINES:
            return "blocks"
    return by


def _prepared(
    survey: Survey, settings: GridSettings, gap: float
) -> tuple[Survey, dict[str, object]]:
    """Return the survey levelled and in blocks, as asked for, and what there is to say of that."""
    report: dict[str, object] = {"readings": len(survey), "gap_m": gap}
    if survey.incomplete:
        report["incomplete"] = dict(survey.incomplete)
    if survey.line is not None:
        report["lines"] = int(np.unique(survey.line).size)
    if settings.level:
        crossings = cross_overs(survey)
        survey, left = levelled(survey, crossings)
        report["cross_overs"] = {"before": crossings.figures(), "after": left}
    block = settings.block
    if block is None:
        block = 0.5 * settings.spacing if settings.spacing else gap / _BLOCKS_IN_GAP
    survey = block_reduced(survey, block)
    return survey, report | {"blocks": len(survey)}


def grid_survey(
    survey: Survey, settings: GridSettings, progress: Progress = lambda step, done, most: None
) -> tuple[FieldMap, Model]:
    """Make a map of a survey.

    Parameters
    ----------
    survey : Survey
    settings : GridSettings
    progress : function, optional
        Called with the name of a step, how much of it is done, and of how much.

    Raises
    ------
    InputError
        Settings that do not fit, or more nodes than are made at once.
    """
    model = learn_model(survey, settings, progress)
    latitude, longitude = _nodes(model, settings)
    shape = latitude.size, longitude.size
    nodes = np.meshgrid(latitude, longitude, indexing="ij")
    places = model.places(nodes[0].ravel(), nodes[1].ravel(), settings.height)
    at = _at_nodes(model, places, progress)
    if not np.isfinite(at["value"]).any():
        raise InputError(
            f"{survey.where}: nowhere do the readings say more of the field than the noise that"
            " they have (sigma) hides; there is nothing to map"
        )
    field_map = FieldMap(
        latitude,
        longitude,
        at["value"].reshape(shape),
        unit=survey.unit,
        quantity=survey.quantity,
        sigma=at["sigma"].reshape(shape),
        correlation_length=float(np.nanmedian(at["length"])),
        error_ellipses=at["ellipse"].reshape(*shape, 3),
        unresolved=math.sqrt(model.covariance.unresolved),
        provenance=(
            f"{model.report['method']} of {model.report['readings']} readings of {survey.where}"
        ),
        file_unit=survey.file_unit,
        file_factor=survey.file_factor,
        height=_level(model, settings),
    )
    return field_map, model


def _at_nodes(model: Model, places: Array, progress: Progress) -> dict[str, Array]:
    """Return value, sigma and length (P,) and ellipse (P, 3) of the error at nodes (P, 3); NaN
    where nothing is known."""
    at = {name: np.full(len(places), np.nan) for name in ("value", "variance", "length")}
    at["ellipse"] = np.full((len(places), 3), np.nan)

    def kriged(rows: Integers) -> dict[str, Array]:
        mean, covariance = model.kriging.together(places[rows])
        length = error_lengths(places[rows], covariance)
        return {
            "value": mean,
            "variance": np.maximum(np.diag(covariance), 0.0),
            "length": length,
            "ellipse": error_ellipses(places[rows], covariance, length),
        }

    groups = model.kriging.groups(places)
    for rows, found in in_groups(kriged, groups, partial(progress, "nodes")):
        for name, values in found.items():
            at[name][rows] = values
    variance = at.pop("variance")
    unknown = variance > _UNKNOWN**2 * model.covariance.variance_at(places)
    at["value"] += model.trend(places)
    at["sigma"] = model.sigma(places, variance)
    for values in at.values():
        values[unknown] = np.nan
    return at


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
    spacing = settings.spacing
    if spacing is None:  # what interpolation asks for, or more where that would be too many nodes
        area = float(np.prod(np.ptp(survey.places[:, :2], axis=0)))
        least = math.sqrt(area / _MOST_DEFAULT_NODES)
        spacing = max(spacing_of(model.kriging, model.sigma, model.gap), least)
    model.report["spacing_m"] = spacing
    latitude = _axis(survey.latitude, spacing / plane.north)
    longitude = _axis(survey.longitude, spacing / plane.east)
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
    if height is None or (model.covariance.kind == "matern" and np.std(height) >= _LEVEL):
        return None
    return model.default_height if settings.height is None else settings.height
