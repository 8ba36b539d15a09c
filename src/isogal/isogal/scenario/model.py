"""The whole scenario, and its two halves: what is assumed, and what is true.

`Scenario` is what a file says. It is read at the edges: by commands, nodes, and what runs studies.
Filters, matchers and reductions take what it assumes (`Assumed`, which a scenario is), simulators
and the bound what is true (`Truth`, by `Scenario.true`), and whatever a section is enough for that
section. Assumed and true do not pass for each other; what both have alike, such as the route, is
`Settings`."""

import math
from collections.abc import Sequence
from typing import NoReturn, Self, TypeVar

from pydantic import Field, model_validator

from isogal import plugins
from isogal.scenario.aids import (
    AnyAid,
    Gnss,
    HeadingAid,
    Height,
    HeightAid,
    PositionAid,
    Velocity,
    VelocityAid,
)
from isogal.scenario.fields import OF_FIELDS, FieldName, intervals_of, read_entries, settings_of
from isogal.scenario.inertial import Imu
from isogal.scenario.instruments import (
    Altimeter,
    Gradiometer,
    Gravimeter,
    Magnetometer,
    Readings,
)
from isogal.scenario.map import Gravity, Map, MapError
from isogal.scenario.matcher import Matcher
from isogal.scenario.navigator import Fusion, Ins, Integrity
from isogal.scenario.section import Document, Section, validated
from isogal.scenario.truth import SECTIONS as TRUE_SECTIONS
from isogal.scenario.truth import check_names, true_section
from isogal.scenario.vehicle import InitialError, Route

FASTEST_STEPS = 10.0
"""Hz: up to this rate every IMU sample is a step of the navigator, unless it is told another."""
AID_LISTS = "heights", "velocities", "positions", "headings"
"""Keys of lists of aids, each of which has a name and a truth of its own."""
_OF_GRAVITY = ("gravity", "disturbance", "gradient")


def _whole(number: float) -> bool:
    return abs(number - round(number)) <= 1e-9 and round(number) >= 1


