"""What a map can be a map of: names, units, and the numbers that are possible on Earth.

Every reader ends here: a unit is converted once, and numbers that cannot be what the file says are
refused with a hint."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Values
from isogal.errors import InputError
from isogal.maps.axes import EmptyWindowError

_DEGREES = "degree, degrees, °, dd, decimal degrees, " + ", ".join(
    f"{word}{mark}{way}"
    for way in ("north", "east", "n", "e")
    for word in ("degree", "degrees", "deg")
    for mark in ("_", " ", "")
)
_UNITS = (
    ("m/s²", "m/s²", 1.0, "m/s2, m/s^2, m/s**2, m s-2, m s^-2, m.s-2, m s**-2"),
    ("m/s²", "m/s²", 1.0, "meter second-2, metre second-2"),
    ("mGal", "m/s²", 1e-5, "mgal, mgals, milligal, milligals, 1e-5 m s-2, 1e-5 m/s2"),
    ("µGal", "m/s²", 1e-8, "ugal, μgal, µgal, microgal, microgals"),
    ("Gal", "m/s²", 1e-2, "gal, cm/s2, cm s-2, cm/s^2"),
    ("nm/s²", "m/s²", 1e-9, "nm/s2, nm s-2, nm/s^2"),
    ("µm/s²", "m/s²", 1e-6, "um/s2, um s-2, µm s-2, μm s-2, gu"),
    ("nT", "nT", 1.0, "nt, nanotesla, nanoteslas, gamma, gammas"),
    ("µT", "nT", 1e3, "ut, microtesla, microteslas"),
    ("T", "nT", 1e9, "tesla"),
    ("m", "m", 1.0, "metre, metres, meter, meters"),
    ("km", "m", 1e3, "kilometre, kilometer, kilometres, kilometers"),
    ("cm", "m", 1e-2, "centimetre, centimeter, centimetres, centimeters"),
    ("mm", "m", 1e-3, "millimetre, millimeter, millimetres, millimeters"),
    ("ft", "m", 0.3048, "foot, feet"),
    ("deg", "rad", np.pi / 180.0, _DEGREES),
    ("rad", "rad", 1.0, "radian, radians"),
    ("arcsec", "rad", np.pi / 648000.0, 'arcsecond, arcseconds, arc-second, arc-seconds, "'),
    ("1/s²", "1/s²", 1.0, "s-2, s^-2, 1/s2, 1/s^2, s**-2"),
    ("E", "1/s²", 1e-9, "eotvos, eötvös, eotvos unit"),
    ("m/s", "m/s", 1.0, "m s-1, m s^-1, m s**-1, m.s-1, mps"),
    ("m/s", "m/s", 1.0, "metres per second, meters per second"),
    ("kn", "m/s", 1852.0 / 3600.0, "kt, kts, knot, knots"),
    ("km/h", "m/s", 1.0 / 3.6, "km h-1, kmh, kph"),
    ("cm/s", "m/s", 1e-2, "cm s-1"),
    ("mm/s", "m/s", 1e-3, "mm s-1"),
    ("ft/s", "m/s", 0.3048, "ft s-1"),
    ("A", "A", 1.0, "ampere, amperes, amp, amps"),
    ("mA", "A", 1e-3, "milliampere, milliamperes"),
    ("1", "1", 1.0, "none, dimensionless, unitless"),
)
"""Unit, unit inside, factor to it, and other spellings, in lower case."""
UNITS = {unit: (inside, factor) for unit, inside, factor, _ in _UNITS}
"""Unit: (unit inside, factor). Inside is SI, except that magnetic fields are in nT."""
_BY_SPELLING = {
    spelling: unit
    for unit, *_, others in _UNITS
    for spelling in (unit.casefold(), *others.split(", "))
}


@dataclass(frozen=True)
class Quantity:
    """One kind of field."""

    unit: str
    """Unit inside."""
    lowest: float
    """Lowest value possible on Earth, with room to spare."""
    highest: float
    smallest: float = 0.0
    """Least size that the largest value of a map can have; below it, the unit must be wrong. Maps
    of zeros only are let pass."""
    names: str = ""
    """Variable names, functionals of ICGEM and words that mean it in files, between blanks."""


# m/s²: anomalies on land and sea stay within 1000 mGal; 0.01 mGal is below any noise
_FIELD = (-1.0e-2, 1.0e-2, 1.0e-7)
_DEFLECTION = (-1.0e-3, 1.0e-3, 1.0e-9)
_HEIGHTS = "elevation topography hsl dem topo topography_grd topography_shm etopo1_shm"
_GRADIENTS = "gravity_gradient gxx gyy gzz gxy gxz gyz"
GRAVITY = ("gravity", "disturbance")
"""Quantities whose errors are those of gravity itself."""
QUANTITIES: dict[str, Quantity] = {
    "gravity": Quantity(
        "m/s²", 9.70, 9.90, names="ga gravity_earth gravity_acceleration observed_gravity"
    ),
    # in spherical approximation (_sa), which differs by under 0.1 %, too
    "disturbance": Quantity("m/s²", *_FIELD, "dg gravity_disturbance gravity_disturbance_sa"),
    "bouguer_disturbance": Quantity("m/s²", *_FIELD),
    "gravity_anomaly": Quantity(
        "m/s²", *_FIELD, "gravity_anomaly_sa gravity_anomaly_cl free_air_anomaly faa"
    ),
    "bouguer_anomaly": Quantity("m/s²", *_FIELD, "gravity_anomaly_bg cba"),
    "magnetic_anomaly": Quantity("nT", -4.0e4, 4.0e4, 1e-2, "tmi_anomaly emag2 mag_anomaly"),
    "magnetic_field": Quantity("nT", 1.0e4, 1.0e5, names="total_field tmi"),
    "height": Quantity("m", -1.2e4, 9.5e3, names=_HEIGHTS),
    "geoid": Quantity(
        "m", -130.0, 110.0, names="ha geoid_height height_anomaly height_anomaly_ell quasigeoid"
    ),
    "deflection_north": Quantity("rad", *_DEFLECTION, "xi"),
    "deflection_east": Quantity("rad", *_DEFLECTION, "eta"),
    "gravity_north": Quantity("m/s²", *_FIELD),
    "gravity_east": Quantity("m/s²", *_FIELD),
    "gradient": Quantity("1/s²", -2.0e-6, 2.0e-6, 1.0e-13, _GRADIENTS),
}
"""Known quantities; `lowest` and `highest` leave room beyond the extremes on Earth."""


def unit_factor(unit: str, where: str, inside: str | None = None) -> tuple[str, float]:
    """Return (unit inside, factor to it) of a unit as files spell it.

    Raises
    ------
    InputError
        Unknown unit, or one of another unit inside than is needed.
    """
    text = " ".join(unit.split())
    found = UNITS.get(text) or UNITS.get(_BY_SPELLING.get(text.casefold(), ""))
    if found is None and inside is None:
        raise InputError(f"{where}: unknown unit '{unit}'; known: {', '.join(UNITS)}")
    if found is None or inside not in (None, found[0]):
        allowed = ", ".join(one for one, (base, _) in UNITS.items() if base == inside)
        what = "unknown" if found is None else "unfitting"
        raise InputError(f"{where}: {what} unit '{unit}'; must be one of {allowed}")
    return found


def fitting_unit(inside: str, fits: Callable[[float], bool]) -> str | None:
    """Return the first unit of which the factor to a unit inside fits; None where none does."""
    each = ((unit, factor) for unit, (base, factor) in UNITS.items() if base == inside)
    return next((unit for unit, factor in each if fits(factor)), None)


def quantity_of(name: str) -> str | None:
    """Return the quantity that a variable name or a phrase means, or None."""
    word = "_".join(name.casefold().replace("-", " ").replace("_", " ").split())
    fitting = (name for name, known in QUANTITIES.items() if word in (name, *known.names.split()))
    return next(fitting, None)


def check_quantity(quantity: str, where: str) -> None:
    """Raise InputError where a quantity is not one of `QUANTITIES`."""
    if quantity not in QUANTITIES:
        raise InputError(f"{where}: unknown quantity '{quantity}'; known: {', '.join(QUANTITIES)}")


def said(quantity: str | None, unit: str | None, where: str) -> tuple[str, str, float]:
    """Return quantity, unit and the factor to the unit inside, provided that both are given and
    fit each other.

    Raises
    ------
    InputError
        Not said, unknown, or not fitting.
    """
    if quantity is None:
        raise InputError(
            f"{where}: does not say what it is a map of; give quantity= (--quantity) one of"
            f" {', '.join(QUANTITIES)}{_ONCE}"
        )
    check_quantity(quantity, where)
    known = QUANTITIES[quantity]
    if unit is None:
        raise InputError(
            f"{where}: does not say its unit; give unit= (--unit; for {quantity}: {known.unit} or"
            f" one that converts to it){_ONCE}"
        )
    return quantity, unit, unit_factor(unit, f"{where}: a {quantity} map", known.unit)[1]


def value_range(values: Values) -> tuple[float, float]:
    """Return the lowest and highest value; NaN where there is none. Row by row, to need no
    memory."""
    low, high = math.inf, -math.inf
    for row in values:
        known = row[~np.isnan(row)]
        if known.size:
            low, high = min(low, float(known.min())), max(high, float(known.max()))
    return (low, high) if low <= high else (math.nan, math.nan)


def check_plausible(
    found: tuple[float, float], quantity: str, factor: float, where: str, fixed: bool = False
) -> None:
    """Refuse numbers that the quantity cannot have.

    Parameters
    ----------
    found : lowest, highest
        As they stand in the file.
    quantity : str
        One of `QUANTITIES`.
    factor : float
        From the file's unit to the quantity's.
    fixed : bool
        The format fixes unit and quantity, so that giving another is no remedy.

    Raises
    ------
    InputError
        With the range found, the range possible, and what it looks like instead.
    """
    known = QUANTITIES[quantity]
    if math.isnan(found[0]):
        raise EmptyWindowError(f"{where}: has no value at all (all missing)")
    low, high = found[0] * factor, found[1] * factor
    if quantity == "height" and "depth" in where.rpartition(":")[2].casefold() and low + high > 0:
        raise InputError(
            f"{where}: values up to {high:.6g} m by the name are depths, positive downwards, and a"
            " height is positive upwards: change their sign, or the name if they are heights"
        )
    if _possible(known, low, high):
        return
    least = f", not all below {known.smallest:g}" if known.smallest else ""
    raise InputError(
        f"{where}: values {low:.6g} to {high:.6g} {known.unit} cannot be a {quantity} map"
        f" (possible: {known.lowest:g} to {known.highest:g}{least});"
        f" {_DAMAGE if fixed else _hint(found, low, high, quantity)}"
    )


_ONCE = ", or make a file that says so with 'isogal map convert'"
_DAMAGE = "check the unit, scale, no-data value and byte order"


def _possible(known: Quantity, low: float, high: float) -> bool:
    size = max(abs(low), abs(high))
    return (
        known.lowest <= low and high <= known.highest and (size >= known.smallest or size == 0.0)
    )


def _hint(found: tuple[float, float], low: float, high: float, quantity: str) -> str:
    if any(abs(number) >= 999.0 and set(f"{abs(number):.0f}") == {"9"} for number in found):
        return "so many nines are a missing value, which the file must say"
    known = QUANTITIES[quantity]
    for other, candidate in QUANTITIES.items():
        alike = other != quantity and candidate.unit == known.unit and candidate.lowest > 0.0
        if alike and _possible(candidate, low, high):
            return f"these look like {other}: give quantity={other} (--quantity {other})"
    size = max(abs(found[0]), abs(found[1]))
    name = fitting_unit(
        known.unit,
        lambda factor: (
            (known.lowest > 0.0 or size * factor > 1e-3 * known.highest)
            and _possible(known, found[0] * factor, found[1] * factor)
        ),
    )
    if name is not None:
        return f"these look like {name}: give unit={name} (--unit {name})"
    return _DAMAGE
