"""Numbers as data sheets of inertial sensors write them: ``50ug``, ``0.01 deg/h``,
``0.002deg/rt-h``, ``300 ppm``.

A unit is a product or quotient of known units (``m/s²/√Hz``, ``ft/s/rt-h``, ``deg/h/g``), each of
which may be under a root (``√Hz``, ``rt-Hz``, ``rtHz``, ``sqrt(Hz)``) or squared (``s²``,
``s^2``). A unit of another dimension than the key's is refused, so that an angle never passes for
an acceleration. Standard gravity is 9.80665 m/s², exact by definition."""

import math
import re
from collections.abc import Sequence

from isogal.scenario.section import written

Reading = float | str
G = 9.80665
"""Standard gravity, m/s²: the unit g of data sheets."""
Dimension = tuple[float, float, float]
"""Powers of metre, second and radian."""
_M, _S, _RAD, _NONE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
_ACCELERATION = (1.0, -2.0, 0.0)
_DEGREE = math.radians(1.0)
_BASE: dict[str, tuple[float, Dimension]] = {
    "m": (1.0, _M), "km": (1e3, _M), "cm": (1e-2, _M), "mm": (1e-3, _M), "um": (1e-6, _M),
    "nm": (1e-9, _M), "ft": (0.3048, _M),
    "s": (1.0, _S), "sec": (1.0, _S), "ms": (1e-3, _S), "min": (60.0, _S), "h": (3600.0, _S),
    "hr": (3600.0, _S), "hour": (3600.0, _S), "Hz": (1.0, (0.0, -1.0, 0.0)),
    "rad": (1.0, _RAD), "mrad": (1e-3, _RAD), "urad": (1e-6, _RAD), "nrad": (1e-9, _RAD),
    "deg": (_DEGREE, _RAD), "°": (_DEGREE, _RAD), "mdeg": (1e-3 * _DEGREE, _RAD),
    "arcmin": (_DEGREE / 60.0, _RAD), "arcsec": (_DEGREE / 3600.0, _RAD),
    "g": (G, _ACCELERATION), "mg": (1e-3 * G, _ACCELERATION), "ug": (1e-6 * G, _ACCELERATION),
    "ng": (1e-9 * G, _ACCELERATION), "Gal": (1e-2, _ACCELERATION), "mGal": (1e-5, _ACCELERATION),
    "uGal": (1e-8, _ACCELERATION),
    "ppm": (1e-6, _NONE), "ppb": (1e-9, _NONE), "%": (1e-2, _NONE), "1": (1.0, _NONE),
}  # fmt: skip
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
_ROOT = re.compile(r"√\(?([^()]*)\)?|(?:sqrt|rt)[ (-]?([^()]*)\)?")
_POWER = re.compile(r"(\S+?)(?:\^?([23])|([²³]))")


class QuantityKind:
    """What a key holds: its dimension, SI unit, and an example for messages."""

    def __init__(self, unit: str, example: str, positive: bool = False) -> None:
        self.unit, self.example, self.positive = unit, example, positive
        self.dimension = unit_of(unit)[1]

    def read(self, value: Reading) -> float:
        """Return a number in SI; raises ValueError with one line where there is none."""
        if isinstance(value, str):
            match = _NUMBER.fullmatch(value)
            if match is None:
                raise ValueError(f"must be {self.allowed}, not {written(value)}")
            number = float(match[1])
            if match[2]:
                number *= self._factor(match[2])
        elif isinstance(value, int | float) and not isinstance(value, bool):
            number = float(value)
        else:
            raise ValueError(f"must be {self.allowed}, not {written(value)}")
        if not 0.0 <= number < math.inf or (self.positive and number == 0.0):
            least = "zero, negative" if self.positive else "negative"
            raise ValueError(f"must not be {least} or infinite, is {written(value)}")
        return number

    def read_axes(
        self, value: Reading | Sequence[Reading] | None
    ) -> tuple[float, float, float] | None:
        """Return one number per axis (x, y, z) of one number for all or of three; None for
        None."""
        if value is None:
            return None
        if isinstance(value, Sequence) and not isinstance(value, str):
            if len(value) != 3:
                raise ValueError(f"must be one value, or three (x, y, z), not {len(value)}")
            x, y, z = (self.read(one) for one in value)
            return x, y, z
        number = self.read(value)
        return number, number, number

    @property
    def allowed(self) -> str:
        """What may be given, in words."""
        return f"a number ({self.unit or 'of unit 1'}) or a text like {self.example}"

    def _factor(self, unit: str) -> float:
        try:
            factor, dimension = unit_of(unit)
        except ValueError as error:
            raise ValueError(f"{error}; give {self.allowed}") from None
        if dimension != self.dimension:
            raise ValueError(f"'{unit}' is not a unit of this key; give {self.allowed}")
        return factor


def unit_of(text: str) -> tuple[float, Dimension]:
    """Return factor to SI and dimension of a unit; raises ValueError where it is unknown."""
    factor, dimension = 1.0, _NONE
    sign = 1.0
    for part in re.split(r"([/*·])", text) if text else ():
        if part in ("/", "*", "·"):
            sign = -1.0 if part == "/" else 1.0
            continue
        one, powers = _part(part.strip(), text)
        factor = factor / one if sign < 0.0 else factor * one
        m, s, rad = (have + sign * more for have, more in zip(dimension, powers, strict=True))
        dimension = m, s, rad
    return factor, dimension


def _part(name: str, whole: str) -> tuple[float, Dimension]:
    """Return factor and dimension of one unit, a root or a power of one."""
    name = name.replace("µ", "u").replace("μ", "u")
    power = 1.0
    if (match := _ROOT.fullmatch(name)) is not None:
        name, power = (match[1] or match[2] or "").strip(), 0.5
    elif name not in _BASE and (match := _POWER.fullmatch(name)) is not None:
        name, power = match[1], 2.0 if (match[2] or match[3]) in "2²" else 3.0
    if name not in _BASE:
        raise ValueError(f"unknown unit '{whole}'")
    factor, (m, s, rad) = _BASE[name]
    return factor if power == 1.0 else factor**power, (m * power, s * power, rad * power)
