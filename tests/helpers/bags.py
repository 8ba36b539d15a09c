"""Small bags written with the mcap library: a navigator's positions and a gravimeter's readings,
without ROS."""

from pathlib import Path
from types import SimpleNamespace

PARTS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "sensor_msgs/NavSatStatus": "int8 status\nuint16 service\n",
    "geometry_msgs/AccelWithCovariance": "geometry_msgs/Accel accel\nfloat64[36] covariance\n",
    "geometry_msgs/Accel": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
}
"""What messages consist of."""
FIELDS = {
    "sensor_msgs/msg/NavSatFix": (
        "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\n"
        "float64 longitude\nfloat64 altitude\nfloat64[9] position_covariance\n"
        "uint8 position_covariance_type\n"
    ),
    "geometry_msgs/msg/AccelWithCovarianceStamped": (
        "std_msgs/Header header\ngeometry_msgs/AccelWithCovariance accel\n"
    ),
    "std_msgs/msg/String": "string data\n",
    "sensor_msgs/msg/MagneticField": (
        "std_msgs/Header header\ngeometry_msgs/Vector3 magnetic_field\n"
        "float64[9] magnetic_field_covariance\n"
    ),
}


def definition(text):
    """Fields of a message with the parts that they, and the parts before, consist of."""
    for name, part in PARTS.items():
        if f"{name} " in text:
            text += f"{'=' * 80}\nMSG: {name}\n{part}"
    return text


TYPES = {name: definition(text) for name, text in FIELDS.items()}
FIX, READING, TEXT, ANOMALY = TYPES


def stamp(time):
    return SimpleNamespace(
        stamp=SimpleNamespace(sec=int(time), nanosec=round(1e9 * (time - int(time)))), frame_id=""
    )


def position(time, latitude, longitude, status=0):
    return SimpleNamespace(
        header=stamp(time),
        status=SimpleNamespace(status=status, service=0),
        latitude=latitude,
        longitude=longitude,
        altitude=0.0,
        position_covariance=[0.0] * 9,
        position_covariance_type=0,
    )


def reading(time, value, variance=1e-10):
    zero = SimpleNamespace(x=0.0, y=0.0, z=0.0)
    accel = SimpleNamespace(linear=SimpleNamespace(x=0.0, y=0.0, z=value), angular=zero)
    covariance = [0.0] * 36
    covariance[14] = variance
    return SimpleNamespace(
        header=stamp(time), accel=SimpleNamespace(accel=accel, covariance=covariance)
    )


def anomaly(time, value, sigma=1.0):
    """A reduced reading of a magnetometer, nT."""
    vector = SimpleNamespace(x=float("nan"), y=float("nan"), z=value * 1e-9)
    return SimpleNamespace(
        header=stamp(time),
        magnetic_field=vector,
        magnetic_field_covariance=[0.0] * 8 + [sigma**2 * 1e-18],
    )


def ground(time, height, sigma=1.0, status=0):
    """A reduced reading of a clearance meter, m."""
    message = position(time, -36.0, 147.0, status)
    message.altitude, message.position_covariance = height, [0.0] * 8 + [sigma**2]
    return message


def write_bag(path: Path, *messages: tuple[str, str, object], chunk_size: int = 1 << 20) -> Path:
    """Write (topic, type, message) in order."""
    from mcap_ros2.writer import Writer

    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as stream, Writer(stream, chunk_size=chunk_size) as writer:
        schemas = {name: writer.register_msgdef(name, text) for name, text in TYPES.items()}
        for number, (topic, kind, message) in enumerate(messages):
            writer.write_message(
                topic, schemas[kind], message, log_time=number, publish_time=number
            )
    return path


def drive(count=20, prefix="/", variance=1e-10):
    """Positions each second along a meridian; gravity and disturbance every other second from 2.5
    s on."""
    messages = []
    for second in range(count):
        messages.append((f"{prefix}nav/fix", FIX, position(second, -36.0 + 1e-3 * second, 147.0)))
        if second % 2 == 0 and second:
            for name, level in (("gravity", 9.8), ("disturbance", 0.0)):
                message = reading(second + 0.5, level + 1e-5 * second, variance)
                messages.append((f"{prefix}gravimeter/{name}", READING, message))
    return messages
