"""Definitions of message types."""

from isogal_ros import topics
from isogal_ros.bags.definitions import schema_text


def test_schema_holds_all_that_a_message_contains(monkeypatch) -> None:
    for environment in (None, "/nowhere"):  # packages from wheels are not in the ament index
        schema_text.cache_clear()
        if environment is None:
            monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
        else:
            monkeypatch.setenv("AMENT_PREFIX_PATH", environment)
        text = schema_text("nav_msgs/msg/Odometry")
        for name in (
            "std_msgs/Header",
            "geometry_msgs/PoseWithCovariance",
            "geometry_msgs/Quaternion",
            "builtin_interfaces/Time",
        ):
            assert text.count(f"MSG: {name}\n") == 1
    for topic in topics.ALL:
        assert schema_text(topics.type_name(topic.type))
