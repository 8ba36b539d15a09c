"""Messages of the barometer of a vehicle on the ground: a FluidPressure, and the terrain's height
as of an altimeter, a NavSatFix."""

import math
from functools import partial

from sensor_msgs.msg import FluidPressure

from isogal.scenario import Assumed, Height
from isogal.sensors.barometer import height_slope
from isogal_ros import topics
from isogal_ros.messages.adapter import Adapter, Place, Reading
from isogal_ros.messages.aids import fill_pressure, read_pressure
from isogal_ros.messages.altimeter import read_terrain, terrain_message
from isogal_ros.messages.frames import framed

BAROMETER = "barometer_link"
"""Frame name."""


def ground(assumed: Assumed) -> Adapter:
    """Return the adapter of the field ground; the section `height` says which pressure is that of
    height 0."""
    settings = assumed.height
    raw = topics.GROUND_PRESSURE, partial(_write, settings), partial(_read, settings)
    reduced = topics.GROUND_HEIGHT
    return Adapter(*raw, reduced, partial(terrain_message, reduced), read_terrain)


def _write(
    settings: Height, ns: int, value: Reading, variance: Reading, place: Place
) -> FluidPressure:
    """Return the message of a height, m; of none (NaN) a pressure that is none."""
    message = framed(topics.GROUND_PRESSURE, BAROMETER)
    height = float(value)
    fill_pressure(message, ns, 0.0 if math.isnan(height) else height, settings)
    if math.isnan(height):
        message.fluid_pressure = math.nan
    else:
        message.variance = float(variance) / height_slope(message.fluid_pressure, settings) ** 2
    return message


def _read(settings: Height, message: FluidPressure) -> tuple[float, float | None]:
    """Return the height (m), NaN of a pressure that is none, and its variance; None = unknown
    (zero)."""
    if math.isnan(message.fluid_pressure):
        return math.nan, None
    height, variance = read_pressure(message, settings)
    return height, variance or None
