"""Survey readings at scattered points or along lines, and what must be true of them before a map
is made of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.earth.plane import Plane
from isogal.errors import InputError
from isogal.groups import Groups
from isogal.maps.quantities import QUANTITIES, check_plausible, said, value_range

FEWEST = 30
"""Readings that a covariance can be learnt from."""
_WIDEST = 10.0  # deg; beyond, one plane is too crude
_SAME_PLACE = 0.5  # m
_OTHERS = "height", "sigma", "line", "time"
"""Columns that a survey may have besides."""
_MOST_DUPLICATES = 0.2  # of all readings


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """N readings of one field, in the unit inside.

    Raises
    ------
    InputError
        Too few of them, on one line only, or spread over too much of the Earth.
    """

    latitude: Array
    """(N,) rad."""
    longitude: Array
    """(N,) rad, continuous (no jumps of whole circles)."""
    value: Array
    """(N,)"""
    unit: str
    quantity: str
    where: str
    """File, for messages and provenance."""
    height: Array | None = None
    """(N,) m above the ellipsoid."""
    sigma: Array | None = None
    """(N,) 1-sigma of the readings."""
    line: Integers | None = None
    """(N,) number of the survey line of each reading; None = stations."""
    line_names: Mapping[int, str] = field(default_factory=dict)
    """What the file calls the lines, by their numbers."""
    incomplete: Mapping[str, int] = field(default_factory=dict)
    """How many readings lack a height, sigma, line or time that others have; then none of it is
    used."""
    time: Array | None = None
    """(N,) when each was taken, as the file says it."""
    file_unit: str = ""
    file_factor: float = 1.0
    """See `isogal.maps.field_map.FieldMap`."""

    def __post_init__(self) -> None:
        if self.value.size < FEWEST:
            raise InputError(
                f"{self.where}: has {self.value.size} readings; at least {FEWEST} are needed"
            )
        for name, axis in (("latitude", self.latitude), ("longitude", self.longitude)):
            if np.degrees(np.ptp(axis)) > _WIDEST:
                raise InputError(
                    f"{self.where}: {name}s span {np.degrees(np.ptp(axis)):.3g} deg; at most"
                    f" {_WIDEST:g} are gridded at once"
                )
        # on one straight line nobody knows the field across it
        length, width = np.sqrt(np.linalg.eigvalsh(np.cov(self.places[:, :2].T))[::-1].clip(0.0))
        if width < 1e-2 * length or length == 0.0:
            raise InputError(
                f"{self.where}: the readings lie on one line (spread {length:.3g} m along,"
                f" {width:.3g} m across); a map needs readings on both sides"
            )

    def __len__(self) -> int:
        return int(self.value.size)

    @property
    def plane(self) -> Plane:
        """That about the middle of the readings. What its distances are off by changes their
        covariances slightly, and not where they lie."""
        return Plane.about(self.latitude, self.longitude)

    @property
    def floor(self) -> float:
        """Height of the lowest reading, m above the ellipsoid; 0 where there are no heights."""
        return 0.0 if self.height is None else float(self.height.min())

    @property
    def places(self) -> Array:
        """(N, 3) m, east, north and above `floor`."""
        up = np.zeros(len(self)) if self.height is None else self.height - self.floor
        return np.column_stack([self.plane.metres(self.latitude, self.longitude)[:, ::-1], up])

    def part(self, chosen: Booleans | Integers) -> "Survey":
        """Return some of the readings."""
        names = ("latitude", "longitude", "value", "height", "sigma", "line", "time")
        arrays = ((name, getattr(self, name)) for name in names)
        return replace(self, **{name: one[chosen] for name, one in arrays if one is not None})


def blocks_of(places: Array, side: float) -> Array:
    """Return (N, 2) in which square block of the plane each of some places (N, 2+) lies."""
    return np.asarray(np.floor((places[:, :2] - places[:, :2].min(axis=0)) / side))


def survey_of(
    columns: dict[str, Array | None],
    *,
    unit: str | None,
    quantity: str | None,
    where: str,
    line_names: Mapping[int, str] | None = None,
) -> Survey:
    """Return a survey from the columns of a file.

    Parameters
    ----------
    columns : dict
        ``latitude`` and ``longitude`` (deg), ``value`` and, where there are such, ``height``
        (m), ``sigma`` (unit of the value), ``line`` and ``time``. Rows with a coordinate or value
        that is NaN are left out.
    unit, quantity : str or None
        As the file says or the user gave; None = not known.
    where : str
    line_names : mapping, optional
        See `Survey`.

    Raises
    ------
    InputError
        Unit or quantity not known, impossible numbers, duplicates that contradict each other.
    """
    quantity, unit, factor = said(quantity, unit, where)
    latitude, longitude, value = (columns[name] for name in ("latitude", "longitude", "value"))
    assert latitude is not None and longitude is not None and value is not None
    keep = np.isfinite(latitude) & np.isfinite(longitude) & np.isfinite(value)
    most = [float(np.abs(one[keep]).max(initial=0.0)) for one in (latitude, longitude)]
    if most[0] > 90.0 or most[1] > 360.0:
        raise InputError(
            f"{where}: coordinates reach {most[0]:.6g} and {most[1]:.6g}, which are no latitudes"
            " and longitudes (deg); are they swapped or projected (--crs)?"
        )
    check_plausible(value_range(value[None, keep]), quantity, factor, where)
    others = {name: one[keep] for name in _OTHERS if (one := columns.get(name)) is not None}
    missing = {name: int((~np.isfinite(one)).sum()) for name, one in others.items()}
    whole = {name: one for name, one in others.items() if not missing[name]}
    line, sigma = whole.get("line"), whole.get("sigma")
    return without_duplicates(
        Survey(
            np.radians(latitude[keep]),
            np.unwrap(np.radians(longitude[keep])),
            value[keep] * factor,
            unit=QUANTITIES[quantity].unit,
            quantity=quantity,
            where=where,
            height=whole.get("height"),
            sigma=None if sigma is None else sigma * factor,
            line=None if line is None else np.rint(line).astype(np.int64),
            line_names=line_names or {},
            time=whole.get("time"),
            incomplete={name: count for name, count in missing.items() if 0 < count < keep.sum()},
            file_unit=unit,
            file_factor=factor,
        )
    )


def without_duplicates(survey: Survey) -> Survey:
    """Return the survey with readings at the same place (and height) taken as one, their mean.

    Raises
    ------
    InputError
        So many readings stand at the place of another that the file must be wrong, or one differs
        from another at its place by more than readings usually do anywhere.
    """
    groups = Groups.by(np.rint((survey.places + np.array([0.0, 0.0, survey.floor])) / _SAME_PLACE))
    if groups.count.max() == 1:
        return survey
    mean = groups.mean(survey.value)
    several = int((groups.count[groups.of] > 1).sum())
    if several > _MOST_DUPLICATES * len(survey):
        raise InputError(
            f"{survey.where}: {several} of {len(survey)} readings are duplicates, at the same"
            " place as others; are the columns right, or is the file joined with itself?"
        )
    off = np.abs(survey.value - mean[groups.of])
    worst = int(np.argmax(off))
    if 2.0 * off[worst] > float(np.std(survey.value)):
        raise InputError(
            f"{survey.where}: duplicate readings contradict each other: at latitude"
            f" {np.degrees(survey.latitude[worst]):.6f}, longitude"
            f" {np.degrees(survey.longitude[worst]):.6f} they differ by"
            f" {2.0 * off[worst] / survey.file_factor:.4g} {survey.file_unit}"
        )
    return replace(survey.part(groups.first), value=mean)
