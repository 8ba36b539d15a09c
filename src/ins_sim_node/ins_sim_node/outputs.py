"""What the simulated vehicle publishes at a step."""

import math
import time

import numpy as np

from isogal.arrays import Array
from isogal.fields.simulated_vehicle import SimulatedVehicle
from isogal.scenario import HeadingAid
from isogal_ros import topics
from isogal_ros.messages.aids import aid_of, fill_aid
from isogal_ros.messages.frames import ANTENNA, BASE, framed, map_frame
from isogal_ros.messages.imu import fill_imu, fill_noise
from isogal_ros.messages.ins_solution import SolutionMessages
from isogal_ros.messages.odometry import empty_odometry, fill_odom, read_odometry
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.prepared import Prepared, write
from isogal_ros.messages.stamps import from_seconds, to_seconds
from isogal_ros.nodes.base import GraphNode


class Aids:
    """Publishes what the vehicle's sensors beside the IMU give, as late as it really comes.

    Parameters
    ----------
    node : GraphNode
    vehicle : SimulatedVehicle
        Of one run.
    """

    def __init__(self, node: GraphNode, vehicle: SimulatedVehicle) -> None:
        self._aids, scenario, truth = [], node.scenario, node.scenario.true
        each = [*zip(scenario.aids, truth.aids, vehicle.aids, strict=True)]
        if scenario.height.measured and vehicle.heights is not None:
            each.insert(0, (scenario.height, truth.height, vehicle.heights))
        for aid, really, read in each:
            if (known := aid_of(aid)) is None:
                continue
            topic = known.topic
            late = math.ceil(really.delay / vehicle.trajectory.dt - 1e-9)
            rows = dict(zip(read.ends.tolist(), read.values[0], strict=True))
            of_satellites = topic in (topics.GNSS_FIX, topics.GNSS_VELOCITY)
            message = framed(topic, ANTENNA if of_satellites else BASE)
            self._aids.append((aid, really, late, rows, node.advertise(topic), message))
        self._step_ns = from_seconds(vehicle.trajectory.dt)

    def publish(self, k: int, ns: int) -> None:
        """Publish what comes at the end of step k, which has a stamp (ns)."""
        for aid, really, late, rows, publisher, message in self._aids:
            value = rows.get(k - late)
            # a receiver without satellites says so, a sensor without a heading says nothing
            if value is None or (isinstance(aid, HeadingAid) and np.isnan(value)):
                continue
            fill_aid(message, ns - late * self._step_ns, value, aid, really)
            publisher.publish(message)


COMPARE_EVERY = 0.5
"""s of wall time between comparisons of navigator and truth."""


class Outputs:
    """Publishers and messages; the messages are made once and overwritten."""

    def __init__(self, node: GraphNode, vehicle: SimulatedVehicle) -> None:
        self._vehicle = vehicle
        self._error = math.nan
        """m, horizontal, of the navigator when it was last compared."""
        self._compared = 0.0
        self._step_ns = from_seconds(vehicle.trajectory.dt)
        self._frame = map_frame(node.scenario)
        self._clock = node.advertise(topics.CLOCK)
        self._solution = SolutionMessages(node.scenario)
        self._inertial = [node.advertise(topic) for topic in self._solution.topics]
        self._aids = Aids(node, vehicle)
        self._truth_fix = node.advertise(topics.TRUTH_FIX)
        self._truth_odom = node.advertise(topics.TRUTH_ODOM)
        self._ins_fix = node.advertise(topics.INS_FIX)
        self._m_clock = Prepared(topics.CLOCK.type())
        self._m_truth = Prepared(framed(topics.TRUTH_FIX, BASE))
        self._m_ins = Prepared(framed(topics.INS_FIX, BASE))
        self._m_odom = empty_odometry(topics.TRUTH_ODOM)
        imu = framed(topics.IMU, BASE)
        imu.orientation_covariance[0] = -1.0  # no orientation
        interval = vehicle.trajectory.dt / vehicle.samples.shape[1]
        fill_noise(imu, node.scenario.imu.sensors, interval)
        self._m_imu = Prepared(imu)

    def publish(self, k: int, ns: int) -> None:
        """Publish step k: the clock, then the IMU's samples of the step, or the INS's solution, so
        that the filter works while the rest is made. The start (k = 0) has no sample."""
        run = self._vehicle
        write(self._m_clock, ns)
        self._clock.publish(self._m_clock)
        if k > 0:
            self._aids.publish(k, ns)
        if run.solution is not None:
            messages = self._solution.of(ns, run.solution[k], run.turn_rate[k])
            for publisher, message in zip(self._inertial, messages, strict=True):
                publisher.publish(message)
        elif k > 0:
            self._publish_samples(run.samples[k - 1], ns)
        latitude, longitude, height = run.states[k, :3].tolist()
        fill_fix(self._m_truth, ns, latitude, longitude, height)
        fill_fix(self._m_ins, ns, run.unaided[k, 0], run.unaided[k, 1], height)
        fill_odom(self._m_odom, ns, self._frame, run.states[k], run.turn_rate[k])
        self._truth_odom.publish(self._m_odom)
        self._ins_fix.publish(self._m_ins)
        self._truth_fix.publish(self._m_truth)

    def _publish_samples(self, samples: Array, ns: int) -> None:
        """Publish the samples (n, 6) of a step that ends at a stamp."""
        interval = self._step_ns / len(samples)
        for j, sample in enumerate(samples):
            stamp = ns - round((len(samples) - 1 - j) * interval)
            fill_imu(self._m_imu, stamp, sample[:3], sample[3:])
            self._inertial[0].publish(self._m_imu)

    def compare(self, odometry: bytes) -> None:
        """Measure the distance of a serialised nav/odom from the truth last published; it is for
        display only, so that not every message of a fast run is decoded."""
        if (now := time.monotonic()) - self._compared < COMPARE_EVERY:
            return
        self._compared = now
        found, true = read_odometry(odometry).place, self._m_odom.numbers
        self._error = math.dist(found[:2], true[:2])

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
