"""Compare the recorded navigator with the truth.

python examples/sensor_driver/check.py out/driver
"""

import argparse
from pathlib import Path

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import NavSatFix

from isogal.earth.frames import horizontal_difference
from isogal_ros.bags.reader import BagReader


def main() -> None:
    """Print the error now and then, its 1-sigma, and the number of fixes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    truth = {
        row[0]: row[1:] for row in np.loadtxt(folder / "truth.csv", delimiter=",", skiprows=1)
    }
    fixes, places = 0, {}
    for message in BagReader(folder / "bag").messages():
        if message.topic == "/nav/fix":
            place = deserialize_message(message.data, NavSatFix)
            places[place.header.stamp.sec] = place  # the last of a stamp is after its fix
        elif message.topic == "/pmht_mm/fix":
            fixes += deserialize_message(message.data, NavSatFix).status.status >= 0
    start = min(places)
    print(f"{fixes} fixes\n\nminute   error (m)   1-sigma (m)")
    for second in range(start + 300, max(places) + 1, 300):
        place = places[second]
        latitude, longitude = truth[float(second)]
        believed = np.radians([place.latitude, place.longitude])
        apart = horizontal_difference(*believed, *np.radians([latitude, longitude]))
        error = np.hypot(*apart)
        sigma = np.sqrt(place.position_covariance[0] + place.position_covariance[4])
        print(f"{(second - start) / 60:6.0f} {error:11.0f} {sigma:13.0f}")


if __name__ == "__main__":
    main()
