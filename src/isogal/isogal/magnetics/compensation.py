"""Learnt coefficients of a vehicle: applied, written, read (docs/magnetometer.md, section 4)."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import reading, write_atomic
from isogal.magnetics.readings import Readings
from isogal.magnetics.terms import COUNT, EDDY, INDUCED, PERMANENT, SCALE, terms
from isogal.yaml_text import parse_yaml

VERSION = 1
"""Of the file."""
_KEY = "isogal_magnetic_compensation"
_GROUPS = (("permanent", PERMANENT), ("induced", INDUCED), ("eddy", EDDY))
_KEYS = (_KEY, "scale_nt", *(name for name, _ in _GROUPS), "currents", "offset", "lag", "sigma")
_LARGEST = 1e7
"""nT: no vehicle has such a coefficient."""


@dataclass(frozen=True, slots=True, eq=False)
class Compensation:
    """What a vehicle adds to the total field."""

    coefficients: Array
    """(18 + 3 K,) of `isogal.magnetics.terms.terms`."""
    currents: tuple[str, ...] = ()
    """Names of the K currents."""
    offset: float = 0.0
    """nT, what it adds at any attitude; 0 where nothing told."""
    lag: float = 0.0
    """s by which the vector magnetometer is later than the scalar one."""
    sigma: Array = field(default_factory=lambda: np.zeros(0))
    """(18 + 3 K,) 1-sigma of each coefficient; empty where it is not known."""

    def own_field(self, readings: Readings) -> Array:
        """Return (N,) nT what the vehicle added to readings; NaN where one is missing.

        Raises
        ------
        InputError
            A current that counts was not recorded.
        """
        return readings.terms(self.currents, self.lag) @ self.coefficients + self.offset

    def clean(self, readings: Readings) -> Array:
        """Return (N,) nT the total field without the vehicle; raises InputError as `own_field`."""
        return readings.total - self.own_field(readings)

    def one(
        self, vector: Array, rate: Array, total: Array, currents: Array | None = None
    ) -> Array:
        """Return (...) nT what the vehicle adds to readings with a known rate of change of the
        vector, see `isogal.magnetics.terms.terms`; without `currents`, as if none flowed."""
        found = terms(vector, rate, total, currents)
        return found @ self.coefficients[: found.shape[-1]] + self.offset

    def document(self) -> dict[str, Any]:
        """Return the file's content."""
        document: dict[str, Any] = {_KEY: VERSION, "scale_nt": SCALE}
        values = [float(value) for value in self.coefficients]
        place = 0
        for group, members in _GROUPS:
            document[group] = dict(zip(members, values[place:], strict=False))
            place += len(members)
        if self.currents:
            document["currents"] = {
                name: values[COUNT + 3 * k : COUNT + 3 * k + 3]
                for k, name in enumerate(self.currents)
            }
        document |= {"offset": float(self.offset), "lag": float(self.lag)}
        if self.sigma.size:
            document["sigma"] = [float(value) for value in self.sigma]
        return document

    def write(self, path: str | Path) -> None:
        """Write the file; raises InputError where it cannot be."""
        import yaml

        head = (
            "# What a vehicle adds to the total magnetic field, learnt by isogal mag calibrate:\n"
            "# permanent nT; induced nT and eddy nT s at a field of scale_nt; currents nT/A;\n"
            "# offset nT; lag of the vector magnetometer s; sigma in the order of the terms.\n"
        )
        write_atomic(path, head + yaml.safe_dump(self.document(), sort_keys=False))


def read_compensation(path: str | Path) -> Compensation:
    """Read a file that `Compensation.write` wrote.

    Raises
    ------
    InputError
        The file cannot be read, is of another kind or version, or holds what cannot be.
    """
    with reading(path):
        text = Path(path).read_text(encoding="utf-8")
    document = parse_yaml(text, str(path))
    if not isinstance(document, dict) or _KEY not in document:
        raise InputError(f"{path}: holds no compensation; it must begin with '{_KEY}: {VERSION}'")
    return _compensation(document, str(path))


def _compensation(document: dict[str, Any], where: str) -> Compensation:
    if document[_KEY] != VERSION:
        raise InputError(f"{where}: {_KEY}: is version {document[_KEY]}, known is {VERSION}")
    for key in document:
        if key not in _KEYS:
            raise InputError(f"{where}: unknown key '{key}'; allowed: {', '.join(_KEYS)}")
    if document.get("scale_nt") != SCALE:
        raise InputError(f"{where}: scale_nt: must be {SCALE:g}")
    values: list[float] = []
    for group, members in _GROUPS:
        section = document.get(group)
        if not isinstance(section, dict) or list(section) != list(members):
            raise InputError(f"{where}: {group}: must have {', '.join(members)}, in this order")
        values += [_number(section[name], f"{where}: {group}.{name}") for name in members]
    currents = document.get("currents") or {}
    if not isinstance(currents, dict):
        raise InputError(f"{where}: currents: must be names with three numbers each")
    for name, effect in currents.items():
        values += _numbers(effect, 3, f"{where}: currents.{name}")
    sigma = document.get("sigma")
    return Compensation(
        np.array(values),
        tuple(str(name) for name in currents),
        _number(document.get("offset", 0.0), f"{where}: offset"),
        _number(document.get("lag", 0.0), f"{where}: lag"),
        np.array([] if sigma is None else _numbers(sigma, len(values), f"{where}: sigma")),
    )


def _numbers(values: Any, count: int, where: str) -> list[float]:
    if not isinstance(values, list) or len(values) != count:
        raise InputError(f"{where}: must be {count} numbers")
    return [_number(value, where) for value in values]


def _number(value: Any, where: str) -> float:
    good = isinstance(value, int | float) and not isinstance(value, bool)
    if not good or not abs(value) < _LARGEST:  # NaN is not, either
        raise InputError(f"{where}: must be a number, is {str(value)[:40]!r}")
    return float(value)
