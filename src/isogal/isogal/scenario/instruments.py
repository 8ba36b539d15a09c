"""Sections about what is measured on the way."""

from typing import Annotated, ClassVar, Literal, get_args

from pydantic import Field, model_validator

from isogal.scenario.section import Finite, NonNegative, Positive, Section


class Gravimeter(Section):
    """The scalar sensor: a gravimeter, unless the key `field` names another field."""

    errors: ClassVar[tuple[str, ...]] = (
        "sigma",
        "bias",
        "drift",
        "correlated_sigma",
        "bias_walk",
        "cross_coupling",
        "dynamic_pressure",
        "platform_tilt",
    )

    quantity: Literal["gravity", "disturbance"] = "gravity"
    """what the readings are reduced to and matched as"""
    sigma: Positive = 1.0e-5
    """white noise of a reading, m/s² (field: magnetic nT, terrain m)"""
    interval: Positive = 10.0
    """s between scans; a whole number of IMU samples"""
    outlier_fraction: float = Field(0.0, ge=0.0, lt=0.5)
    """share of readings that are outliers"""
    outlier_sigma: Positive = 50.0
    """1-sigma of an outlier in units of sigma"""
    bias: NonNegative = 0.0
    """1-sigma of a constant offset of all readings, unit of sigma"""
    drift: NonNegative = 0.0
    """1-sigma of a steady drift of that offset, unit of sigma per second"""
    correlated_sigma: NonNegative = 0.0
    """1-sigma of time-correlated noise beside sigma, in its unit"""
    correlation_time: Positive = 60.0
    """s, correlation time of that noise (first-order Gauss-Markov)"""
    bias_walk: NonNegative = 0.0
    """random walk of the readings' offset, unit of sigma per root second"""
    cross_coupling: NonNegative = 0.0
    """1-sigma of what a reading takes from the vehicle's forward and from its lateral
    acceleration, unit of sigma per m/s²"""
    dynamic_pressure: NonNegative = 0.0
    """1-sigma of what a reading takes from the square of the vehicle's speed, unit of sigma per
    m²/s²: of a barometer (field: ground) 0.051 s²/m times that of its pressure coefficient"""
    platform_tilt: NonNegative = Field(0.0, le=0.1)
    """1-sigma of a gravimeter's tilt about north and east, rad"""
    platform_time: Positive = 300.0
    """s, correlation time of that tilt (first-order Gauss-Markov)"""
    lever_arm: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    """of a gravimeter from the inertial sensors: forward, right, down, m"""
    filter_time: NonNegative = Field(0.0, le=300.0)
    """s, time constant of the instrument's low-pass filter"""
    delay: NonNegative = Field(0.0, le=300.0)
    """s by which readings are late, after the filter"""
    delay_sigma: NonNegative = Field(0.0, le=60.0)
    """1-sigma of a delay that is not told, which is estimated, s"""
    missing_fraction: float = Field(0.0, ge=0.0, lt=1.0)
    """share of the readings that are missing"""
    gaps: tuple[tuple[NonNegative, Positive], ...] | None = None
    """start and length in s of times without readings; null = none"""
    dead_turn_rate: Positive | None = None
    """rad/s of heading above which there are no readings; null = always some"""
    dead_time: NonNegative = 0.0
    """s after such a turn without readings"""


Vector = tuple[float, float, float]
Tensor = tuple[float, float, float, float, float, float, float, float, float]
_NO_TENSOR: Tensor = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Aircraft(Section):
    """What the vehicle adds to the magnetic field at the magnetometer, body axes."""

    permanent: Vector = (0.0, 0.0, 0.0)
    """by its own magnetisation, nT"""
    induced: Tensor = _NO_TENSOR
    """induced by the field it is in, share of it; rows of a 3 x 3 matrix"""
    eddy: Tensor = _NO_TENSOR
    """by eddy currents where that changes, s; rows of a 3 x 3 matrix"""

    @property
    def magnetic(self) -> bool:
        """Whether it adds anything."""
        return any((*self.permanent, *self.induced, *self.eddy))


class Magnetometer(Section):
    """Settings of the magnetometer that `gravimeter` does not have; for the field `magnetic`."""

    errors: ClassVar[tuple[str, ...]] = (
        "vector_sigma",
        "aircraft.permanent",
        "aircraft.induced",
        "aircraft.eddy",
    )

    epoch: float = Field(2025.0, ge=1900.0, le=2030.0)
    """when, decimal year: the main field (IGRF) changes from year to year; of readings whose
    stamps do not say it, as those since the start of a simulation"""
    compensation: str | None = None
    """coefficients of `isogal mag calibrate` that are taken off the readings; null = what aircraft
    says"""
    vector_sigma: NonNegative = 0.0
    """white noise of each component of the vector magnetometer, nT"""
    online: bool = False
    """whether the matcher estimates along what the vehicle adds: from compensation or aircraft on,
    or from nothing (a cold start)"""
    coefficient_sigma: Positive = 300.0
    """1-sigma of each coefficient of a vehicle that nobody has calibrated, nT; for online"""
    aircraft: Aircraft = Aircraft()


_Azimuth = Annotated[float, Field(ge=-360.0, le=360.0)]
_Slant = Annotated[float, Field(ge=0.0, le=75.0)]


