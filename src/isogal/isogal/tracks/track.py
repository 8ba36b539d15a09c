"""A recorded track: readings of a scalar field, and where a navigator says they were taken."""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Booleans, real_numbers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import displaced
from isogal.earth.gravity import normal_gravity_gradient_north
from isogal.errors import InputError
from isogal.magnetics.readings import BaseStation
from isogal.maps.corridor import corridor_of
from isogal.maps.quantities import QUANTITIES, fitting_unit, unit_factor
from isogal.maps.tiled_map import ScalarMap
from isogal.scenario import Magnetometer
from isogal.sensors.gravimeter import DisturbanceReduction, GravityReduction
from isogal.sensors.magnetometer import MagneticReduction, MainField
from isogal.sensors.reduction import Reduction, State

REDUCTIONS = ("none", "latitude", "velocity", "main-field")
"""What readings may have been reduced with: nothing of the track, normal gravity at its latitude,
that and the Eötvös acceleration of its velocity, or the Earth's main magnetic field at its
position."""
FEWEST = 3
"""Readings that a track needs."""
_COLUMNS = ("time", "latitude", "longitude", "value", "sigma", "offset")
_OFF_SCALE = 30.0
"""Factor between the spread of the readings and the map's from which on they are taken to be in
another unit, if there is one that explains it."""
_EXPLAINED = 8.0
"""A unit explains it if the spreads differ by less than this factor in it."""
_LEAST_NORMAL_GRAVITY = 9.5
"""m/s², less than normal gravity anywhere up to 80 km."""
_NORMAL_GRAVITY_TAKEN_OFF = (
    "disturbance",
    "gravity_anomaly",
    "bouguer_disturbance",
    "bouguer_anomaly",
)
_REDUCED_WITH: dict[str, tuple[str, ...]] = {
    "gravity": ("velocity",),
    **dict.fromkeys(_NORMAL_GRAVITY_TAKEN_OFF, ("latitude", "velocity")),
    "magnetic_anomaly": ("main-field",),
}
"""What readings of a quantity can have been reduced with, besides nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """N readings with the navigator's position of each; values in the file's unit until `in_unit`
    brings them to that of the map inside (SI, nT for magnetic fields).

    Raises
    ------
    InputError
        Columns differ in shape or hold no numbers, a number is not finite, times do not increase,
        a place is out of range, or a sigma is not positive.
    """

    time: Array
    """(N,) s, increasing."""
    latitude: Array
    """(N,) rad."""
    longitude: Array
    """(N,) rad."""
    value: Array
    """(N,); NaN = no reading."""
    sigma: Array
    """(N,) 1-sigma of the sensor's white noise; NaN = not known."""
    offset: Array
    """(N,) known amount added to the map's value before it is compared with the reading."""
    where: str
    """File, for messages."""
    reduction: str = "none"
    """What of the track the readings were reduced with, one of `REDUCTIONS`."""
    quantity: str | None = None
    """What the readings are of, unit inside; None = the file does not say it."""
    factor: float = 1.0
    """Number of units inside in one unit of the file, for messages."""
    unit: str | None = None
    """Of value, sigma and offset, as the file says it; None = it does not."""
    line: str | None = None
    """Survey line; None = the file has none."""
    timed: bool = True
    """Whether the file says when readings were taken; else times are their numbers."""
    projected: bool = False
    """Whether its places are x and y."""
    unused: tuple[str, ...] = ()
    """Columns with an INS's velocity and attitude, which a rigid track has no use for."""

    def __post_init__(self) -> None:
        if self.reduction not in REDUCTIONS:
            raise InputError(
                f"reduction (--reduction) must be one of {', '.join(REDUCTIONS)}, is"
                f" '{self.reduction}'"
            )
        for name in _COLUMNS:  # from lists and columns of tables, too, whose rows have labels
            what = f"{self.where}: {name}"
            column = np.asarray(real_numbers(getattr(self, name), what), dtype=np.float64)
            object.__setattr__(self, name, column)
            if column.shape != (count := self.time.size,):
                raise InputError(f"{what} must have shape ({count},), has {column.shape}")
        for name in ("time", "latitude", "longitude", "offset"):
            self._refuse(~np.isfinite(getattr(self, name)), name, "is not a finite number")
        outside = (np.abs(self.latitude) > math.pi / 2) | (np.abs(self.longitude) > 2.0 * math.pi)
        self._refuse(
            outside, "place", "is out of range: latitude -90 to 90, longitude -180 to 360"
        )
        late = np.diff(self.time, prepend=-math.inf) <= 0.0
        self._refuse(late, "time", "is not later than that of the one before: times must increase")
        bad = (self.sigma <= 0.0) | np.isinf(self.sigma)
        self._refuse(bad, "sigma", "must be > 0 and finite")

    def _refuse(self, wrong: Booleans, name: str, why: str) -> None:
        """Raise InputError for the first reading of which something is wrong (N,)."""
        if wrong.any():
            raise InputError(f"{self.where}: {name} of reading {int(np.argmax(wrong)) + 1} {why}")

    def in_unit(
        self, factor: float, sensor_sigma: float | None, reduction: str = "none"
    ) -> "Track":
        """Return the track of a file with values in the map's unit inside.

        Parameters
        ----------
        factor : float
            Number of units inside (`FieldMap.unit`) in one unit of value, sigma and offset.
        sensor_sigma : float, optional
            1-sigma of the readings where the file does not say it, unit inside.
        reduction : str
            See `reduction`.

        Raises
        ------
        InputError
            Neither the file nor ``sensor_sigma`` says how noisy the readings are.
        """
        sigma, known = self.sigma * factor, np.isfinite(self.sigma)
        if sensor_sigma is not None:
            sigma = np.where(known, sigma, sensor_sigma)
        elif not known.all():
            several = self.quantity is not None or known.any()
            what = "a reading has no sigma" if several else "has no column sigma"
            raise InputError(f"{self.where}: {what}; give --sensor-sigma")
        value, offset = self.value * factor, self.offset * factor
        return replace(
            self, value=value, sigma=sigma, offset=offset, reduction=reduction, factor=factor
        )

    def less_variation(self, station: BaseStation) -> "Track":
        """Return the track without the daily variation of a base station, values in nT; raises
        InputError where the file has no times or the station was not on at them."""
        if not self.timed:
            raise InputError(f"{self.where}: a base station needs the track's column time")
        if self.unit is not None and unit_factor(self.unit, self.where) != ("nT", 1.0):
            raise InputError(
                f"{self.where}: value is in {self.unit}, and a base station's readings in nT"
            )
        return replace(self, value=self.value - station.variation(self.time, self.where))

    def __len__(self) -> int:
        return self.time.size

    @property
    def velocity(self) -> Array:
        """(N, 2) m/s north and east, from differences of the positions."""
        north, east = metres_per_radian(self.latitude)
        turned = np.unwrap(self.longitude)
        return np.stack(
            [np.gradient(self.latitude, self.time) * north, np.gradient(turned, self.time) * east],
            axis=-1,
        )

    def moved(self, rows: slice, error: Array) -> tuple[Array, Array]:
        """Return latitude and longitude (rad) of some rows less the track's error at the last of
        them, (4,) north, east m; m/s, of which the velocity was constant."""
        since = self.time[rows] - self.time[rows][-1]
        metres = error[:2] + np.outer(since, error[2:])
        return displaced(self.latitude[rows], self.longitude[rows], -metres)

    def jacobian(self, quantity: str) -> Array:
        """Return (N, 4) derivatives of the readings by the track's error (north, east m; m/s),
        which the reduction causes (docs/mathematics.md, section 2.6).

        They are zero where the readings were not reduced with anything of the track. Otherwise
        normal gravity was that of a wrong latitude, the Eötvös acceleration that of a wrong
        velocity, or the main field that of a wrong position.

        Raises
        ------
        InputError
            Readings of this quantity are not reduced in that way.
        """
        if self.reduction == "none":
            return np.zeros((len(self), 4))
        if self.reduction not in _REDUCED_WITH.get(quantity, ()):
            raise InputError(
                f"{self.where}: readings of {quantity} are not reduced with the track's"
                f" {self.reduction}"
            )
        reduced: Reduction = DisturbanceReduction()
        if self.reduction == "main-field":
            # any recent year will do: the gradient changes by a thousandth in one
            epoch = Magnetometer().epoch
            reduced = MagneticReduction(MainField(self.latitude, self.longitude, 0.0, epoch))
        elif quantity == "gravity":
            reduced = GravityReduction()
        moving = self.velocity.T if self.reduction == "velocity" else np.zeros(2)
        jacobian = reduced.jacobian(State(self.latitude, self.longitude, 0.0, *moving))
        if self.reduction == "latitude":
            jacobian[:, 1:] = 0.0
        return jacobian

    def normal_gravity_in_doubt(self, quantity: str) -> float:
        """Return by how much the readings may be wrong per metre of latitude (unit/m), because it
        is not known at which latitude the normal gravity in the offset was computed; zero if the
        offset holds none, or `reduction` says it."""
        if self.reduction != "none" or quantity not in _NORMAL_GRAVITY_TAKEN_OFF:
            return 0.0
        if float(np.median(self.offset)) < _LEAST_NORMAL_GRAVITY:
            return 0.0
        return float(np.abs(normal_gravity_gradient_north(self.latitude)).max())


