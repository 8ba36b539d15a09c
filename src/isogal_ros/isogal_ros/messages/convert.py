"""Messages to arrays and back: the only place that knows both conventions.

The library has body axes forward-right-down (FRD), north-east-down and radians; messages have
forward-left-up (FLU), east-north-up and degrees (REP-103). The frame ``map`` is ENU at the first
route point, exact through ECEF (`isogal.earth.frames.LocalFrame`). Readers raise `BadMessageError`
for what cannot be used."""

import math
from typing import Any

import numpy as np
from sensor_msgs.msg import NavSatFix, NavSatStatus, PointCloud2, PointField

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal.inertial.rotations import matrix
from isogal.matching.interfaces import Candidates, Information
from isogal.scenario import Scenario
from isogal_ros.messages.odometry import odometry
from isogal_ros.messages.stamps import set_stamp
from isogal_ros.nodes.health import BadMessageError

MAP, BASE, PLATFORM, GEODETIC = "map", "base_link", "gravimeter_link", "wgs84"
"""Frame names. The gravimeter's platform is level with z up; candidates are geodetic."""

NOT_MEASURED = 1e6
"""Variance that stands for a direction that a sensor does not measure."""

LARGEST_FORCE, LARGEST_RATE = 1000.0, 100.0
"""m/s² and rad/s: no vehicle of this kind gets there, a broken sensor does."""

_FLIP = np.array([1.0, -1.0, -1.0])  # FRD <-> FLU
_SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # NED <-> ENU


def map_frame(scenario: Scenario) -> LocalFrame:
    """Return the frame ``map`` of a scenario: ENU at the first route point, at the vehicle's
    height."""
    route = scenario.route
    first = route.waypoints[0][:2] if route.waypoints is not None else route.start
    assert first is not None  # the scenario model has checked
    return LocalFrame(math.radians(first[0]), math.radians(first[1]), route.height)


def require_frame(message: Any, frame: str) -> None:
    """Raise BadMessageError unless the message is in the frame; an empty frame takes any."""
    if frame and message.header.frame_id != frame:
        raise BadMessageError(f"frame_id must be '{frame}', is '{message.header.frame_id}'")


def fill_imu(message: Any, ns: int, specific_force: Array, angular_rate: Array) -> None:
    """Write the means over an interval that ends at the stamp (FRD) into an Imu message, which has
    no orientation (REP-145)."""
    set_stamp(message.header.stamp, ns)
    force, rate = message.linear_acceleration, message.angular_velocity
    force.x, force.y, force.z = (specific_force * _FLIP).tolist()
    rate.x, rate.y, rate.z = (angular_rate * _FLIP).tolist()


def read_imu(message: Any, frame: str = BASE) -> tuple[Array, Array]:
    """Return (specific force m/s², angular rate rad/s), each (3,) FRD."""
    require_frame(message, frame)
    force, rate = message.linear_acceleration, message.angular_velocity
    values = np.array([[force.x, -force.y, -force.z], [rate.x, -rate.y, -rate.z]])
    if not np.isfinite(values).all():
        raise BadMessageError("specific force or angular rate is not finite")
    if np.abs(values[0]).max() > LARGEST_FORCE or np.abs(values[1]).max() > LARGEST_RATE:
        raise BadMessageError(
            f"specific force above {LARGEST_FORCE:g} m/s² or angular rate above {LARGEST_RATE:g}"
            " rad/s"
        )
    if (
        message.linear_acceleration_covariance[0] == -1.0
        or message.angular_velocity_covariance[0] == -1.0
    ):
        raise BadMessageError("marked as without specific force or angular rate (covariance -1)")
    if (
        min(message.linear_acceleration_covariance[::4]) < 0.0
        or min(message.angular_velocity_covariance[::4]) < 0.0
    ):
        raise BadMessageError("negative variance")
    return values[0], values[1]


def fill_fix(
    message: NavSatFix,
    ns: int,
    latitude: float,
    longitude: float,
    height: float,
    covariance: Array | None = None,
    status: int = NavSatStatus.STATUS_FIX,
) -> None:
    """Write a position (rad, m) and its (3, 3) covariance (NED, m²; None = not known) into a
    NavSatFix."""
    set_stamp(message.header.stamp, ns)
    message.latitude, message.longitude = (
        math.degrees(latitude),
        math.degrees(math.remainder(longitude, 2.0 * math.pi)),
    )
    message.altitude = float(height)
    message.status.status = status
    if covariance is None:
        message.position_covariance = np.zeros(9)
        message.position_covariance_type = NavSatFix.COVARIANCE_TYPE_UNKNOWN
    else:
        message.position_covariance = (_SWAP @ covariance @ _SWAP).ravel()
        message.position_covariance_type = NavSatFix.COVARIANCE_TYPE_KNOWN


