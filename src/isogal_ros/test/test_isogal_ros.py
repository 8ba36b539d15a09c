"""What `colcon test` runs of this package; all others are in the folder tests beside src."""

from std_msgs.msg import Float64

from isogal_ros import topics
from isogal_ros.messages.drivers import Driver, Entrance
from isogal_ros.topics import type_name


def test_a_number_becomes_a_message_of_the_graph() -> None:
    entrance = Entrance({topics.GRAVIMETRY.name: Driver(unit="mGal")})
    found = entrance.take(topics.GRAVIMETRY, Float64(data=980_000.0), 0)
    assert type_name(type(found)) == "geometry_msgs/msg/AccelWithCovarianceStamped"
    assert abs(found.accel.accel.linear.z - 9.8) < 1e-12