def enough_readings(track: Track) -> None:
    """Raise InputError where a track is too short to be matched."""
    if len(track) < FEWEST:
        raise InputError(f"{track.where}: needs at least {FEWEST} readings, has {len(track)}")


def fit_to_map(track: Track, field_map: ScalarMap) -> tuple[Track, Booleans]:
    """Return a track that belongs to a map, and (N,) where the map has no value at its recorded
    places.

    Raises
    ------
    InputError
        There are fewer than three readings, or on the map, or they are not in the map's unit.
    """
    enough_readings(track)
    if (given := int(np.isfinite(track.value).sum())) < FEWEST:
        raise InputError(
            f"{track.where}: {given} of {len(track)} readings have a value, at least {FEWEST} are"
            " needed"
        )
    at_track = field_map.value(track.latitude, track.longitude)
    on_map = np.isfinite(at_track)
    usable = on_map & np.isfinite(track.value)
    if usable.sum() < FEWEST:
        extent = corridor_of(track.latitude, track.longitude, 0.0).window.text()
        raise InputError(
            f"{track.where}: the track ({extent}) is off the map {field_map.provenance}"
            f" ({field_map.extent.text()}): {int(usable.sum())} of {len(track)} readings lie where"
            " it has a value"
        )
    _check_unit(track.value[usable] - track.offset[usable], at_track[usable], field_map, track)
    return track, ~on_map


