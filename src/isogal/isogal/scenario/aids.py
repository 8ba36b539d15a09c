"""Sections about height, velocity, position and heading from sensors."""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal, NamedTuple, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from isogal.scenario.section import Document, Finite, NonNegative, Positive, Section


def _in_order(times: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    for begin, end in times:
        if not 0.0 <= begin < end:
            raise ValueError(
                f"must be [[from, to], ...], s since the start with 0 <= from < to, not"
                f" [{begin:g}, {end:g}]"
            )
    return times


Times = Annotated[tuple[tuple[float, float], ...], AfterValidator(_in_order)]
"""From when to when, s since the start."""
AidName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]


class _Aid(Section):
    """A sensor beside the IMU; one of a list has a name."""

    stem: ClassVar[str]

    @property
    def prefix(self) -> str:
        """What the names of its states and random streams begin with."""
        name = getattr(self, "name", None)
        return self.stem if name is None else f"{self.stem}_{name}"


class Height(_Aid):
    """Where the navigator's height comes from, and what is known of its errors. All but white
    noise are errors that the filter carries as states and the matcher allows for."""

    stem: ClassVar[str] = "height"
    errors: ClassVar[tuple[str, ...]] = ("sigma", "bias", "scale", "weather_sigma")
    delay: ClassVar[float] = 0.0
    available: ClassVar[None] = None

    source: Literal["scenario", "barometer", "depth"] = "scenario"
    """scenario: route.height, exact; barometer or depth: a pressure sensor in air or in water"""
    interval: Positive = 1.0
    """s between its readings; a whole number of the navigator's steps"""
    sigma: Positive = 0.5
    """white noise of a reading, m"""
    bias: NonNegative = 5.0
    """1-sigma of a constant offset, m"""
    scale: NonNegative = Field(0.01, le=0.5)
    """1-sigma of the error of height differences, as a share of them"""
    weather_sigma: NonNegative = 5.0
    """1-sigma of what the weather, or the tide, adds, m"""
    weather_time: Positive = 7200.0
    """s, its correlation time"""
    reference_pressure: Positive = Field(101325.0, ge=1e4, le=2e5)
    """pressure at height 0, Pa"""
    water_density: Positive = Field(1025.0, ge=900.0, le=1200.0)
    """kg/m³; for source: depth"""

    @property
    def measured(self) -> bool:
        """Whether a sensor measures it."""
        return self.source != "scenario"

    def together(self, others: "Sequence[Height]") -> "Height":
        """Return one sensor in place of this and others: its errors are what weights by inverse
        variances leave of theirs, which are independent."""
        least = {
            name: _together([getattr(one, name) for one in (self, *others)])
            for name in self.errors
        }
        return self.model_copy(update=least)


def _together(sigmas: Sequence[float]) -> float:
    """Return the 1-sigma of the mean of independent errors, weighted by their variances."""
    return 1.0 / math.sqrt(sum(sigma**-2 for sigma in sigmas)) if all(sigmas) else 0.0


class HeightAid(Height):
    """One of the list `heights`: a sensor of the height beside that of the section `height`."""

    name: AidName
    """what it is called, barometer/NAME/data_raw"""
    source: Literal["scenario", "barometer", "depth"] = "barometer"
    """barometer or depth: a pressure sensor in air or in water"""
    truth: Document = Field(default_factory=dict)
    """its keys as they really are, where they differ; 3x = three times what is assumed"""


class _OfKind(_Aid):
    """A section whose errors are those of its kind where they are null."""

    kinds: ClassVar[Mapping[str, NamedTuple]]

    def resolved(self) -> Document:
        """See `Section`."""
        values = self.model_dump()
        kind = self.kinds.get(values["kind"])
        own = {} if kind is None else kind._asdict()
        return values | {key: own.get(key) for key in self.errors if values[key] is None}

    def number(self, key: str) -> float:
        """Return one of `errors`, that of the kind where it is null."""
        return float(self.resolved()[key] or 0.0)


class _Kind(NamedTuple):
    """What a velocity aid of one kind measures, and how well unless the scenario says it."""

    axes: tuple[int, ...]
    """Of the body (0 forward, 1 right, 2 down)."""
    sigma: float
    scale: float
    misalignment: float
    current_sigma: float


KINDS = {
    "dvl": _Kind((0, 1, 2), 0.02, 2e-3, 2e-3, 0.0),
    "odometer": _Kind((0, 1, 2), 0.05, 5e-3, 2e-3, 0.0),
    "wheels": _Kind((0, 1), 0.1, 1e-2, 2e-2, 0.0),
    "log": _Kind((0, 1), 0.05, 1e-2, 5e-3, 0.3),
    "airspeed": _Kind((0,), 0.5, 2e-2, 1e-2, 5.0),
}
"""Doppler log with bottom lock; wheel odometer, whose vehicle neither slips sideways nor leaves
the ground (Groves 2013, section 16.3); speed log in water; airspeed. The numbers are of the order
of such instruments' data sheets."""


