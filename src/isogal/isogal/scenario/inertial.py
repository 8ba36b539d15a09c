"""The section about the inertial sensors: a grade, by name one of `imu_grades.yaml` or of a user's
own file of the same form, and what a data sheet says otherwise.

docs/inertial-sensors.md says how a data sheet is entered; docs/mathematics.md, section 3.3, what
the numbers mean."""

from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Field, model_validator

from isogal.errors import InputError
from isogal.files import changed_at, reading
from isogal.scenario.data_sheet import QuantityKind
from isogal.scenario.section import Document, Positive, Section, validated
from isogal.yaml_text import parse_yaml

Axes = tuple[float, float, float]
BIAS_TIME = 1000.0
"""s, correlation time of the bias instability where nobody gives one."""

FORCE = QuantityKind("m/s²", "50ug")
FORCE_NOISE = QuantityKind("m/s²/√Hz", "30ug/rt-Hz")
SPEED = QuantityKind("m/s", "0.1mm/s")
RATE = QuantityKind("rad/s", "0.01deg/h")
RATE_NOISE = QuantityKind("rad/s/√Hz", "0.002deg/rt-h")
RATE_BY_FORCE = QuantityKind("rad*s/m", "0.1deg/h/g")
ANGLE = QuantityKind("rad", "20arcsec")
RATIO = QuantityKind("", "300ppm")
TIME = QuantityKind("s", "1h", positive=True)

_Force = Annotated[Axes | None, BeforeValidator(FORCE.read_axes)]
_ForceNoise = Annotated[Axes | None, BeforeValidator(FORCE_NOISE.read_axes)]
_Speed = Annotated[Axes | None, BeforeValidator(SPEED.read_axes)]
_Rate = Annotated[Axes | None, BeforeValidator(RATE.read_axes)]
_RateNoise = Annotated[Axes | None, BeforeValidator(RATE_NOISE.read_axes)]
_RateByForce = Annotated[Axes | None, BeforeValidator(RATE_BY_FORCE.read_axes)]
_Angle = Annotated[Axes | None, BeforeValidator(ANGLE.read_axes)]
_Ratio = Annotated[Axes | None, BeforeValidator(RATIO.read_axes)]
_Time = Annotated[Axes | None, BeforeValidator(TIME.read_axes)]


def _key(kind: QuantityKind, description: str) -> Any:
    return Field(
        None,
        description=f"{description}; null = the grade's",
        json_schema_extra={"quantity": kind.allowed},
    )


class Accelerometer(Section):
    """Errors of the accelerometers, 1-sigma, one value or three (x, y, z)."""

    bias: _Force = _key(FORCE, "bias at turn-on, constant over a run")
    bias_instability: _Force = _key(FORCE, "bias that changes within a run")
    bias_time: _Time = _key(TIME, "correlation time of bias_instability")
    random_walk: _ForceNoise = _key(FORCE_NOISE, "density of white noise (velocity random walk)")
    scale_factor: _Ratio = _key(RATIO, "error of the scale factor")
    misalignment: _Angle = _key(ANGLE, "tilt of an axis towards each of the two others")
    quantisation: _Speed = _key(SPEED, "velocity increment of one count")


class Gyroscope(Section):
    """Errors of the gyroscopes, 1-sigma, one value or three (x, y, z)."""

    bias: _Rate = _key(RATE, "bias at turn-on, constant over a run")
    bias_instability: _Rate = _key(RATE, "bias that changes within a run")
    bias_time: _Time = _key(TIME, "correlation time of bias_instability")
    random_walk: _RateNoise = _key(RATE_NOISE, "density of white noise (angle random walk)")
    scale_factor: _Ratio = _key(RATIO, "error of the scale factor")
    misalignment: _Angle = _key(ANGLE, "tilt of an axis towards each of the two others")
    g_sensitivity: _RateByForce = _key(RATE_BY_FORCE, "rate by specific force along any axis")
    quantisation: _Angle = _key(ANGLE, "angle increment of one count")


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """Errors of three accelerometers or gyroscopes, 1-sigma per axis (x, y, z), SI."""

    bias: Axes
    """At turn-on, constant over a run; m/s² or rad/s."""
    bias_instability: Axes
    """Of the first-order Gauss-Markov process that comes on top of it; m/s² or rad/s."""
    bias_time: Axes
    """Its correlation time, s."""
    random_walk: Axes
    """Density of white noise, m/s²/sqrt(Hz) or rad/s/sqrt(Hz)."""
    scale_factor: Axes
    """Constant over a run."""
    misalignment: Axes
    """rad, of an axis towards each of the two others; constant over a run."""
    quantisation: Axes
    """Increment of one count, m/s or rad; 0 = none."""
    g_sensitivity: Axes
    """Gyroscopes: rad/s per m/s² along each axis, constant over a run; accelerometers: 0."""


@dataclass(frozen=True, slots=True)
class ImuErrors:
    """Errors of the inertial sensors."""

    accelerometer: SensorErrors
    gyroscope: SensorErrors


class Grade(Section):
    """An entry of a file of grades."""

    source: str = Field("", description="where the numbers are from")
    accelerometer: Accelerometer = Accelerometer()
    gyroscope: Gyroscope = Gyroscope()


class Imu(Section):
    """The inertial sensors: those of a grade, but for what is given beside it."""

    errors: ClassVar[tuple[str, ...]] = (
        *(f"accelerometer.{key}" for key in Accelerometer.model_fields if key != "bias_time"),
        *(f"gyroscope.{key}" for key in Gyroscope.model_fields if key != "bias_time"),
    )
    """Keys that are errors."""

    grade: str = Field(
        "precision",
        description=(
            "precision, quantum_accelerometer, quantum (the paper's Table 1), navigation,"
            " tactical, quantum_hybrid, phone, or one of the file grades"
        ),
    )
    grades: str | None = Field(
        None, description="YAML file of further grades; see docs/inertial-sensors.md"
    )
    rate: Positive = Field(1.0, le=1000.0, description="samples per second, Hz")
    declared_noise: bool = Field(
        False,
        description=(
            "whether the noise of the gyroscopes that a sample declares counts where it is larger"
            " than the sensors' own; drivers often declare what is not so"
        ),
    )
    accelerometer: Accelerometer = Accelerometer()
    gyroscope: Gyroscope = Gyroscope()

    @model_validator(mode="after")
    def _known_grade(self) -> "Imu":
        self.sensors  # noqa: B018 - raises where there is no such grade
        return self

    @property
    def sensors(self) -> ImuErrors:
        """The errors of the sensors, all of them."""
        grade = grade_of(self.grade, self.grades)
        return ImuErrors(
            _resolved(self.accelerometer, grade.accelerometer),
            _resolved(self.gyroscope, grade.gyroscope),
        )

    def resolved(self) -> Document:
        """Return the section as a document in which every error is given."""
        document, sensors = self.model_dump(), self.sensors
        for name in ("accelerometer", "gyroscope"):
            document[name] = {key: getattr(getattr(sensors, name), key) for key in document[name]}
        return document


def _resolved(given: Section, grade: Section) -> SensorErrors:
    """Return what is given, else the grade's, else zero."""
    values: dict[str, Axes] = {}
    for key in SensorErrors.__dataclass_fields__:
        own, else_ = getattr(given, key, None), getattr(grade, key, None)
        none = BIAS_TIME if key == "bias_time" else 0.0
        values[key] = own or else_ or (none, none, none)
    return SensorErrors(**values)


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