def read_position(message: NavSatFix, frame: str = BASE) -> tuple[float, float, float]:
    """Return (latitude rad, longitude rad, height m)."""
    require_frame(message, frame)
    if not (
        math.isfinite(message.latitude)
        and math.isfinite(message.longitude)
        and math.isfinite(message.altitude)
    ):
        raise BadMessageError("position is not finite")
    if abs(message.latitude) > 90.0 or abs(message.longitude) > 360.0:
        raise BadMessageError(
            f"no such place: latitude {message.latitude:.4f}, longitude"
            f" {message.longitude:.4f} deg"
        )
    return math.radians(message.latitude), math.radians(message.longitude), message.altitude


def read_covariance(message: NavSatFix) -> Array:
    """Return the (3, 3) covariance of a NavSatFix, NED, m²."""
    if message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN:
        raise BadMessageError("covariance is not known")
    covariance = np.asarray(message.position_covariance).reshape(3, 3)
    _require_variances(covariance)
    return _SWAP @ covariance @ _SWAP


def _require_variances(covariance: Array) -> None:
    if not np.isfinite(covariance).all():
        raise BadMessageError("covariance is not finite")
    if (np.diag(covariance) < 0.0).any():
        raise BadMessageError("negative variance")


_NO_COVARIANCE = np.zeros((0, 0))


def fill_odom(
    message: Any,
    ns: int,
    frame: LocalFrame,
    state: Array,
    angular_rate: Array,
    covariance: Array = _NO_COVARIANCE,
) -> None:
    """Write a navigation state into an Odometry of frame ``map`` and child ``base_link``.

    Parameters
    ----------
    state : (10,) array
        Latitude rad, longitude rad, height m; velocity NED, m/s; quaternion FRD to NED.
    angular_rate : (3,) array
        FRD, rad/s, relative to the Earth.
    covariance : (9+, 9+) array
        Position, velocity, attitude errors, NED; (0, 0) = the message's stays as it is. The
        twist's covariance is that of the NED velocity turned into body axes, so that turning it
        back with the message's orientation gives it unchanged.
    """
    set_stamp(message.header.stamp, ns)
    pose, twist = np.empty((6, 6)), np.zeros((6, 6))
    values = odometry(state, covariance, frame.axes, frame.origin, pose, twist).tolist()
    point, orientation = message.pose.pose.position, message.pose.pose.orientation
    point.x, point.y, point.z = values[:3]
    orientation.w, orientation.x, orientation.y, orientation.z = values[3:7]
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    linear.x, linear.y, linear.z = values[7:]
    angular.x, angular.y, angular.z = (angular_rate * _FLIP).tolist()
    if covariance.shape[0]:
        message.pose.covariance, message.twist.covariance = pose.ravel(), twist.ravel()


def read_velocity(
    message: Any, frame: LocalFrame, latitude: float, longitude: float
) -> tuple[Array, Array, Array]:
    """Return (velocity (3,), its covariance (3, 3), attitude (3, 3) FRD to NED) of an Odometry,
    NED at a point (rad)."""
    require_frame(message, MAP)
    if message.child_frame_id != BASE:
        raise BadMessageError(f"child_frame_id must be '{BASE}', is '{message.child_frame_id}'")
    q, linear = message.pose.pose.orientation, message.twist.twist.linear
    values = np.array([q.w, q.x, q.y, q.z, linear.x, linear.y, linear.z])
    covariance = np.asarray(message.twist.covariance).reshape(6, 6)[:3, :3]
    if not np.isfinite(values).all():
        raise BadMessageError("orientation or velocity is not finite")
    if abs(values[:4] @ values[:4] - 1.0) > 1e-3:
        raise BadMessageError("orientation is not a unit quaternion")
    _require_variances(covariance)
    to_ned = (frame.rotation_from(latitude, longitude) @ _SWAP).T @ matrix(values[:4])
    return to_ned @ values[4:], to_ned @ covariance @ to_ned.T, to_ned * _FLIP


def fill_accel(message: Any, ns: int, value: float, variance: float) -> None:
    """Write a gravimeter's value (m/s², z up) and variance into an AccelWithCovarianceStamped; x
    and y are not measured."""
    set_stamp(message.header.stamp, ns)
    message.accel.accel.linear.z = float(value)
    covariance = np.diag([NOT_MEASURED] * 6)
    covariance[2, 2] = variance
    message.accel.covariance = covariance.ravel()


