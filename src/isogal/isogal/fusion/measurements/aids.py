"""Readings of a scenario's aids as measurements."""

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.fusion.measurements.ground_velocity import satellite_velocity
from isogal.fusion.measurements.heading import HeadingReading
from isogal.fusion.measurements.height import HeightReading
from isogal.fusion.measurements.model import LinearMeasurement
from isogal.fusion.measurements.position import position_fix
from isogal.fusion.measurements.velocity import VelocityReading
from isogal.scenario import AnyAid, Gnss, HeadingAid, Height, PositionAid, Settings, Velocity


def reading_of(
    aid: AnyAid,
    value: ArrayLike,
    settings: Settings,
    rate: Array,
    stated: ArrayLike | None = None,
) -> LinearMeasurement | None:
    """Return a reading of an aid as a measurement; None where it has no number.

    Parameters
    ----------
    aid : scenario.Height, Velocity, PositionAid, HeadingAid or Gnss
    value : float or (3,) array
        Height (m); velocity in body axes (m/s); latitude, longitude (rad) and height (m); heading
        (rad); velocity of satellites, NED (m/s). NaN = not measured.
    settings : Settings
        Whether the navigator's height is measured, and the epoch of a compass.
    rate : (3,) array
        What the gyroscopes read then, body axes, rad/s.
    stated : float or (3, 3) array, optional
        Variance or covariance as the reading states it; None, or zero of a height or a velocity =
        as the scenario has it.
    """
    read = np.asarray(value, dtype=float)
    covariance = None if stated is None else np.asarray(stated, dtype=float)
    if np.isnan(read).all():
        return None
    match aid:
        case Height():
            variance = 0.0 if covariance is None else float(covariance)
            return HeightReading(float(read), variance or aid.sigma**2, aid.prefix)
        case Velocity():
            return VelocityReading.of(aid, read, covariance, rate)
        case PositionAid():
            return position_fix(aid, read, settings.height.measured, covariance)
        case HeadingAid():
            epoch = settings.magnetometer.epoch
            whole = None if covariance is None else float(covariance)
            return HeadingReading.of(aid, float(read), epoch, whole)
        case Gnss():
            if aid.velocity_sigma is None:
                return None
            return satellite_velocity(aid, read, rate, covariance)