class Settings(Section):
    """The sections of a run, and what follows from them."""

    seed: int = Field(0, ge=0)
    """every random stream derives from it"""
    field: FieldName | None = Field(None, json_schema_extra={"plugins": plugins.FIELDS})
    """field that is measured and matched; null = gravimeter.quantity"""
    route: Route = Route()
    imu: Imu = Imu()
    ins: Ins = Ins()
    initial_error: InitialError = InitialError()
    gravimeter: Gravimeter = Gravimeter()
    magnetometer: Magnetometer = Magnetometer()
    altimeter: Altimeter = Altimeter()
    gradiometer: Gradiometer = Gradiometer()
    readings: Readings = Readings()
    height: Height = Height()
    velocity: Velocity = Velocity()
    heights: tuple[HeightAid, ...] | None = None
    """sensors of the height beside that of height: a list of entries with its keys, name and
    truth; null = none"""
    velocities: tuple[VelocityAid, ...] | None = None
    """sensors of the velocity beside that of velocity: a list of entries with its keys, name and
    truth; null = none"""
    gnss: Gnss = Gnss()
    positions: tuple[PositionAid, ...] | None = None
    """aids that say where the vehicle is: a list of entries with keys name, available, interval,
    sigma, correlated_sigma, correlation_time, lever_arm, delay, height, vertical, truth; null =
    none"""
    headings: tuple[HeadingAid, ...] | None = None
    """aids that say where the bow points: a list of entries with keys name, kind (antennas,
    compass, course), available, interval, sigma, bias, correlated_sigma, correlation_time,
    slowest, delay, truth; null = none"""
    map: Map = Map()
    map_error: MapError = MapError()
    gravity: Gravity = Gravity()
    matcher: Matcher = Field(default_factory=Matcher)
    fusion: Fusion = Fusion()
    integrity: Integrity = Integrity()
    fields: tuple[Document, ...] | None = None
    """several fields in one run: a list of entries with keys field, name, sigma, interval,
    gravimeter, map, map_error, matcher, truth, seed; null = field alone"""

    @model_validator(mode="after")
    def _whole_scans(self) -> Self:
        steps = self.gravimeter.interval * self.imu.rate
        if not _whole(steps):
            raise ValueError(
                f"gravimeter.interval ({self.gravimeter.interval} s) must be a whole number of IMU"
                f" samples (1/{self.imu.rate} s)"
            )
        rate, of_step = self.fusion.rate, self.samples_per_step
        if rate is not None and not (_whole(self.imu.rate / rate) and _whole(steps / of_step)):
            raise ValueError(
                f"fusion.rate ({rate:g} Hz): imu.rate ({self.imu.rate:g} Hz) must be a multiple of"
                f" it, and gravimeter.interval ({self.gravimeter.interval:g} s) a whole number of"
                " its steps"
            )
        return self

    @model_validator(mode="after")
    def _possible_together(self) -> Self:
        late = self.gravimeter.delay, self.gravimeter.filter_time, self.gravimeter.delay_sigma
        if self.field == "terrain" and self.altimeter.sounds and any(late):
            raise ValueError(
                "gravimeter.delay: an altimeter with several beams or a scale error cannot be"
                " late, nor have a filter"
            )
        of_potential = self.field == "gradient" and self.gradiometer.of_one_potential
        if self.map_error.tails is not None and of_potential:
            raise ValueError(
                "map_error.tails: errors of one potential (gradiometer.map_errors) are Gaussian"
            )
        return self

    @model_validator(mode="after")
    def _readings_of_a_track(self) -> Self:
        if not self.readings.recorded:
            return self
        if self.route.track is None:
            raise ValueError("readings.source: recorded readings need the track: give route.track")
        if self.fields is None and self.measured_field == "gradient":
            raise ValueError("readings.source: must be of one number, field gradient has several")
        if self.fields is None and self.measured_field == "terrain" and self.altimeter.sounds:
            raise ValueError("readings.source: must be of one beam; altimeter has several")
        return self

    @model_validator(mode="after")
    def _whole_aids(self) -> Self:
        used = {
            "height": self.height.measured,
            "velocity": self.velocity.kind != "none",
            "gnss": self.gnss.used,
        }
        intervals = {name: getattr(self, name).interval for name in used if used[name]}
        for n, one in enumerate(self.heights or ()):
            if not (one.measured and self.height.measured):
                raise ValueError(f"heights.{n}: it and height must have a sensor as source")
        for n, aid in enumerate(self.velocities or ()):
            if aid.kind == "none":
                raise ValueError(f"velocities.{n}.kind: must be a sensor, not none")
        for key in AID_LISTS:
            entries = getattr(self, key)
            names = [one.name for one in entries or ()]
            if len({*names}) < len(names):
                raise ValueError(f"{key}: of two entries of one name, or without one: {names}")
            intervals |= {f"{key}.{n}": one.interval for n, one in enumerate(entries or ())}
        for name, interval in intervals.items():
            if not _whole(interval * self.navigation_rate):
                raise ValueError(
                    f"{name}.interval ({interval} s) must be a whole number of steps of the"
                    f" navigator (1/{self.navigation_rate:g} s)"
                )
        return self

    @property
    def velocity_aids(self) -> tuple[Velocity, ...]:
        """All sensors of the velocity."""
        own = (self.velocity,) if self.velocity.kind != "none" else ()
        return (*own, *(self.velocities or ()))

    @property
    def aids(self) -> tuple[AnyAid, ...]:
        """All sensors beside the IMU but that of the section `height`, which is a part of the
        inertial data."""
        satellites = (self.gnss.positions, self.gnss) if self.gnss.used else ()
        places = *satellites, *(self.positions or ())
        return (*(self.heights or ()), *self.velocity_aids, *places, *(self.headings or ()))

    def never_available(self, end: float) -> list[str]:
        """Return a line for each of the times in which an aid is available that is not before the
        end of a run, s, and one where the run is too short for a fix: a study may cut the run
        short, so they are no error."""
        sections = {"gnss": self.gnss} | {
            f"{key}.{n}": one
            for key in ("positions", "headings")
            for n, one in enumerate(getattr(self, key) or ())
        }
        lines = [
            f"{name}.available: [{since:g}, {until:g}] is after the end of the run, {end:g} s"
            for name, section in sections.items()
            for since, until in section.available or ()
            if since >= end
        ]
        length, interval = self.matcher.batch_length, self.gravimeter.interval
        if self.fields is None and not self.readings.recorded and length * interval > end:
            lines.append(
                f"matcher.batch_length: {length} readings, one each {interval:g} s, take longer"
                f" than the run, {end:g} s: it has no fix"
            )
        return lines

    @property
    def field_names(self) -> tuple[str, ...]:
        """What each field is called."""
        if self.fields is None:
            return (self.measured_field,)
        return tuple(entry.called for entry in read_entries(self.fields))

    @property
    def measured_field(self) -> str:
        """Name of the field that is measured and matched, one of
        `isogal.fields.measured.fields`; of several the first."""
        if self.fields is not None:
            return str(self.fields[0]["field"])
        return self.field or self.gravimeter.quantity

    @property
    def samples_per_step(self) -> int:
        """IMU samples in a step of the navigator."""
        if self.fusion.rate is not None:
            return max(1, round(self.imu.rate / self.fusion.rate))
        if self.imu.rate <= FASTEST_STEPS:
            return 1
        of_scan = self._samples_per_scan
        return max(n for n in range(1, math.floor(self.imu.rate) + 1) if of_scan % n == 0)

    @property
    def navigation_rate(self) -> float:
        """Steps of the navigator per second, Hz."""
        return self.imu.rate / self.samples_per_step

    @property
    def steps_per_scan(self) -> int:
        """Steps of the navigator from one gravimeter reading to the next; of several fields the
        largest number that all of their intervals are multiples of."""
        return self._samples_per_scan // self.samples_per_step

    @property
    def scan_interval(self) -> float:
        """Time of these steps, s."""
        return self.steps_per_scan / self.navigation_rate

    @property
    def _samples_per_scan(self) -> int:
        if self.fields is None:
            return round(self.gravimeter.interval * self.imu.rate)
        return math.gcd(*(round(x * self.imu.rate) for x in intervals_of(self.fields)))


