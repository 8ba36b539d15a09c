"""Sections about the vehicle: its route, and the navigator's initial errors."""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from pydantic import Field, model_validator

from isogal.scenario.section import LatitudeDeg, LongitudeDeg, NonNegative, Positive, Section

_OF_POINTS = (
    "start", "end", "speed", "line", "waypoints", "turn_rate", "acceleration", "at_rest"
)  # fmt: skip


class Route(Section):
    """Where the vehicle goes, how fast, how high and for how long."""

    start: tuple[LatitudeDeg, LongitudeDeg] | None = (-38.0, 144.5)
    """first point: latitude, longitude in deg"""
    end: tuple[LatitudeDeg, LongitudeDeg] | None = (-35.0, 150.0)
    """last point: latitude, longitude in deg"""
    speed: Positive = Field(22.0, le=1000.0)
    """ground speed at the vehicle's height, m/s"""
    height: float = Field(100.0, ge=-12000.0, le=50000.0)
    """height above the map's surface, m"""
    duration: Positive | None = 12960.0
    """simulated time, s; null = until the last point"""
    line: Literal["rhumb", "geodesic"] = "rhumb"
    """how start and end are joined"""
    waypoints: tuple[tuple[LatitudeDeg, LongitudeDeg, Positive], ...] | None = None
    """latitude deg, longitude deg, speed m/s of each point, instead of start/end/speed"""
    turn_rate: Positive = Field(0.02, le=0.5)
    """heading rate in turns between waypoints, rad/s"""
    acceleration: Positive = Field(0.1, le=10.0)
    """speed change between waypoints, m/s²"""
    at_rest: NonNegative = 0.0
    """time that the vehicle is at rest at the first point before it moves off, s"""
    track: str | None = None
    """file of a recorded track (columns time, latitude, longitude and perhaps height) that is
    followed instead: it says where, when and how fast; duration may cut it, and height holds where
    the file has none"""
    track_line: str | None = None
    """which survey line of that file, where it has several"""

    @model_validator(mode="before")
    @classmethod
    def _whole_track(cls, given: Any) -> Any:
        """A track is followed to its end, unless a duration is given."""
        if isinstance(given, Mapping) and given.get("track") is not None:
            return {"duration": None, **given}
        return given

    @model_validator(mode="after")
    def _nothing_beside_a_track(self) -> "Route":
        for name in _OF_POINTS if self.track is not None else ():
            value = getattr(self, name)
            if value is not None and value != type(self).model_fields[name].default:
                raise ValueError(f"{name}: says nothing beside track, by which the vehicle goes")
        if self.track is None and self.track_line is not None:
            raise ValueError("track_line: is of a track; give the file of it")
        return self

    @model_validator(mode="after")
    def _enough_points(self) -> "Route":
        if self.track is not None:
            return self
        if self.waypoints is not None and len(self.waypoints) < 2:
            raise ValueError("waypoints needs at least two points")
        if self.waypoints is None and (self.start is None or self.end is None):
            raise ValueError("give start and end, or waypoints")
        if self.waypoints is None and self.start == self.end:
            raise ValueError("start and end must differ")
        return self


class InitialError(Section):
    """1-sigma per axis of the navigator's initial errors, which the paper does not state
    (docs/mathematics.md, section 3.8)."""

    errors: ClassVar[tuple[str, ...]] = ("position", "velocity", "tilt", "heading")

    position: NonNegative = Field(50.0, le=1.0e6)
    """m, north and east"""
    velocity: NonNegative = 0.05
    """m/s, north and east"""
    tilt: NonNegative = Field(2.5e-5, le=0.1)
    """rad, about north and east"""
    heading: NonNegative = Field(3.0e-4, le=0.5)
    """rad, about down"""
    hidden_position: NonNegative = 0.0
    """m, size of a further position error, in a random direction, that the navigator is not told
    of"""
