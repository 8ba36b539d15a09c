"""The navigator: an unscented filter over the IMU, corrected by map matching fixes of any age."""

import math
import sys
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import NavSatStatus

from isogal.earth.ellipsoid import EARTH_RATE
from isogal.fusion.buffered import BufferedNavigator
from isogal.fusion.navigator import FilterDivergenceError, FilterModel, FilterState
from isogal.inertial.rotations import rotate
from isogal.matching.interfaces import LOST_SIGMA
from isogal_ros import topics
from isogal_ros.convert import (
    BASE,
    MAP,
    fill_fix,
    fill_numbers,
    fill_odom,
    map_frame,
    read_covariance,
    read_imu,
    read_information,
    read_position,
)
from isogal_ros.health import ERROR, OK, WARN, BadMessageError
from isogal_ros.node import GraphNode, NodeSettings
from isogal_ros.spin import run_node
from isogal_ros.stamps import from_ns, from_seconds, peek_numbers_ns, to_ns, to_seconds
from ukf_fusion_node.start import initial_state

Array = NDArray[np.float64]
KEPT = 4096
"""Pieces of information kept for fixes that are still to come."""
PATIENCE_NS = 30_000_000_000
"""How long a fix waits for the information that belongs to it, in the navigator's time."""


class UkfFusionSettings(NodeSettings):
    """Own parameters of ukf_fusion_node."""

    imu_frame: str = Field(BASE, description="frame of imu/data_raw, axes forward, left, up; empty = take any")
    horizon: float = Field(1200.0, ge=0.0, le=86400.0, description="how old a fix may be, s")
    max_gap: float = Field(
        10.0, gt=0.0, description="longest gap between IMU samples that is bridged without an error, s"
    )
    path_interval: float = Field(60.0, gt=0.0, description="time between the poses of nav/path, s")
    start_position: tuple[float, float, float] = Field(
        (math.nan, math.nan, math.nan),
        description="first latitude deg, longitude deg, height m; NaN = the scenario's start with its errors drawn",
    )
    start_velocity: tuple[float, float, float] = Field(
        (math.nan, math.nan, math.nan), description="first velocity north, east, down m/s; NaN likewise"
    )
    start_attitude: tuple[float, float, float] = Field(
        (math.nan, math.nan, math.nan), description="first roll, pitch, heading deg; NaN likewise"
    )