class Altimeter(Section):
    """Range and beams of the altimeter that measures the clearance above ground; for the field
    `terrain`."""

    errors: ClassVar[tuple[str, ...]] = ("scale_sigma",)

    min_range: NonNegative = 0.0
    """m, readings below are none"""
    max_range: Positive = 20000.0
    """m, readings above are none"""
    beams: int = Field(1, ge=1, le=64)
    """how many, in a fan across the track; 1 = straight down"""
    opening: float = Field(90.0, gt=0.0, le=150.0)
    """deg between the outermost beams of the fan"""
    directions: tuple[tuple[_Azimuth, _Slant], ...] | None = Field(
        None, min_length=1, max_length=64
    )
    """instead of a fan, azimuth (clockwise from forward) and angle from straight down of each
    beam, deg; null = the fan"""
    message: Literal["points", "scan"] = "points"
    """of the nodes: points are a PointCloud2 on altimeter/points, scan is a LaserScan of the fan
    on altimeter/scan"""
    scale_sigma: NonNegative = Field(0.0, le=0.1)
    """1-sigma of a constant scale error of all ranges, as by a wrong speed of sound; it is
    estimated along"""

    @property
    def sounds(self) -> bool:
        """Whether readings are soundings with a direction each, not one clearance."""
        return self.beams > 1 or self.directions is not None or self.scale_sigma > 0.0

    @property
    def count(self) -> int:
        """How many beams there are."""
        return self.beams if self.directions is None else len(self.directions)

    @model_validator(mode="after")
    def _possible(self) -> "Altimeter":
        if self.directions is not None and self.message == "scan":
            raise ValueError("message: scan is of a fan; directions needs points")
        if self.directions is not None and self.beams > 1:
            raise ValueError("beams: says nothing where directions gives the beams")
        if self.min_range >= self.max_range:
            raise ValueError(
                f"min_range ({self.min_range:g} m) must be below max_range ({self.max_range:g} m)"
            )
        return self


Component = Literal["nn", "ne", "nd", "ee", "ed", "dd"]
TENSOR_COMPONENTS: tuple[Component, ...] = get_args(Component)
"""Second derivatives of the gravity potential by north (n), east (e) and down (d); five
determine all, as dd = -nn - ee."""


class Gradiometer(Section):
    """Measured components of the gravity gradient tensor and their noise, in Eötvös (1 E = 1e-9
    1/s²); for the field `gradient`."""

    components: tuple[Component, ...] = Field(TENSOR_COMPONENTS[:5], min_length=1, max_length=5)
    """which it measures, of nn, ne, nd, ee, ed, dd (n north, e east, d down)"""
    sigma_eotvos: Positive = 1.0
    """white noise of each component, E; instead of gravimeter.sigma"""
    covariance_eotvos: tuple[tuple[float, ...], ...] | None = None
    """covariance of the noise, row by row in the order of components, E², instead of
    sigma_eotvos"""
    bias_eotvos: NonNegative = 0.0
    """1-sigma of a constant offset of each component, E"""
    bias_walk_eotvos: NonNegative = 0.0
    """random walk of each component's offset, E per root second"""
    platform_tilt: NonNegative = Field(0.0, le=0.1)
    """1-sigma of the platform's tilt about north and about east, and of its azimuth, rad"""
    platform_time: Positive = 3600.0
    """s, correlation time of that tilt (first-order Gauss-Markov)"""
    allowed_tilt: NonNegative = Field(5e-3, le=0.1)
    """1-sigma of a tilt that the matcher of several components allows for where platform_tilt is
    0, rad; 0 = the platform is known to be level"""
    map_errors: Literal["independent", "one_potential"] = "independent"
    """how errors of the components' maps go together; one_potential: they are derivatives of one
    potential, and sigmas and lengths of the map's error are those of dd"""

    @property
    def wanders(self) -> bool:
        """Whether its readings contain what a matcher estimates along."""
        return any((self.bias_eotvos, self.bias_walk_eotvos, self.platform_tilt))

    @property
    def of_one_potential(self) -> tuple[str, ...] | None:
        """The components where the errors of their maps come from one potential."""
        return self.components if self.map_errors == "one_potential" else None

    @model_validator(mode="after")
    def _each_component_once(self) -> "Gradiometer":
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


SENSED = ("raw", "total_field", "tmi", "mag_raw", "scalar", "clearance", "range")
"""Columns that hold what an instrument senses."""


class Readings(Section):
    """Recorded readings of the instrument along the recorded track of `route.track`."""

    source: str | None = None
    """file with columns of time and readings; null = readings are simulated. Nothing of map_error
    is drawn then: the map and its error are real"""
    column: str | None = None
    """its column (or NetCDF variable); null = by the names that the field's values have"""
    unit: str | None = None
    """of the column; null = as the file says, else mGal, nT or m by the field"""
    content: Literal["auto", "map", "sensor"] = "auto"
    """what the column holds: map = values as the map has them, such as free-air anomalies, which
    are not reduced again; sensor = what the instrument senses; auto = map, but for columns raw,
    total_field, tmi, mag_raw, scalar, clearance and range"""

    @property
    def recorded(self) -> bool:
        """Whether readings are recorded ones."""
        return self.source is not None

    @property
    def reduced(self) -> bool:
        """Whether they are values of the map already."""
        if self.content != "auto":
            return self.recorded and self.content == "map"
        return self.recorded and (self.column or "").casefold() not in SENSED