def _check_unit(level: Array, at_track: Array, field_map: ScalarMap, track: Track) -> None:
    """Raise InputError for readings (less offset) that the quantity cannot have, or whose spread
    another unit explains."""
    known = QUANTITIES[field_map.quantity]
    low, high = float(level.min()), float(level.max())
    spread, expected = float(np.std(level)), float(np.std(at_track))
    ratio = spread / expected if spread > 0.0 and expected > 0.0 else 1.0

    def possible(scale: float, off: float = math.inf) -> bool:
        """Tell whether readings times a scale can be of the map, spreads within a factor."""
        there = known.lowest <= low * scale and high * scale <= known.highest
        return there and 1.0 / off < ratio * scale < off

    if possible(1.0, _OFF_SCALE):
        return
    unit = fitting_unit(
        field_map.unit,
        lambda factor: factor != track.factor and possible(factor / track.factor, _EXPLAINED),
    )
    hint = ""
    if unit is not None:
        hint = f"; they look like {unit}: give --track-unit '{unit}'"
    elif possible(1.0):  # a flat or a noisy stretch, not another unit
        return
    elif field_map.unit == "m/s²" and known.highest < 1.0 < low:
        hint = "; they look like gravity: give normal gravity in the column offset"
    low, high, least, most = (
        x / track.factor for x in (low, high, float(at_track.min()), float(at_track.max()))
    )
    raise InputError(
        f"{track.where}: readings (less offset) of {low:.6g} to {high:.6g} do not fit the"
        f" {field_map.quantity} map {field_map.provenance}, which in their unit has {least:.6g} to"
        f" {most:.6g} along the track{hint}"
    )
