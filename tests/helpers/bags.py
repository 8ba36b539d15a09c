"""Small bags written with the mcap library: a navigator's positions and a gravimeter's readings,
without ROS."""

from pathlib import Path
from types import SimpleNamespace

HEADER = """std_msgs/Header header
"""
STAMPED = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
NAV_SAT_FIX = (
    HEADER
    + """sensor_msgs/NavSatStatus status
float64 latitude
float64 longitude
float64 altitude
float64[9] position_covariance
uint8 position_covariance_type
"""
    + STAMPED
    + """================================================================================
MSG: sensor_msgs/NavSatStatus
int8 status
uint16 service
"""
)
ACCEL = (
    HEADER
    + """geometry_msgs/AccelWithCovariance accel
"""
    + STAMPED
    + """================================================================================
MSG: geometry_msgs/AccelWithCovariance
geometry_msgs/Accel accel
float64[36] covariance
================================================================================
MSG: geometry_msgs/Accel
geometry_msgs/Vector3 linear
geometry_msgs/Vector3 angular
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
)
MAGNETIC = (
    HEADER
    + """geometry_msgs/Vector3 magnetic_field
float64[9] magnetic_field_covariance
"""
    + STAMPED
    + """================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
)
TYPES = {
    "sensor_msgs/msg/NavSatFix": NAV_SAT_FIX,
    "geometry_msgs/msg/AccelWithCovarianceStamped": ACCEL,
    "std_msgs/msg/String": "string data\n",
    "sensor_msgs/msg/MagneticField": MAGNETIC,
}
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
            time = second + 0.5
            messages.append(
                (
                    f"{prefix}gravimeter/gravity",
                    READING,
                    reading(time, 9.8 + 1e-5 * second, variance),
                )
            )
            messages.append(
                (
                    f"{prefix}gravimeter/disturbance",
                    READING,
                    reading(time, 1e-5 * second, variance),
                )
            )
    return messages
