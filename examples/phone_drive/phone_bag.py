"""Make a recording, as `ros2 bag record` lays it out, of a drive that a phone has logged.

    isogal-python examples/phone_drive/phone_bag.py LOG BAG [--satellites S]

Satellites are kept for the first S seconds (300); after that the satellite receiver's speed alone
goes on, in place of that of the wheels. `isogal replay BAG --scenario car.yaml` navigates it."""

import argparse
import math
import sys
from pathlib import Path

import numpy as np
from phone_log import Drive, ground_pressure, position_at, read_drive, velocity_at

from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.bags.writer import BagWriter
from isogal_ros.messages.frames import ANTENNA, BASE, NED_ENU, framed
from isogal_ros.messages.ground import BAROMETER
from isogal_ros.messages.imu import fill_imu
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.topics import Message

NOT_MEASURED = -1.0
"""Variance of an axis."""


def write_bag(drive: Drive, folder: Path, satellites: float) -> int:
    """Write a drive with so many seconds of satellites."""
    bag = BagWriter(folder, replace=True)
    scans = ground_pressure(drive)
    for k in range(1, len(drive.time)):
        ns = from_seconds(drive.time[k])
        bag.put(topics.IMU, imu(drive, k, ns), ns)
        if math.isfinite(drive.pressure[k]):
            put_pressure(bag, topics.BAROMETER, BASE, float(drive.pressure[k]), ns)
        if k in scans:
            put_pressure(bag, topics.GROUND_PRESSURE, BAROMETER, scans[k], ns)
        if math.isfinite(drive.speed[k]):
            bag.put(topics.VELOCITY, speed(drive, k, ns), ns)
        if drive.time[k] < satellites and math.isfinite(drive.latitude[k]):
            fix = framed(topics.GNSS_FIX, ANTENNA, ns)
            place, covariance = position_at(drive, k)
            fill_fix(fix, ns, *place.tolist(), covariance)
            bag.put(topics.GNSS_FIX, fix, ns)
            if math.isfinite(drive.course[k] + drive.speed[k]):
                bag.put(topics.GNSS_VELOCITY, over_ground(drive, k, ns), ns)
    bag.close()
    return bag.messages


def put_pressure(bag: BagWriter, topic: topics.Topic, frame: str, value: float, ns: int) -> None:
    """Write a pressure, Pa."""
    message = framed(topic, frame, ns)
    message.fluid_pressure = value
    bag.put(topic, message, ns)


def imu(drive: Drive, k: int, ns: int) -> Message:
    """Return an inertial sample that declares the noise of its turn rate."""
    message = framed(topics.IMU, BASE)
    fill_imu(message, ns, drive.force[k], drive.rate[k])
    message.angular_velocity_covariance[8] = float(drive.turn_variance[k])
    return message


def speed(drive: Drive, k: int, ns: int) -> Message:
    """Return the speed forward."""
    message = framed(topics.VELOCITY, BASE, ns)
    message.twist.twist.linear.x = float(drive.speed[k])
    message.twist.covariance[7] = message.twist.covariance[14] = NOT_MEASURED
    return message


def over_ground(drive: Drive, k: int, ns: int) -> Message:
    """Return the velocity by satellites."""
    message = framed(topics.GNSS_VELOCITY, ANTENNA, ns)
    velocity, covariance = velocity_at(drive, k)
    linear = message.twist.twist.linear
    linear.x, linear.y = float(velocity[1]), float(velocity[0])
    of_all = np.zeros((6, 6))
    of_all[:3, :3] = NED_ENU @ covariance @ NED_ENU.T
    of_all[2, 2] = NOT_MEASURED
    message.twist.covariance = of_all.ravel()
    return message


def main() -> None:
    """Convert one log."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("log", type=Path, metavar="LOG")
    parser.add_argument("bag", type=Path, metavar="BAG")
    parser.add_argument("--satellites", type=float, default=300.0, metavar="S")
    arguments = parser.parse_args()
    try:
        drive = read_drive(arguments.log, arguments.satellites)
        count = write_bag(drive, arguments.bag, arguments.satellites)
    except InputError as error:
        sys.exit(f"phone_bag.py: {error}")
    print(f"{arguments.bag}: {count} messages, {drive.time[-1]:.0f} s")


if __name__ == "__main__":
    main()
