"""The section about recorded readings, which take the place of simulated ones."""

from typing import Literal

from isogal.scenario.section import Section

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
