"""The ROS messages of the field `free-air`: those of a gravimeter, reduced on a topic of their
own."""

from geometry_msgs.msg import AccelWithCovarianceStamped

from isogal.scenario import Scenario
from isogal_ros.messages.adapter import Adapter
from isogal_ros.messages.gravimeter import accelerations
from isogal_ros.topics import Topic

ANOMALY = Topic("gravimeter/free_air_anomaly", AccelWithCovarianceStamped)


def free_air(scenario: Scenario) -> Adapter:
    """Return the adapter of the field."""
    return accelerations(ANOMALY)
