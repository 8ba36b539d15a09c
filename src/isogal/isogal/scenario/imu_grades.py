"""Grades of inertial sensors by name: those of `imu_grades.yaml`, and those of a user's own file
of the same form."""

from functools import cache, lru_cache
from importlib import resources
from pathlib import Path

from isogal.errors import InputError
from isogal.files import changed_at, reading
from isogal.scenario.inertial import Grade
from isogal.scenario.section import validated
from isogal.yaml_text import parse_yaml

PAPER_GRADES = ("precision", "quantum_accelerometer", "quantum")
"""Rows of the paper's Table 1. `quantum_accelerometer` is the paper's QAPCG: quantum
accelerometers with precision gyroscopes."""


def grade_of(name: str, path: str | None = None) -> Grade:
    """Return a grade by name, a user's own before one of Isogal's.

    Raises
    ------
    InputError
        There is no such grade, or the file cannot be used.
    """
    known = dict(built_in())
    if path is not None:
        with reading(f"grades: {path}"):
            known |= _own(path, changed_at(path))
    if name not in known:
        raise InputError(f"grade: '{name}' is not known; allowed: {', '.join(known)}")
    return known[name]


@cache
def built_in() -> dict[str, Grade]:
    """Return Isogal's own grades."""
    text = resources.files("isogal.scenario").joinpath("imu_grades.yaml").read_text("utf-8")
    return parse(text, "imu_grades.yaml")


@lru_cache(maxsize=8)
def _own(path: str, changed: int) -> dict[str, Grade]:
    """Return the grades of a file; `changed`: see `changed_at`."""
    return parse(Path(path).read_text(encoding="utf-8"), path)


def parse(text: str, where: str) -> dict[str, Grade]:
    """Return the grades of a YAML document, a mapping of names; raises InputError with one
    line."""
    document = parse_yaml(text, f"grades: {where}")
    if not isinstance(document, dict) or not document:
        raise InputError(f"grades: {where}: must map names of grades to their errors")
    return {
        str(name): validated(Grade, entry, where=f"grades: {where}: {name}: ")
        for name, entry in document.items()
    }
