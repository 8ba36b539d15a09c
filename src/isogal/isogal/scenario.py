"""The scenario: one YAML document, validated, that says everything about a run.

Keys, units and defaults are those of the public contract. Unknown keys are errors that name the
nearest key."""

import difflib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from isogal.errors import InputError

LatitudeDeg = Annotated[float, Field(ge=-89.0, le=89.0)]
LongitudeDeg = Annotated[float, Field(ge=-180.0, le=360.0)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


class Route(_Section):
    """Where the vehicle goes, at which speed (m/s) and ellipsoidal height (m), for how long (s;
    null = to the end)."""

    start: tuple[LatitudeDeg, LongitudeDeg] | None = Field(
        (-38.0, 144.5), description="first point: latitude, longitude in deg"
    )
    end: tuple[LatitudeDeg, LongitudeDeg] | None = Field(
        (-35.0, 150.0), description="last point: latitude, longitude in deg"
    )
    speed: Positive = Field(
        22.0, le=1000.0, description="ground speed at the vehicle's height, m/s"
    )
    height: float = Field(
        100.0, ge=-12000.0, le=50000.0, description="height above the map's surface, m"
    )
    duration: Positive | None = Field(
        12960.0, description="simulated time, s; null = until the last point"
    )
    line: Literal["rhumb", "geodesic"] = Field("rhumb", description="how start and end are joined")
    waypoints: tuple[tuple[LatitudeDeg, LongitudeDeg, Positive], ...] | None = Field(
        None,
        description=(
            "latitude deg, longitude deg, speed m/s of each point, instead of start/end/speed"
        ),
    )
    turn_rate: Positive = Field(
        0.02, le=0.5, description="heading rate in turns between waypoints, rad/s"
    )
    acceleration: Positive = Field(
        0.1, le=10.0, description="speed change between waypoints, m/s²"
    )

    @model_validator(mode="after")
    def _enough_points(self) -> "Route":
        if self.waypoints is not None and len(self.waypoints) < 2:
            raise ValueError("waypoints needs at least two points")
        if self.waypoints is None and (self.start is None or self.end is None):
            raise ValueError("give start and end, or waypoints")
        if self.waypoints is None and self.start == self.end:
            raise ValueError("start and end must differ")
        return self


class Imu(_Section):
    """Inertial sensors."""

    grade: Literal["precision", "quantum_accelerometer", "quantum"] = Field(
        "precision", description="row of the paper's Table 1"
    )
    rate: Positive = Field(1.0, le=100.0, description="samples per second, Hz")


class InitialError(_Section):
    """1-sigma per axis of the navigator's initial errors (SCIENCE: the paper leaves them open)."""

    position: NonNegative = Field(50.0, description="m, north and east")
    velocity: NonNegative = Field(0.05, description="m/s, north and east")
    tilt: NonNegative = Field(2.5e-5, le=0.1, description="rad, about north and east")
    heading: NonNegative = Field(3.0e-4, le=0.5, description="rad, about down")
    hidden_position: NonNegative = Field(
        0.0,
        description=(
            "m, size of a further position error, in a random direction, that the navigator is not"
            " told of"
        ),
    )


class Gravimeter(_Section):
    """The scalar sensor, a gravimeter unless `Scenario.field` says another."""

    quantity: Literal["gravity", "disturbance"] = Field(
        "gravity", description="what the readings are reduced to and matched as"
    )
    sigma: Positive = Field(
        1.0e-5, description="white noise of a reading, m/s² (field: magnetic nT, terrain m)"
    )
    interval: Positive = Field(10.0, description="s between scans; a whole number of IMU samples")
    outlier_fraction: float = Field(
        0.0, ge=0.0, lt=0.5, description="share of readings that are outliers"
    )
    outlier_sigma: Positive = Field(50.0, description="1-sigma of an outlier in units of sigma")
    bias: NonNegative = Field(
        0.0, description="1-sigma of a constant offset of all readings, unit of sigma"
    )
    drift: NonNegative = Field(
        0.0, description="1-sigma of a steady drift of that offset, unit of sigma per second"
    )


class Magnetometer(_Section):
    """What field: magnetic needs besides."""

    epoch: float = Field(
        2025.0,
        ge=1900.0,
        le=2030.0,
        description="when, decimal year: the main field (IGRF) changes from year to year",
    )


class Altimeter(_Section):
    """What field: terrain needs besides: the range of the clearance meter."""

    min_range: NonNegative = Field(0.0, description="m, readings below are none")
    max_range: Positive = Field(20000.0, description="m, readings above are none")

    @model_validator(mode="after")
    def _some_range(self) -> "Altimeter":
        if self.min_range >= self.max_range:
            raise ValueError(
                f"min_range ({self.min_range:g} m) must be below max_range ({self.max_range:g} m)"
            )
        return self


TENSOR_COMPONENTS = ("nn", "ne", "nd", "ee", "ed", "dd")
"""Second derivatives of the gravity potential by north (n), east (e) and down (d); five of them
say all: dd = -nn - ee."""


class Gradiometer(_Section):
    """What field: gradient needs besides: components of the gravity gradient tensor and their
    noise, in Eötvös (1 E = 1e-9 1/s²)."""

    components: tuple[str, ...] = Field(
        TENSOR_COMPONENTS[:5],
        min_length=1,
        max_length=5,
        description="which it measures, of nn, ne, nd, ee, ed, dd (n north, e east, d down)",
    )
    sigma_eotvos: Positive = Field(
        1.0, description="white noise of each component, E; instead of gravimeter.sigma"
    )
    covariance_eotvos: tuple[tuple[float, ...], ...] | None = Field(
        None,
        description=(
            "covariance of the noise, row by row in the order of components, E², instead of"
            " sigma_eotvos"
        ),
    )

    @model_validator(mode="after")
    def _known_components(self) -> "Gradiometer":
        unknown = [name for name in self.components if name not in TENSOR_COMPONENTS]
        if unknown:
            raise ValueError(
                f"components: unknown '{unknown[0]}'; allowed: {', '.join(TENSOR_COMPONENTS)}"
            )
        if len(set(self.components)) < len(self.components):
            raise ValueError(f"components: each once, not {', '.join(self.components)}")
        return self

    @model_validator(mode="after")
    def _possible_covariance(self) -> "Gradiometer":
        if self.covariance_eotvos is None:
            return self
        count = len(self.components)
        if [len(row) for row in self.covariance_eotvos] != [count] * count:
            raise ValueError(
                f"covariance_eotvos: must have {count} rows of {count} numbers, one for each of"
                " components"
            )
        import numpy as np

        matrix = np.array(self.covariance_eotvos)
        symmetric = np.isfinite(matrix).all() and np.allclose(
            matrix, matrix.T, rtol=1e-9, atol=0.0
        )
        if not (symmetric and np.linalg.eigvalsh(matrix).min() > 0.0):
            raise ValueError("covariance_eotvos: must be symmetric and positive definite")
        return self


class Map(_Section):
    """The map."""

    source: str = Field("synthetic", description="'synthetic', or a file, or a GGMplus folder")
    path: str | None = Field(
        None, description="file or folder, where source names a format instead of a file"
    )
    variable: str | None = Field(
        None, description="variable in the file, for example ga or dg; null = by quantity"
    )


class MapError(_Section):
    """How the simulated truth differs from the map: a Gaussian field with covariance sigma² exp(-d
    / L)."""

    sigma: NonNegative = Field(
        0.0, description="m/s² (field: magnetic nT, terrain m, gradient 1/s²)"
    )
    correlation_length: Positive = Field(4000.0, description="L, m")


MATCHER_NAMES = (
    "pmht",
    "pmht-paper",
    "tercom",
    "iccp",
    "sitan",
    "particle",
    "point-mass",
    "viterbi",
)


class Matcher(_Section):
    """The map matcher and what it assumes."""

    name: Literal[
        "pmht", "pmht-paper", "tercom", "iccp", "sitan", "particle", "point-mass", "viterbi"
    ] = Field("pmht", description="matching algorithm")
    batch_length: int = Field(30, ge=2, le=1000, description="scans T in a batch")
    stride: int | None = Field(
        None, ge=1, le=1000, description="scans between fixes; null = batch_length"
    )
    mode: Literal["standard", "retrodiction"] = Field(
        "standard", description="one fix a batch, or one for each of its scans"
    )
    map_sigma: NonNegative | Literal["auto"] = Field(
        0.0,
        description="1-sigma of the map's error assumed, in the unit of gravimeter.sigma, or auto",
    )
    map_correlation_length: Positive = Field(4000.0, description="its correlation length, m")
    bias_sigma: NonNegative = Field(
        0.0,
        description=(
            "1-sigma of an unknown constant offset of the readings, in the unit of"
            " gravimeter.sigma"
        ),
    )
    options: dict[str, Any] = Field(
        default_factory=dict, description="settings of the named matcher; see docs/matchers.md"
    )

    @model_validator(mode="after")
    def _stride_fits(self) -> "Matcher":
        if self.stride is not None and self.stride > self.batch_length:
            raise ValueError(
                f"stride ({self.stride}) must not exceed batch_length ({self.batch_length})"
            )
        return self

    @property
    def scans_between_fixes(self) -> int:
        """Stride, resolved."""
        return self.batch_length if self.stride is None else self.stride


class Scenario(_Section):
    """A whole run."""

    seed: int = Field(0, ge=0, description="every random stream derives from it")
    field: Literal["gravity", "disturbance", "magnetic", "terrain", "gradient"] | None = Field(
        None, description="field that is measured and matched; null = gravimeter.quantity"
    )
    route: Route = Route()
    imu: Imu = Imu()
    initial_error: InitialError = InitialError()
    gravimeter: Gravimeter = Gravimeter()
    magnetometer: Magnetometer = Magnetometer()
    altimeter: Altimeter = Altimeter()
    gradiometer: Gradiometer = Gradiometer()
    map: Map = Map()
    map_error: MapError = MapError()
    matcher: Matcher = Matcher()

    @model_validator(mode="after")
    def _whole_scans(self) -> "Scenario":
        steps = self.gravimeter.interval * self.imu.rate
        if abs(steps - round(steps)) > 1e-9 or round(steps) < 1:
            raise ValueError(
                f"gravimeter.interval ({self.gravimeter.interval} s) must be a whole number of IMU"
                f" samples (1/{self.imu.rate} s)"
            )
        return self

    @property
    def measured_field(self) -> str:
        """Name of the field that is measured and matched, one of
        `isogal.fields.measured.FIELDS`."""
        return self.field or self.gravimeter.quantity

    @property
    def steps_per_scan(self) -> int:
        """IMU samples from one gravimeter reading to the next."""
        return round(self.gravimeter.interval * self.imu.rate)


def load_scenario(path: str | Path | None = None, overrides: Iterable[str] = ()) -> Scenario:
    """Read a scenario file (null = all defaults), apply ``KEY=VALUE`` overrides (YAML values,
    dotted keys), validate.

    Raises
    ------
    InputError
        One line that names the file and key and what is allowed.
    """
    where = "scenario" if path is None else str(path)
    document: Any = {}
    if path is not None:
        try:
            document = yaml.safe_load(Path(path).read_text(encoding="utf-8")) or {}
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(
                f"{where}: cannot be read: {getattr(error, 'strerror', None) or error}"
            ) from None
        except yaml.YAMLError as error:
            mark = getattr(error, "problem_mark", None)
            line = f" (line {mark.line + 1})" if mark else ""
            raise InputError(
                f"{where}: not valid YAML{line}: {getattr(error, 'problem', error)}"
            ) from None
        if not isinstance(document, dict):
            raise InputError(f"{where}: must be a mapping of keys, is a {type(document).__name__}")
    for item in overrides:
        _override(document, item)
    return validate_scenario(document, where)


def validate_scenario(document: Mapping[str, Any], where: str = "scenario") -> Scenario:
    """Validate an already parsed document; raises InputError with one line.

    YAML 1.1 reads 1e-5 (no dot) as a string; pydantic turns it into the number that is meant,
    where a number belongs."""
    try:
        return Scenario.model_validate(document)
    except ValidationError as error:
        raise InputError(f"{where}: {describe(error)}") from None


def describe(error: ValidationError) -> str:
    """Turn a validation error into one line: every bad key, what it was, what it may be."""
    parts = []
    for item in error.errors():
        location = [
            str(part)
            for part in item["loc"]
            if not str(part).startswith(("function-", "constrained-", "literal", "float", "tuple"))
        ]
        key = ".".join(location)
        if item["type"] == "extra_forbidden":
            parts.append(f"unknown key '{key}'{_nearest(key)}")
        elif item["type"] == "value_error":
            parts.append(f"{key + ': ' if key else ''}{item['msg'].removeprefix('Value error, ')}")
        else:
            message = item["msg"][0].lower() + item["msg"][1:]
            parts.append(f"{key}: {message}, not {item['input']!r}")
    return "; ".join(dict.fromkeys(parts))


def known_keys(model: type[BaseModel] = Scenario, prefix: str = "") -> list[str]:
    """List all dotted keys of a scenario."""
    keys = []
    for name, field in model.model_fields.items():
        keys.append(prefix + name)
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            keys += known_keys(field.annotation, f"{prefix}{name}.")
    return keys


def _nearest(key: str) -> str:
    """Suggest a key of the same section with a like name, or of any section with that name, or
    list the section's keys."""
    section, _, leaf = key.rpartition(".")
    keys = known_keys()
    siblings = [k for k in keys if k.rpartition(".")[0] == section]
    for candidates, cutoff in ((siblings, 0.6), (keys, 0.8)):
        leaves = {k.rpartition(".")[2]: k for k in candidates}
        close = [name for name in leaves if leaf and name.startswith(f"{leaf}_")]
        close = close or difflib.get_close_matches(leaf, leaves, n=1, cutoff=cutoff)
        if close:
            return f", did you mean '{leaves[close[0]]}'?"
    return f"; allowed: {', '.join(siblings)}" if siblings else ""


def _override(document: dict[str, Any], item: str) -> None:
    key, equals, text = item.partition("=")
    if not equals or not key:
        raise InputError(
            f"--set {item}: must be KEY=VALUE, for example --set matcher.batch_length=15"
        )
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        raise InputError(f"--set {item}: the value is not valid YAML") from None
    target = document
    *parents, last = key.split(".")
    for parent in parents:
        target = target.setdefault(parent, {})
        if not isinstance(target, dict):
            raise InputError(f"--set {item}: '{parent}' is a value, not a section")
    target[last] = value