class UkfFusionNode(GraphNode):
    """Advances with each IMU sample and answers it, and every message on pmht_mm/fix, with nav/* of its newest stamp."""

    sections: ClassVar[Sequence[str]] = ("seed", "route", "imu", "initial_error")
    settings_model: ClassVar[type[NodeSettings]] = UkfFusionSettings
    settings: UkfFusionSettings

    def setup(self) -> None:
        """Start the filter and make publishers and subscriptions."""
        self.samples = 0
        """IMU samples received, whatever became of them."""
        self.answered = 0
        """Messages on pmht_mm/fix dealt with."""
        self._accepted = self._refused = self._gaps = 0
        self._start = initial_state(self.scenario, self.settings)
        self._model = FilterModel.from_scenario(self.scenario)
        self._navigator: BufferedNavigator | None = None
        self._ns = -1
        self._waiting: list[Any] = []
        self._information: dict[int, Any] = {}
        self._rate = np.zeros(3)
        self._frame = map_frame(self.scenario)
        self._warm_up()
        self._covariance, self._fix = self.advertise(topics.NAV_COVARIANCE), self.advertise(topics.NAV_FIX)
        self._odom, self._path = self.advertise(topics.NAV_ODOM), self.advertise(topics.NAV_PATH)
        self._m_covariance, self._m_fix = topics.NAV_COVARIANCE.type(), topics.NAV_FIX.type()
        self._m_fix.header.frame_id = BASE
        self._m_odom = topics.NAV_ODOM.type(child_frame_id=BASE)
        self._m_path = topics.NAV_PATH.type()
        self._m_odom.header.frame_id = self._m_path.header.frame_id = MAP
        self.listen(topics.IMU, self._take_imu)
        self.listen(topics.FIX, self._take_fix)
        self._informants = self.listen(topics.INFORMATION, self._take_information, raw=True)

    def _warm_up(self) -> None:
        """Compile, or load, the filter's kernels before the first sample comes."""
        navigator = BufferedNavigator(self._model, FilterState.start(self._start, self._model))
        latitude, longitude, height = self._start.position[0].tolist()
        navigator.propagate(self._model.dt, np.array([0.0, 0.0, -9.8]), np.zeros(3), height)
        navigator.update(self._model.dt, latitude, longitude, np.eye(2) * 1e6)

    def _take_imu(self, message: Any) -> None:
        self.samples += 1
        ns = to_ns(message.header.stamp)
        force, rate = read_imu(message, self.settings.imu_frame)
        if self._navigator is None:
            # the first sample's interval begins where the start is known
            self._ns = ns - from_seconds(self._model.dt)
            state = FilterState.start(self._start, self._model)
            self._navigator = BufferedNavigator(self._model, state, to_seconds(self._ns), self.settings.horizon)
            self._publish()
        elif ns <= self._ns:
            raise BadMessageError(f"stamp {to_seconds(ns):.3f} s is not later than {to_seconds(self._ns):.3f} s")
        else:
            self._note_gap(to_seconds(ns - self._ns))
        try:
            self._navigator.propagate(to_seconds(ns), force, rate, self.scenario.route.height)
        except FilterDivergenceError as error:
            self.health.state(ERROR, str(error))
            raise BadMessageError(str(error)) from None
        self._ns, self._rate = ns, rate
        self._publish()
        if self._waiting:
            self._settle()
        self.health.tick(ns)

    def _note_gap(self, interval: float) -> None:
        missing = round(interval / self._model.dt) - 1
        if missing < 1:
            self.health.state(OK, "navigating")
            return
        self._gaps += missing
        self.health.figures["IMU samples missing"] = self._gaps
        level = ERROR if interval > self.settings.max_gap else WARN
        self.health.state(
            level,
            f"{missing} IMU samples missing before {to_seconds(self._ns) + interval:.3f} s, bridged with the next one",
        )

    def _take_information(self, data: bytes) -> None:
        ns = peek_numbers_ns(data)
        self._information[ns] = read_information(deserialize_message(data, topics.INFORMATION.type))
        while len(self._information) > KEPT:
            del self._information[next(iter(self._information))]
        self._settle()

    def _take_fix(self, message: Any) -> None:
        self._waiting.append(message)
        self._settle()

    def _settle(self) -> None:
        """Apply, in order, the fixes whose information is there; answer each, whatever it is: a lock-step simulation waits for that."""
        while self._waiting:
            message = self._waiting[0]
            ns = to_ns(message.header.stamp)
            if ns not in self._information and self._may_come(ns):
                return
            del self._waiting[0]
            try:
                self._apply(message, self._information.pop(ns, None))
            except BadMessageError as error:
                self.health.drop(topics.FIX.name, str(error))
            except Exception as error:
                self.health.drop(topics.FIX.name, f"{type(error).__name__}: {error}")
                self.get_logger().error(f"{topics.FIX.name}: {type(error).__name__}: {error}")
            self.answered += 1
            if self._navigator is not None:
                self._publish()

    def _may_come(self, ns: int) -> bool:
        """Whether information that belongs to a fix may still be under way."""
        newest = next(reversed(self._information), -1)
        return self._informants.get_publisher_count() > 0 and newest <= ns and self._ns - ns < PATIENCE_NS

    def _apply(self, message: Any, information: Any) -> None:
        lost, likelihood = information or (False, None)
        no_fix = message.status.status == NavSatStatus.STATUS_NO_FIX
        if no_fix and not lost:
            return
        if self._navigator is None:
            raise BadMessageError("came before the first IMU sample")
        stamp = to_seconds(to_ns(message.header.stamp))
        if lost:
            self._navigator.widen(stamp, LOST_SIGMA)
        if no_fix:
            return
        if likelihood is not None:
            result = self._navigator.update_information(stamp, likelihood.vector, likelihood.matrix)
        else:
            latitude, longitude, _ = read_position(message)
            result = self._navigator.update(stamp, latitude, longitude, read_covariance(message)[:2, :2])
        self._accepted += result.accepted
        self._refused += not result.accepted
        self.health.figures |= {
            "fixes accepted": self._accepted,
            "fixes refused": self._refused,
            "innovation north": float(result.innovation[0]),
            "innovation east": float(result.innovation[1]),
            "normalised innovation squared": float(result.nis),
            "age of the last fix": float(result.late),
        }
        if not result.accepted:
            raise BadMessageError(result.reason or "refused")

    def _publish(self) -> None:
        assert self._navigator is not None
        state = self._navigator.state
        covariance = state.covariance[0]
        nav = np.concatenate([state.position[0], state.velocity[0], state.attitude[0]])
        fill_numbers(self._m_covariance, self._ns, state.batch_prior[0])
        latitude, longitude, height = state.position[0].tolist()
        fill_fix(self._m_fix, self._ns, latitude, longitude, height, covariance[:3, :3])
        fill_odom(self._m_odom, self._ns, self._frame, nav, self._turn_rate(state), covariance)
        self._covariance.publish(self._m_covariance)
        self._fix.publish(self._m_fix)
        self._odom.publish(self._m_odom)
        self._extend_path()

    def _turn_rate(self, state: FilterState) -> Array:
        """Return the angular rate relative to the Earth (3,) FRD: the gyroscopes' without their biases and the Earth's rotation."""
        latitude = state.position[0, 0]
        w, x, y, z = state.attitude[0]
        earth = rotate(w, -x, -y, -z, EARTH_RATE * math.cos(latitude), 0.0, -EARTH_RATE * math.sin(latitude))
        return self._rate - state.gyroscope_bias[0] - np.array(earth)

    def _extend_path(self) -> None:
        poses = self._m_path.poses
        if poses and self._ns - to_ns(poses[-1].header.stamp) < from_seconds(self.settings.path_interval):
            return
        pose = type(self)._pose(self._m_odom)
        poses.append(pose)
        self._m_path.header.stamp = from_ns(self._ns)
        self._path.publish(self._m_path)

    @staticmethod
    def _pose(odom: Any) -> Any:
        from copy import deepcopy

        from geometry_msgs.msg import PoseStamped

        return PoseStamped(header=deepcopy(odom.header), pose=deepcopy(odom.pose.pose))


def main(args: Sequence[str] | None = None) -> None:
    """Entry point of the console script."""
    sys.exit(run_node(topics.UKF_FUSION, lambda: UkfFusionNode(topics.UKF_FUSION)))


if __name__ == "__main__":
    main()
