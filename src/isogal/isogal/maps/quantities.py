"""What a map can be a map of: names, units, and the numbers that are possible on Earth.

Every reader ends here: a unit is converted once, and numbers that cannot be what the file says are refused with a hint.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isogal.errors import InputError

UNITS: dict[str, tuple[str, float]] = {
    "m/s²": ("m/s²", 1.0),
    "mGal": ("m/s²", 1e-5),
    "µGal": ("m/s²", 1e-8),
    "Gal": ("m/s²", 1e-2),
    "nm/s²": ("m/s²", 1e-9),
    "µm/s²": ("m/s²", 1e-6),
    "nT": ("nT", 1.0),
    "µT": ("nT", 1e3),
    "T": ("nT", 1e9),
    "m": ("m", 1.0),
    "km": ("m", 1e3),
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "rad": ("rad", 1.0),
    "arcsec": ("rad", np.pi / 648000.0),
    "1/s²": ("1/s²", 1.0),
    "E": ("1/s²", 1e-9),
    "1": ("1", 1.0),
}
"""Unit: (unit inside, factor). Inside is SI, except that magnetic fields are in nT."""
_SPELLINGS = {
    "m/s²": ("m/s2", "m/s^2", "m/s**2", "m s-2", "m s^-2", "m.s-2", "m s**-2", "meter second-2", "metre second-2"),
    "mGal": ("mgal", "milligal", "milligals", "mgals", "1e-5 m s-2", "1e-5 m/s2"),
    "µGal": ("ugal", "μgal", "µgal", "microgal", "microgals"),
    "Gal": ("gal", "cm/s2", "cm s-2", "cm/s^2"),
    "nm/s²": ("nm/s2", "nm s-2", "nm/s^2"),
    "µm/s²": ("um/s2", "um s-2", "µm s-2", "μm s-2", "gu"),
    "nT": ("nt", "nanotesla", "nanoteslas", "gamma", "gammas"),
    "µT": ("ut", "μt", "microtesla"),
    "T": ("t", "tesla"),
    "m": ("metre", "metres", "meter", "meters"),
    "km": ("kilometre", "kilometer", "kilometres", "kilometers"),
    "cm": ("centimetre", "centimeter", "centimetres", "centimeters"),
    "mm": ("millimetre", "millimeter", "millimetres", "millimeters"),
    "rad": ("radian", "radians"),
    "arcsec": ("arcsecond", "arcseconds", "arc-second", "arc-seconds", '"'),
    "1/s²": ("s-2", "s^-2", "1/s2", "1/s^2", "s**-2"),
    "E": ("eotvos", "eötvös", "eotvos unit"),
    "1": ("none", "dimensionless", "unitless"),
}
_BY_SPELLING = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings}


@dataclass(frozen=True)
class Quantity:
    """One kind of field."""

    unit: str
    """Unit inside."""
    lowest: float
    """Lowest value possible on Earth, with room to spare."""
    highest: float
    names: tuple[str, ...] = ()
    """Variable names and words that mean it in files."""


QUANTITIES: dict[str, Quantity] = {
    "gravity": Quantity(
        "m/s²", 9.70, 9.90, ("ga", "gravity", "gravity_earth", "gravity_acceleration", "observed_gravity")
    ),
    "disturbance": Quantity(
        "m/s²", -1.0e-2, 1.0e-2, ("dg", "disturbance", "gravity_disturbance", "gravity_disturbance_sa")
    ),
    "bouguer_disturbance": Quantity("m/s²", -1.0e-2, 1.0e-2),
    "gravity_anomaly": Quantity("m/s²", -1.0e-2, 1.0e-2, ("gravity_anomaly_sa", "free_air_anomaly", "faa")),
    "bouguer_anomaly": Quantity("m/s²", -1.0e-2, 1.0e-2, ("gravity_anomaly_bg", "cba")),
    "magnetic_anomaly": Quantity("nT", -4.0e4, 4.0e4, ("magnetic_anomaly", "tmi_anomaly", "emag2", "mag_anomaly")),
    "magnetic_field": Quantity("nT", 1.0e4, 1.0e5, ("magnetic_field", "total_field", "tmi")),
    "height": Quantity("m", -1.2e4, 9.5e3, ("height", "elevation", "topography", "ha", "hsl", "dem", "topo")),
    "geoid": Quantity("m", -130.0, 110.0, ("geoid", "geoid_height", "height_anomaly", "quasigeoid")),
    "deflection_north": Quantity("rad", -1.0e-3, 1.0e-3, ("xi", "deflection_north")),
    "deflection_east": Quantity("rad", -1.0e-3, 1.0e-3, ("eta", "deflection_east")),
    "gradient": Quantity(
        "1/s²", -2.0e-6, 2.0e-6, ("gradient", "gravity_gradient", "gxx", "gyy", "gzz", "gxy", "gxz", "gyz")
    ),
}
"""Known quantities; `lowest` and `highest` leave room beyond the extremes on Earth."""


def unit_factor(unit: str, where: str) -> tuple[str, float]:
    """Return (unit inside, factor to it) of a unit as files spell it.

    Raises
    ------
    InputError
        Unknown unit.
    """
    text = " ".join(unit.split())
    if text in UNITS:
        return UNITS[text]
    known = _BY_SPELLING.get(text.casefold())
    if known is None:
        raise InputError(f"{where}: unknown unit '{unit}'; known: {', '.join(UNITS)}")
    return UNITS[known]


def quantity_of(name: str) -> str | None:
    """Return the quantity that a variable name or a phrase means, or None."""
    word = "_".join(name.casefold().replace("-", " ").replace("_", " ").split())
    for quantity, known in QUANTITIES.items():
        if word == quantity or word in known.names:
            return quantity
    return None


def check_quantity(name: str, where: str) -> Quantity:
    """Return the quantity of that name, or raise InputError naming those known."""
    if name not in QUANTITIES:
        raise InputError(f"{where}: unknown quantity '{name}'; known: {', '.join(QUANTITIES)}")
    return QUANTITIES[name]


def check_plausible(values: NDArray[np.floating], quantity: str, where: str) -> None:
    """Refuse numbers that the quantity cannot have.

    Parameters
    ----------
    values : array
        In the quantity's unit inside; NaN is skipped.

    Raises
    ------
    InputError
        With the range found, the range possible, and what it looks like instead.
    """
    known = check_quantity(quantity, where)
    with np.errstate(invalid="ignore"):
        low = min((float(np.nanmin(row)) for row in values if np.isfinite(row).any()), default=np.nan)
        high = max((float(np.nanmax(row)) for row in values if np.isfinite(row).any()), default=np.nan)
    if np.isnan(low):
        raise InputError(f"{where}: has no value at all (all missing)")
    if known.lowest <= low and high <= known.highest:
        return
    raise InputError(
        f"{where}: values {low:.6g} to {high:.6g} {known.unit} cannot be a {quantity} map"
        f" (possible: {known.lowest:g} to {known.highest:g}){_hint(low, high, quantity)}"
    )


def _hint(low: float, high: float, quantity: str) -> str:
    unit = QUANTITIES[quantity].unit
    for other, known in QUANTITIES.items():
        if (
            other != quantity
            and known.unit == unit
            and known.lowest > 0.0
            and known.lowest <= low
            and high <= known.highest
        ):
            return f"; these look like {other}: give quantity={other}"
    for name, (inside, factor) in UNITS.items():
        known = QUANTITIES[quantity]
        if inside == unit and factor != 1.0 and known.lowest <= low * factor and high * factor <= known.highest:
            spread = max(abs(low), abs(high)) * factor
            if known.lowest > 0.0 or spread > 1e-2 * known.highest:
                return f"; these look like {name}: give unit={name}"
    return "; check the unit, scale, no-data value and byte order"