class Velocity(_OfKind):
    """A sensor of the vehicle's velocity in body axes."""

    stem: ClassVar[str] = "velocity"
    errors: ClassVar[tuple[str, ...]] = ("sigma", "scale", "misalignment", "current_sigma")
    kinds: ClassVar[Mapping[str, NamedTuple]] = KINDS
    delay: ClassVar[float] = 0.0
    available: ClassVar[None] = None

    kind: Literal["none", "dvl", "odometer", "wheels", "log", "airspeed"] = "none"
    """which: dvl and odometer over ground (all axes), wheels over ground (forward; a vehicle on
    wheels does not go sideways), log through water (forward, right), airspeed (forward)"""
    interval: Positive = 1.0
    """s between its readings; a whole number of the navigator's steps"""
    sigma: Positive | None = None
    """white noise of a reading, m/s; null = of its kind"""
    scale: float | None = Field(None, ge=0.0, le=0.5)
    """1-sigma of its scale factor error; null = of its kind"""
    misalignment: float | None = Field(None, ge=0.0, le=0.2)
    """1-sigma of its mounting about right and down, rad; null = of its kind"""
    current_sigma: NonNegative | None = None
    """1-sigma of each component, north and east, of the water's current or the wind, m/s; null =
    of its kind"""
    current_time: Positive = 3600.0
    """s, its correlation time"""
    current_length: Positive = 20000.0
    """m along the track, its correlation length"""
    lever_arm: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    """of the sensor from the inertial ones: forward, right, down, m"""
    standstill_speed: NonNegative = 0.0
    """m/s below which a reading means that the vehicle stands still; 0 = never"""
    standstill_sigma: Positive = 0.01
    """1-sigma of the velocity of a vehicle that stands still, m/s"""
    standstill_rate: Positive | None = None
    """1-sigma of a sample of its gyroscopes then, by which their bias is told, rad/s; null = it is
    not"""

    @property
    def axes(self) -> tuple[int, ...]:
        """Measured axes of the body: 0 forward, 1 right, 2 down."""
        return () if self.kind == "none" else KINDS[self.kind].axes

    @property
    def medium(self) -> str:
        """What the names of the states begin with of what it moves through, which is the same for
        all sensors in one."""
        return "wind" if self.kind == "airspeed" else "current"


class VelocityAid(Velocity):
    """One of the list `velocities`: a sensor of the velocity beside that of the section
    `velocity`."""

    name: AidName
    """what it is called, velocity/NAME/data_raw"""
    truth: Document = Field(default_factory=dict)
    """its keys as they really are, where they differ; 3x = three times what is assumed"""


class Deception(Section):
    """What somebody makes a satellite receiver believe; the navigator is not told."""

    kind: Literal["none", "jump", "walk", "delay"] = "none"
    """jump: positions are off by size (m) at once; walk: they move away at rate (m/s), and
    velocities with them; delay: positions and velocities are those of size (s) before"""
    start: NonNegative = 0.0
    """s since the start, from when on"""
    end: Positive | None = None
    """s since the start, until when; null = to the end"""
    rate: NonNegative = 1.0
    """m/s; of a walk"""
    size: NonNegative = 100.0
    """m of a jump, s of a delay"""

    @model_validator(mode="after")
    def _check_times(self) -> "Deception":
        if self.end is not None and self.end <= self.start:
            raise ValueError(f"end ({self.end:g} s) must be after start ({self.start:g} s)")
        return self


class PositionAid(_Aid):
    """One of the aids of the list `positions`, which say where the vehicle is: acoustic or radar
    positions, a camera's, a person's. Errors as those of `Gnss`."""

    stem: ClassVar[str] = "position"
    errors: ClassVar[tuple[str, ...]] = ("sigma", "correlated_sigma")

    name: AidName | None = None
    """what it is called, position/NAME/fix; null = position/fix"""
    available: Times | None = None
    """when it measures, s since the start: [[from, to], ...]; null = always"""
    interval: Positive = 10.0
    """s between fixes; a whole number of the navigator's steps"""
    sigma: Positive = 10.0
    """white noise of a position's north and east, m"""
    correlated_sigma: NonNegative = 0.0
    """1-sigma of the slowly changing error of north and east, m"""
    correlation_time: Positive = 600.0
    """s, its correlation time"""
    lever_arm: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    """of what is measured from the inertial sensors: forward, right, down, m"""
    delay: NonNegative = 0.0
    """s by which a fix comes after its own time, which it is stamped with"""
    height: bool = False
    """whether it measures the height, too; used where the height is measured at all"""
    vertical: Positive = 1.0
    """errors of the height, as a multiple of those to the north or east"""
    truth: Document = Field(default_factory=dict)
    """its keys as they really are, where they differ; 3x = three times what is assumed"""

    @property
    def unequal(self) -> tuple[float, float, float]:
        """Errors to the north, east and down as multiples of those to the north."""
        return (1.0, 1.0, self.vertical)


