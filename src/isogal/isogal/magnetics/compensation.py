"""Learnt coefficients of a vehicle: applied, written, read (docs/magnetometer.md, section 4)."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import reading, write_atomic
from isogal.magnetics.readings import Readings
from isogal.magnetics.terms import COUNT, EDDY, INDUCED, PERMANENT, SCALE, terms
from isogal.scenario import validated
from isogal.yaml_text import parse_yaml

_KEY = "isogal_magnetic_compensation"
_HEAD = (
    "# What a vehicle adds to the total magnetic field, learnt by isogal mag calibrate:\n"
    "# permanent nT; induced nT and eddy nT s at a field of scale_nt; currents nT/A;\n"
    "# offset nT; lag of the vector magnetometer s; sigma in the order of the terms.\n"
)
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
    """nT, what it adds at any attitude; 0 where nothing has shown it."""
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

    def one(self, vector: Array, rate: Array, total: Array) -> Array:
        """Return (...) nT what the vehicle adds to readings with a known rate of change of the
        vector, see `isogal.magnetics.terms.terms`, as if no currents flowed."""
        return terms(vector, rate, total) @ self.coefficients[:COUNT] + self.offset

    def document(self) -> dict[str, object]:
        """Return the file's content."""
        values = self.coefficients.tolist()
        permanent, induced, eddy = (
            dict(zip(names, values[first : first + len(names)], strict=True))
            for names, first in ((PERMANENT, 0), (INDUCED, 3), (EDDY, 9))
        )
        currents = {
            name: values[COUNT + 3 * k : COUNT + 3 * k + 3] for k, name in enumerate(self.currents)
        }
        return (
            {_KEY: 1, "scale_nt": SCALE}
            | {"permanent": permanent, "induced": induced, "eddy": eddy}
            | ({"currents": currents} if currents else {})
            | {"offset": float(self.offset), "lag": float(self.lag)}
            | ({"sigma": self.sigma.tolist()} if self.sigma.size else {})
        )

    def write(self, path: str | Path) -> None:
        """Write the file; raises InputError where it cannot be."""
        import yaml

        write_atomic(path, _HEAD + yaml.safe_dump(self.document(), sort_keys=False))


_Number = Annotated[float, Field(strict=True, gt=-_LARGEST, lt=_LARGEST)]


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    isogal_magnetic_compensation: Literal[1]
    scale_nt: Literal[50_000]
    permanent: Annotated[dict[Literal["x", "y", "z"], _Number], Field(min_length=3)]
    induced: Annotated[
        dict[Literal["xx", "xy", "xz", "yy", "yz", "zz"], _Number], Field(min_length=6)
    ]
    eddy: Annotated[
        dict[Literal["xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"], _Number],
        Field(min_length=9),
    ]
    currents: dict[str, tuple[_Number, _Number, _Number]] | None = None
    offset: _Number = 0.0
    lag: _Number = 0.0
    sigma: list[_Number] | None = None


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
        raise InputError(f"{path}: holds no compensation; it must begin with '{_KEY}: 1'")
    if document[_KEY] != 1:
        raise InputError(f"{path}: {_KEY}: is version {document[_KEY]}, known is 1")
    file = validated(_File, document, where=f"{path}: ")
    document = file.model_dump()
    groups = (PERMANENT, "permanent"), (INDUCED, "induced"), (EDDY, "eddy")
    values = [document[section][name] for names, section in groups for name in names]
    currents, sigma = file.currents or {}, file.sigma or []
    values += [one for effect in currents.values() for one in effect]
    if sigma and len(sigma) != len(values):
        raise InputError(f"{path}: sigma: must be {len(values)} numbers")
    return Compensation(np.array(values), tuple(currents), file.offset, file.lag, np.array(sigma))
