"""What `colcon test` runs of this package; all others are in the folder tests beside src."""

from isogal_ros import topics
from isogal_ros.graph.bus import Bus


def test_the_node_is_active_with_its_defaults() -> None:
    with Bus() as bus:
        node = bus.add(topics.GRAVIMETER, {"gravity.field": "normal"})
        assert node.active
        assert node.get_name() == "gravimeter_node"