_Settings = TypeVar("_Settings", bound=Settings)


def _of_gravity(each: Sequence[_Settings]) -> _Settings:
    return next((one for one in each if one.measured_field in _OF_GRAVITY), each[0])


class Assumed(Settings):
    """What filter, matcher and reductions assume."""

    @property
    def each_field(self) -> tuple[Self, ...]:
        """What is assumed of each field by itself; of one field this."""
        return (self,) if self.fields is None else settings_of(self)

    @property
    def informed(self) -> NoReturn:
        """Raises TypeError: nobody who only assumes is informed (`Truth.informed`)."""
        raise TypeError("needs what really is: give `scenario.true`, not the scenario")

    @property
    def gravity_field(self) -> Self:
        """What is assumed of the field whose map is one of gravity, which the inertial sensors
        feel; of the first where there is none."""
        return _of_gravity(self.each_field)


class Truth(Settings):
    """What really is: what simulators draw from."""

    truth: Document = Field(default_factory=dict)
    """of several fields what is true of all their readings and maps: keys of the entries' truth"""

    @property
    def each_field(self) -> "tuple[Truth, ...]":
        """What is true of each field by itself; of one field this."""
        if self.fields is None:
            return (self,)
        return tuple(one.true for one in self.informed.each_field)

    @property
    def gravity_field(self) -> "Truth":
        """What is true of the field of `Assumed.gravity_field`."""
        return _of_gravity(self.each_field)

    @property
    def informed(self) -> "Scenario":
        """The scenario of a navigator that knows the truth, as the bound's does."""
        return Scenario.model_construct(**dict(self))


class Scenario(Assumed):
    """A whole run, as a file says it."""

    truth: Document = Field(
        default_factory=dict,
        description=(
            "what really is, where it differs from what is assumed: keys of"
            f" {', '.join(TRUE_SECTIONS)}; 3x = three times what is assumed"
        ),
    )

    @model_validator(mode="after")
    def _possible_fields(self) -> Self:
        if self.fields is not None and any(
            one.matcher.mode == "retrodiction" for one in self.each_field
        ):
            raise ValueError("matcher.mode: retrodiction takes one field, not a list of fields")
        return self

    @model_validator(mode="after")
    def _possible_truth(self) -> Self:
        self.true  # noqa: B018 - raises where the truth is impossible
        return self

    @property
    def true(self) -> Truth:
        """What really is: the section `truth` merged into the others."""
        own = self._of_truth
        if not self.truth:
            return Truth.model_construct(**self._settings | own)
        check_names(self.truth)
        # of several fields, what is true of readings and maps is so of the entries
        of_entries = OF_FIELDS if self.fields is not None else ()
        rest = {name: changes for name, changes in self.truth.items() if name in of_entries}
        changed = {
            name: true_section(name, getattr(self, name), changes)
            for name, changes in self.truth.items()
            if name not in of_entries
        }
        return validated(Truth, self._settings | changed | own | {"truth": rest}, where="truth: ")

    @property
    def _of_truth(self) -> Document:
        """What is another in truth without its section: the lists of aids, each of whose entries
        has a truth of its own, and the error of a map that is none of a simulation."""
        real = {"map_error": MapError()} if self.readings.recorded else {}
        return real | {
            key: tuple(
                true_section(key, one, one.truth).model_copy(update={"truth": {}})
                for one in entries
            )
            for key in AID_LISTS
            if (entries := getattr(self, key))
        }

    @property
    def _settings(self) -> Document:
        return {name: getattr(self, name) for name in Settings.model_fields}
