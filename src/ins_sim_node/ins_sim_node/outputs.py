"""What the simulated vehicle publishes at a step."""

import math
import time

import numpy as np
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message

from isogal.arrays import Array
from isogal.fields.simulated_vehicle import SimulatedVehicle
from isogal.sensors.satellites import SatelliteFixes
from isogal_ros import topics
from isogal_ros.messages.aids import (
    aids_of,
    fill_ground_velocity,
    fill_pressure,
    fill_satellite_fix,
    fill_velocity,
)
from isogal_ros.messages.frames import ANTENNA, BASE, MAP, map_frame
from isogal_ros.messages.imu import fill_imu, fill_noise
from isogal_ros.messages.odometry import fill_odom
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.stamps import from_seconds, set_stamp, to_seconds
from isogal_ros.nodes.base import GraphNode

COMPARE_EVERY = 0.1
"""s of wall time between comparisons of navigator and truth."""


class Satellites:
    """What a satellite receiver publishes: each fix when it comes, with its own stamp."""

    def __init__(self, node: GraphNode, fixes: SatelliteFixes) -> None:
        self._fixes, self._gnss = fixes, node.scenario.gnss
        step = 1.0 / node.scenario.navigation_rate
        self._late = math.ceil(node.scenario.true.gnss.delay / step - 1e-9)
        self._step_ns = from_seconds(step)
        self._row = {k: row for row, k in enumerate(fixes.ends.tolist())}
        self._fix = node.advertise(topics.GNSS_FIX)
        self._velocity: Publisher | None = None
        if topics.GNSS_VELOCITY in aids_of(node.scenario):
            self._velocity = node.advertise(topics.GNSS_VELOCITY)
        self._m_fix, self._m_velocity = topics.GNSS_FIX.type(), topics.GNSS_VELOCITY.type()
        self._m_fix.header.frame_id = self._m_velocity.header.frame_id = ANTENNA

    def publish(self, k: int, ns: int) -> None:
        """Publish what comes at the end of step k, which has a stamp (ns)."""
        row = self._row.get(k - self._late)
        if row is None:
            return
        stamp = ns - self._late * self._step_ns
        fill_satellite_fix(self._m_fix, stamp, self._fixes.position[0, row], self._gnss)
        self._fix.publish(self._m_fix)
        if self._velocity is not None:
            speed = self._fixes.velocity[0, row]
            fill_ground_velocity(self._m_velocity, stamp, speed, self._gnss)
            self._velocity.publish(self._m_velocity)


class Outputs:
    """Publishers and messages; the messages are made once and overwritten."""

    def __init__(self, node: GraphNode, vehicle: SimulatedVehicle) -> None:
        self._vehicle = vehicle
        self._error = math.nan
        """m, horizontal, of the navigator when it was last compared."""
        self._compared = 0.0
        self._step_ns = from_seconds(vehicle.trajectory.dt)
        self._frame = map_frame(node.scenario)
        self._clock, self._imu = node.advertise(topics.CLOCK), node.advertise(topics.IMU)
        self._height = node.scenario.true.height
        if vehicle.height is not None:
            self._pressure = node.advertise(topics.BAROMETER)
        if vehicle.velocity is not None:
            self._velocity = node.advertise(topics.VELOCITY)
        if vehicle.satellites is not None:
            self._satellites = Satellites(node, vehicle.satellites)
        self._truth_fix = node.advertise(topics.TRUTH_FIX)
        self._truth_odom = node.advertise(topics.TRUTH_ODOM)
        self._ins_fix = node.advertise(topics.INS_FIX)
        self._m_clock, self._m_imu = topics.CLOCK.type(), topics.IMU.type()
        self._m_truth, self._m_ins = topics.TRUTH_FIX.type(), topics.INS_FIX.type()
        self._m_odom = topics.TRUTH_ODOM.type(child_frame_id=BASE)
        self._m_odom.header.frame_id = MAP
        self._m_pressure, self._m_velocity = topics.BAROMETER.type(), topics.VELOCITY.type()
        framed = self._m_imu, self._m_truth, self._m_ins, self._m_pressure, self._m_velocity
        for message in framed:
            message.header.frame_id = BASE
        self._m_imu.orientation_covariance[0] = -1.0  # no orientation
        interval = vehicle.trajectory.dt / vehicle.samples.shape[1]
        fill_noise(self._m_imu, node.scenario.imu.sensors, interval)

    def publish(self, k: int, ns: int) -> None:
        """Publish step k: the clock, then the IMU's samples of the step, so that the filter works
        while the rest is made. The start (k = 0) has no sample."""
        run = self._vehicle
        set_stamp(self._m_clock.clock, ns)
        self._clock.publish(self._m_clock)
        if k > 0:
            self._publish_aids(k, ns)
            self._publish_samples(run.samples[k - 1], ns)
        latitude, longitude, height = run.states[k, :3].tolist()
        fill_fix(self._m_truth, ns, latitude, longitude, height)
        fill_fix(self._m_ins, ns, run.unaided[k, 0], run.unaided[k, 1], height)
        fill_odom(self._m_odom, ns, self._frame, run.states[k], run.turn_rate[k])
        self._truth_odom.publish(self._m_odom)
        self._ins_fix.publish(self._m_ins)
        self._truth_fix.publish(self._m_truth)

    def _publish_aids(self, k: int, ns: int) -> None:
        """Publish what the sensors of height and velocity read at the end of step k > 0, if
        anything."""
        height, velocity = self._vehicle.height, self._vehicle.velocity
        if height is not None and not math.isnan(height[k - 1]):
            fill_pressure(self._m_pressure, ns, float(height[k - 1]), self._height)
            self._pressure.publish(self._m_pressure)
        if velocity is not None and np.isfinite(velocity[k - 1]).any():
            fill_velocity(self._m_velocity, ns, velocity[k - 1])
            self._velocity.publish(self._m_velocity)
        if self._vehicle.satellites is not None:
            self._satellites.publish(k, ns)

    def _publish_samples(self, samples: Array, ns: int) -> None:
        """Publish the samples (n, 6) of a step that ends at a stamp."""
        interval = self._step_ns / len(samples)
        for j, sample in enumerate(samples):
            stamp = ns - round((len(samples) - 1 - j) * interval)
            fill_imu(self._m_imu, stamp, sample[:3], sample[3:])
            self._imu.publish(self._m_imu)

    def compare(self, odometry: bytes) -> None:
        """Measure the distance of a serialised nav/odom from the truth last
        published.

        It is for display only, so that not every message of a fast run is decoded."""
        if (now := time.monotonic()) - self._compared < COMPARE_EVERY:
            return
        self._compared = now
        point = deserialize_message(odometry, topics.NAV_ODOM.type).pose.pose.position
        truth = self._m_odom.pose.pose.position
        self._error = math.hypot(point.x - truth.x, point.y - truth.y)

    def progress(self, ns: int, elapsed: float) -> dict[str, float]:
        """Return figures of the progress at a stamp, `elapsed` s of wall time after the first
        step."""
        simulated = to_seconds(ns)
        return {
            "simulated": simulated,
            "duration": float(self._vehicle.trajectory.time[-1]),
            "speed": simulated / elapsed if elapsed > 0.0 else 0.0,
            "position error": self._error,
        }

    def arrived(self, elapsed: float) -> str:
        """Say how the run went, `elapsed` s of wall time after the first step."""
        figures = self.progress(from_seconds(self._vehicle.trajectory.time[-1]), elapsed)
        return (
            f"arrived after {figures['simulated']:.0f} s at {figures['speed']:.0f} x real time;"
            f" position error {figures['position error']:.0f} m"
        )
