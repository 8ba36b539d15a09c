"""The topics of the graph: types, who publishes, who listens, and with which quality of
service."""

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelWithCovarianceStamped
from nav_msgs.msg import Odometry, Path
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, MagneticField, NavSatFix, PointCloud2, Range
from std_msgs.msg import Float64MultiArray

INS_SIM = "ins_sim_node"
GRAVIMETER = "gravimeter_node"
PMHT_MM = "pmht_mm_node"
UKF_FUSION = "ukf_fusion_node"
NODES = (INS_SIM, GRAVIMETER, PMHT_MM, UKF_FUSION)

LOSSLESS = QoSProfile(
    history=HistoryPolicy.KEEP_ALL,
    depth=0,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""Of every topic: a slow reader holds the writer up instead of losing messages. A reader that is
best effort holds up nobody."""


@dataclass(frozen=True)
class Topic:
    """One topic of the graph."""

    name: str
    """Relative to the graph's namespace, unless it begins with a slash."""
    type: Any
    """Message class."""
    consumers: tuple[str, ...] = ()
    """Nodes that cannot do without."""


CLOCK = Topic("/clock", Clock)
IMU = Topic("imu/data_raw", Imu, (UKF_FUSION,))
TRUTH_FIX = Topic("ground_truth/fix", NavSatFix, (GRAVIMETER,))
TRUTH_ODOM = Topic("ground_truth/odom", Odometry)
INS_FIX = Topic("ins/fix", NavSatFix)
FELT = Topic("gravimeter/data_raw", AccelWithCovarianceStamped)
GRAVITY = Topic("gravimeter/gravity", AccelWithCovarianceStamped)
DISTURBANCE = Topic("gravimeter/disturbance", AccelWithCovarianceStamped)
MAGNETIC_FIELD = Topic("magnetometer/data_raw", MagneticField)
ANOMALY = Topic("magnetometer/anomaly", MagneticField)
CLEARANCE = Topic("altimeter/range", Range)
TERRAIN = Topic("altimeter/terrain", NavSatFix)
FULL_GRADIENT = Topic("gradiometer/data_raw", PointCloud2)
GRADIENT = Topic("gradiometer/gradient", PointCloud2)
FIX = Topic("pmht_mm/fix", NavSatFix, (UKF_FUSION, INS_SIM))
INFORMATION = Topic("pmht_mm/information", Float64MultiArray, (UKF_FUSION,))
"""Beside each fix: stamp (s, ns), 1 where the matcher found the navigator lost else 0, then vector
(4) and matrix (4 x 4) of the likelihood of the (north, east, v_north, v_east) error, or nothing
more where the fix says all. Relative to ``nav/*`` of that stamp before the fix."""
CANDIDATES = Topic("pmht_mm/candidates", PointCloud2)
NAV_FIX = Topic("nav/fix", NavSatFix, (GRAVIMETER, PMHT_MM))
NAV_ODOM = Topic("nav/odom", Odometry, (GRAVIMETER, PMHT_MM, INS_SIM))
NAV_COVARIANCE = Topic("nav/covariance", Float64MultiArray, (GRAVIMETER, PMHT_MM))
"""Stamp (s, ns), then the 7 x 7 covariance, row by row, of the errors north, east (m), v_north,
v_east (m/s), attitude about north, east, down (rad), which an Odometry cannot carry."""
NAV_PATH = Topic("nav/path", Path)
DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray, (INS_SIM,))

ALL = (
    CLOCK, IMU, TRUTH_FIX, TRUTH_ODOM, INS_FIX, FELT, GRAVITY, DISTURBANCE, MAGNETIC_FIELD, ANOMALY, CLEARANCE, TERRAIN,
    FULL_GRADIENT, GRADIENT, FIX, INFORMATION, CANDIDATES, NAV_FIX, NAV_ODOM, NAV_COVARIANCE, NAV_PATH, DIAGNOSTICS,
)  # fmt: skip


def readings(field: str) -> Topic:
    """Return the topic of a field's reduced readings (`isogal.fields.measured`)."""
    names = {
        "gravity": GRAVITY,
        "disturbance": DISTURBANCE,
        "magnetic": ANOMALY,
        "terrain": TERRAIN,
        "gradient": GRADIENT,
    }
    return names[field]


def type_name(message_type: Any) -> str:
    """Return the ROS name of a message class, for example ``sensor_msgs/msg/Imu``."""
    package, _, _ = message_type.__module__.partition(".")
    return f"{package}/msg/{message_type.__name__}"