class SatellitePosition(PositionAid):
    """The positions of a satellite receiver."""

    stem: ClassVar[str] = "gnss"


class _HeadingKind(NamedTuple):
    """How well a heading aid of one kind measures unless the scenario says it."""

    sigma: float
    bias: float
    correlated_sigma: float


HEADINGS = {
    "antennas": _HeadingKind(3e-3, 5e-3, 0.0),
    "compass": _HeadingKind(1e-2, 2e-2, 2e-2),
    "course": _HeadingKind(1e-2, 0.0, 5e-2),
}
"""Two antennas a metre or two apart; a magnetic compass, whose declination is that of the main
field and whose slow error is that of the declination and the deviation; course over ground, which
differs from the heading by the angle of crab. The numbers are of the order of data sheets."""


class HeadingAid(_OfKind):
    """One of the aids of the list `headings`, which say where the bow points."""

    stem: ClassVar[str] = "heading"
    errors: ClassVar[tuple[str, ...]] = ("sigma", "bias", "correlated_sigma")
    kinds: ClassVar[Mapping[str, NamedTuple]] = HEADINGS

    name: AidName | None = None
    """what it is called, heading/NAME/data_raw; null = heading/data_raw"""
    kind: Literal["antennas", "compass", "course"] = "antennas"
    """antennas: of a satellite receiver, from true north; compass: from magnetic north; course:
    over ground, used as heading"""
    available: Times | None = None
    """when it measures, s since the start: [[from, to], ...]; null = always"""
    interval: Positive = 1.0
    """s between readings; a whole number of the navigator's steps"""
    sigma: Positive | None = None
    """white noise, rad; null = of its kind"""
    bias: NonNegative | None = None
    """1-sigma of its mounting, a constant, rad; null = of its kind"""
    correlated_sigma: NonNegative | None = None
    """1-sigma of what changes slowly, rad: declination and deviation, crab; null = of its kind"""
    correlation_time: Positive = 600.0
    """s, its correlation time"""
    slowest: NonNegative = 1.0
    """m/s below which a course says nothing of the heading; for kind: course"""
    delay: NonNegative = 0.0
    """s by which a reading comes after its own time, which it is stamped with"""
    truth: Document = Field(default_factory=dict)
    """its keys as they really are, where they differ; 3x = three times what is assumed"""


class Gnss(Section):
    """A satellite receiver: position and velocity where there are satellites. Positions have white
    noise, and an error that changes slowly, which the filter carries as states; vertical errors
    are `VERTICAL` times as large."""

    errors: ClassVar[tuple[str, ...]] = ("position_sigma", "velocity_sigma", "correlated_sigma")

    available: Times | None = None
    """when there are satellites, s since the start: [[from, to], ...]; null = there is no receiver
    """
    interval: Positive = 1.0
    """s between fixes; a whole number of the navigator's steps"""
    position_sigma: Positive = 1.0
    """white noise of a position's north and east, m"""
    velocity_sigma: Positive | None = 0.03
    """white noise of a velocity's north and east, m/s; null = it gives no velocity"""
    correlated_sigma: NonNegative = 1.5
    """1-sigma of the slowly changing error of north and east, m"""
    correlation_time: Positive = 600.0
    """s, its correlation time"""
    lever_arm: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    """of the antenna from the inertial sensors: forward, right, down, m"""
    delay: NonNegative = 0.0
    """s by which a fix comes after its own time, which it is stamped with"""
    judged: bool = True
    """whether inertial data may show that satellites are wrong; false where they are too poor"""
    deception: Deception = Deception()

    @model_validator(mode="after")
    def _somebody_to_deceive(self) -> "Gnss":
        if self.deception.kind != "none" and self.available is None:
            raise ValueError(
                f"deception.kind ({self.deception.kind}): there is no receiver to deceive; give"
                " available, or deception.kind: none"
            )
        return self

    @property
    def used(self) -> bool:
        """Whether there is a receiver."""
        return self.available is not None

    @property
    def doubted(self) -> bool:
        """Whether there is a receiver that may be found to be wrong."""
        return self.used and self.judged

    @property
    def positions(self) -> PositionAid:
        """Its positions, as any other aid's; what they consist of has been checked."""
        return SatellitePosition.model_construct(
            available=self.available,
            interval=self.interval,
            sigma=self.position_sigma,
            correlated_sigma=self.correlated_sigma,
            correlation_time=self.correlation_time,
            lever_arm=self.lever_arm,
            delay=self.delay,
            height=True,
            vertical=VERTICAL,
        )


VERTICAL = 1.5
"""Vertical errors of satellite positions and velocities over those to the north or east (Groves
2013, section 9.4.3: VDOP over HDOP of an open sky)."""

AnyAid: TypeAlias = Height | Velocity | PositionAid | HeadingAid | Gnss
"""A sensor beside the IMU; `Gnss` is the velocity of satellites, whose positions are a
`PositionAid`."""