def read_accel(message: Any, frame: str = PLATFORM) -> tuple[float, float]:
    """Return (value m/s², variance m²/s⁴) of a gravimeter's message."""
    require_frame(message, frame)
    value, variance = message.accel.accel.linear.z, float(message.accel.covariance[14])
    if not math.isfinite(value) or not math.isfinite(variance):
        raise BadMessageError("reading is not finite")
    if variance < 0.0:
        raise BadMessageError("negative variance")
    return value, variance


def fill_numbers(message: Any, ns: int, *arrays: Array) -> None:
    """Write a stamp (s, then ns) and the numbers of arrays, row by row, into a Float64MultiArray,
    which has no header."""
    seconds, rest = divmod(ns, 1_000_000_000)
    data = [float(seconds), float(rest)]
    for array in arrays:
        data += array.ravel().tolist()
    message.data = data


def read_nav_covariance(message: Any) -> Array:
    """Return the covariance of `isogal.matching.batching`'s error states: (7, 7), or (4, 4)
    without the attitude."""
    values = np.array(message.data)
    size = math.isqrt(max(len(values) - 2, 0))
    if size not in (4, 7) or len(values) != size * size + 2:
        raise BadMessageError(
            f"must hold a stamp and a 7 x 7 or 4 x 4 covariance, holds {len(values)} numbers"
        )
    covariance = values[2:].reshape(size, size)
    _require_variances(covariance)
    return covariance


def fill_information(message: Any, ns: int, reset: bool, information: Information | None) -> None:
    """Write what belongs to a fix into ``pmht_mm/information``: stamp, whether the navigator is
    lost, then vector and matrix if any."""
    parts = () if information is None else (information.vector, information.matrix)
    fill_numbers(message, ns, np.array([float(reset)]), *parts)


def read_information(message: Any) -> tuple[bool, Information | None]:
    """Return (whether the navigator is lost, information); None where the fix itself says all
    there is."""
    values = np.array(message.data)
    size = {3: 0, 23: 4, 59: 7}.get(len(values))
    if size is None:
        raise BadMessageError(
            "must hold a stamp, a flag, and if any a vector of 4 or 7 and a matrix of 4 x 4 or 7"
            f" x 7, holds {len(values)} numbers"
        )
    if not np.isfinite(values).all():
        raise BadMessageError("information is not finite")
    information = (
        Information(values[3 : 3 + size], values[3 + size :].reshape(size, size)) if size else None
    )
    return bool(values[2]), information


_CANDIDATE = np.dtype(
    [("latitude", "<f8"), ("longitude", "<f8"), ("weight", "<f8"), ("scan", "<u4")]
)


def candidates_cloud(ns: int, candidates: Candidates | None) -> PointCloud2:
    """Return candidates as points with the fields latitude, longitude (deg), weight and scan."""
    kinds = {"<f8": PointField.FLOAT64, "<u4": PointField.UINT32}
    count = 0 if candidates is None else len(candidates.latitude)
    points = np.zeros(count, dtype=_CANDIDATE)
    if candidates is not None:
        points["latitude"], points["longitude"] = (
            np.degrees(candidates.latitude),
            np.degrees(candidates.longitude),
        )
        points["weight"], points["scan"] = candidates.weight, candidates.scan
    cloud = PointCloud2(
        height=1,
        width=count,
        is_bigendian=False,
        point_step=_CANDIDATE.itemsize,
        row_step=count * _CANDIDATE.itemsize,
        is_dense=True,
    )
    set_stamp(cloud.header.stamp, ns)
    cloud.header.frame_id = GEODETIC
    cloud.fields = [
        PointField(name=name, offset=offset, datatype=kinds[kind.str], count=1)
        for name, (kind, offset, *_) in (_CANDIDATE.fields or {}).items()
    ]
    cloud.data = points.tobytes()
    return cloud


def read_candidates(cloud: PointCloud2) -> Candidates:
    """Return the candidates of a cloud that `candidates_cloud` made."""
    if cloud.point_step != _CANDIDATE.itemsize or [field.name for field in cloud.fields] != list(
        _CANDIDATE.names or ()
    ):
        raise BadMessageError("fields must be latitude, longitude, weight, scan")
    points = np.frombuffer(bytes(cloud.data), dtype=_CANDIDATE)
    return Candidates(
        np.radians(points["latitude"]),
        np.radians(points["longitude"]),
        points["weight"].copy(),
        points["scan"].astype(np.int64),
    )
