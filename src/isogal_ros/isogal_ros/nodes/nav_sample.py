"""The navigator's state of one stamp, from its messages."""

from dataclasses import dataclass, replace

import numpy as np
from nav_msgs.msg import Odometry
from sensor_msgs.msg import NavSatFix, NavSatStatus

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal.inertial.dead_reckoning import dead_reckoned
from isogal.inertial.error_state import Estimate, batch_difference
from isogal.inertial.rotations import from_matrix
from isogal.passage import Since
from isogal.sensors.reduction import Reduction, State, reduction_variance
from isogal_ros.messages.frames import FRD_FLU
from isogal_ros.messages.odometry import read_velocity
from isogal_ros.messages.position import read_covariance, read_position
from isogal_ros.messages.stamps import to_ns, to_seconds

_NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True, eq=False)
class NavSample:
    """What the navigator said at one stamp."""

    ns: int
    position: Array
    """(3,) latitude rad, longitude rad, height m."""
    velocity: Array
    """(3,) NED, m/s."""
    attitude: Array
    """(3, 3) FRD to NED."""
    covariance: Array
    """(7, 7) of a batch's states (`isogal.inertial.error_state`); (4, 4) where the attitude's is
    not known."""
    height_variance: float
    """m²."""
    since: Since | None = None
    """What satellites have told the navigator since a fix, or what has become of its error; None =
    nothing is said."""
    turn: Array | None = None
    """(3,) angular rate relative to the Earth, FRD, rad/s; None = not known."""
    aligned: bool = True
    """Whether the navigator is aligned: one that is not says where it may be, and promises
    nothing."""

    @property
    def sensor(self) -> State:
        """Where a sensor is, and how it moves."""
        latitude, longitude, height = self.position
        north, east, _ = self.velocity
        return State(latitude, longitude, height, north, east, self.attitude, self.turn)

    def variance_by(self, reduction: Reduction) -> float:
        """Return the variance that the navigator's uncertainty puts into a reading by its
        reduction, in the unit of the map squared."""
        covariance = self.covariance[:4, :4]
        return float(reduction_variance(reduction, self.sensor, covariance, self.height_variance))


def read_nav(fix: NavSatFix, odom: Odometry, frame: LocalFrame) -> NavSample:
    """Return the state that messages on nav/fix and nav/odom say, in the frame ``map``; raises
    BadMessageError where one cannot be used."""
    position = read_position(fix)
    velocity, of_velocity, attitude = read_velocity(odom, frame, *position[:2])
    of_position, angular = read_covariance(fix), odom.twist.twist.angular
    covariance = np.zeros((4, 4))
    covariance[:2, :2], covariance[2:, 2:] = of_position[:2, :2], of_velocity[:2, :2]
    return NavSample(
        to_ns(fix.header.stamp),
        np.array(position),
        velocity,
        attitude,
        covariance,
        float(of_position[2, 2]),
        turn=FRD_FLU * np.array([angular.x, angular.y, angular.z]),
        aligned=fix.status.status != NavSatStatus.STATUS_NO_FIX,
    )


def moved(sample: NavSample, ns: int) -> NavSample:
    """Return the state a moment later or earlier, at another stamp."""
    seconds = to_seconds(ns - sample.ns)
    position = dead_reckoned(sample.position, sample.velocity, seconds)
    return replace(sample, ns=ns, position=position)


def difference(after: NavSample, before: NavSample) -> Array:
    """Return (7,) the difference of two states in a batch's states."""
    # only the rotation between the two attitudes counts
    turn = from_matrix(after.attitude @ before.attitude.T)
    return batch_difference(
        Estimate(after.position, after.velocity, turn),
        Estimate(before.position, before.velocity, _NO_TURN),
    )
