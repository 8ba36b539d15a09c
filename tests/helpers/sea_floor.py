"""A rough sea floor and a vehicle over it, with several beams."""

import numpy as np

from helpers.batches import ORIGIN, field_map_of
from isogal.maps.field_map import FieldMap


def sea_floor(half: float = 4e3, step: float = 50.0) -> FieldMap:
    """A floor 300 m below zero, 10 m RMS over 500 m to 3 km."""

    def height(north, east):
        waves, total = np.random.default_rng(2), -300.0 + 0.0 * (north + east)
        for length in np.geomspace(500.0, 3000.0, 12):
            direction, phase = waves.uniform(0.0, 2.0 * np.pi, 2)
            along = north * np.cos(direction) + east * np.sin(direction)
            total = total + 4e-3 * length**0.9 * np.sin(2.0 * np.pi * along / length + phase)
        return total

    made = field_map_of(height, half=half, step=step)
    return FieldMap(made.latitude, made.longitude, made.values, "m", "height")


LATITUDE, LONGITUDE = (float(x) for x in np.degrees(ORIGIN))
SOUNDING = (
    "field=terrain", "gravity.field=normal", "route.height=-200", "route.duration=400",
    f"route.start=[{LATITUDE - 0.01}, {LONGITUDE - 0.01}]",
    f"route.end=[{LATITUDE + 0.02}, {LONGITUDE + 0.02}]", "route.speed=3",
    "initial_error.position=100", "gravimeter.sigma=0.5", "gravimeter.interval=20",
    "matcher.batch_length=8", "matcher.map_sigma=0", "matcher.name=pmht",
)  # fmt: skip
"""Overrides of a scenario over it; its map is to be given."""
DVL = "altimeter.directions=[[45, 30], [135, 30], [225, 30], [315, 30]]"
FAN = ("altimeter.beams=5", "altimeter.opening=100")
