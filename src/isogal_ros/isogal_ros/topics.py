"""The topics of the graph: types, who listens, and with which quality of service.

All types are standard messages, also where none is of what is said. A package of message types of
our own (``isogal_msgs``) has to be generated and compiled with CMake and a C compiler. colcon does
that where ROS 2 is installed, but neither `make demo` nor `pip install`, which have ROS 2 as
wheels and no compiler, could; nor could anybody echo a topic or read a recording without our
package. So what no standard message has a place for is carried by one that describes its own
content:

- A reading of several channels is a PointCloud2 of one point, whose fields have names
  (`isogal_ros.messages.gradiometer`): stamp, frame, and numbers that are found by name. So is one
  with the terms of what a magnetic vehicle adds (`isogal_ros.messages.magnetometer`).
- So is all that a fix says, on ``pmht_mm/information`` (`isogal_ros.messages.fix_information`):
  position, covariance and information arrive together or not at all. ``pmht_mm/fix`` is the
  position once more, for all others; the filter takes it where nobody publishes the information.
- ``nav/covariance`` is a Float64MultiArray, which has neither stamp nor names
  (`isogal_ros.messages.stamped_numbers`): the weaker choice, for a topic of every step."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import (
    AccelWithCovarianceStamped,
    PoseWithCovarianceStamped,
    TwistWithCovarianceStamped,
)
from nav_msgs.msg import Odometry, Path
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import (
    FluidPressure,
    Imu,
    LaserScan,
    MagneticField,
    NavSatFix,
    PointCloud2,
    Range,
)
from std_msgs.msg import Float64, Float64MultiArray

from isogal.errors import InputError, nearest

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # not among ROS 2's wheels: without it there are no transforms
    TFMessage = None

_OF_AID = re.compile(r"([a-z]+)(?:/(\w+))?/\w+")
Message = Any
"""A message of any class, or what it is serialised to: rclpy's classes have no common base."""
INS_SIM = "ins_sim_node"
GRAVIMETER = "gravimeter_node"
PMHT_MM = "pmht_mm_node"
UKF_FUSION = "ukf_fusion_node"
NODES = (INS_SIM, GRAVIMETER, PMHT_MM, UKF_FUSION)


def kind_of(name: str) -> str:
    """Return which of `NODES` a node is: there is a gravimeter_node for each of several fields,
    whose names begin alike."""
    return next((kind for kind in NODES if f"{name}_".startswith(f"{kind}_")), name)


LOSSLESS = QoSProfile(
    history=HistoryPolicy.KEEP_ALL,
    depth=0,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""Of every topic: a slow reader holds the writer up instead of losing messages. A reader that is
best effort holds up nobody."""


LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Of /tf_static, as tf2 has it: who comes late hears it, too."""


@dataclass(frozen=True)
class Topic:
    """One topic of the graph."""

    name: str
    """Relative to the graph's namespace, unless it begins with a slash."""
    type: type[Message]
    """Its class."""
    consumers: tuple[str, ...] = ()
    """Nodes that cannot do without."""
    single: bool = True
    """Whether its messages are those of one publisher, in order of time: of a sensor or a node.
    Otherwise each message says something by itself, whoever sends it and whenever."""


CLOCK = Topic("/clock", Clock, single=False)
IMU = Topic("imu/data_raw", Imu, (UKF_FUSION,))
INS_SOLUTION = Topic("ins/solution", Odometry, (UKF_FUSION,))
"""In place of the IMU, if `ins.source` is solution: what an INS says of itself, in the frame
``map``, with the child ``base_link``."""
INS_SOLUTION_FIX = Topic("ins/solution_fix", NavSatFix, (UKF_FUSION,))
INS_SOLUTION_VELOCITY = Topic("ins/solution_velocity", TwistWithCovarianceStamped, (UKF_FUSION,))
"""Both, of the same stamps, in place of that if `ins.attitude` is false; velocity east, north,
up."""
BAROMETER = Topic("barometer/data_raw", FluidPressure, (UKF_FUSION,))
"""In air or in water, if `height.source` says so."""
VELOCITY = Topic("velocity/data_raw", TwistWithCovarianceStamped, (UKF_FUSION,))
"""In body axes, if `velocity.kind` says which sensor."""
GNSS_FIX = Topic("gnss/fix", NavSatFix, (UKF_FUSION,))
"""Of the antenna, if `gnss.available` says that there is a receiver; STATUS_NO_FIX where it has no
satellites."""
GNSS_VELOCITY = Topic("gnss/velocity", TwistWithCovarianceStamped, (UKF_FUSION,))
"""Of the antenna over ground: east, north, up."""


_AIDS: Mapping[str, Mapping[str, type[Message]]] = {
    "position": {"fix": NavSatFix, "pose": PoseWithCovarianceStamped},
    "barometer": {"data_raw": FluidPressure},
    "velocity": {"data_raw": TwistWithCovarianceStamped},
    "heading": {"data_raw": Imu},
}
"""What sensors beside the IMU publish, by how the names of their topics begin: one that says where
the vehicle is, either a position on the Earth or one in the frame ``map``; of a heading's
orientation only the yaw is used."""
_SPACES = {"height": "barometer"}
"""How they begin where that is not the scenario's word."""


def aid_topics(kind: str, name: str | None = None) -> tuple[Topic, ...]:
    """Return the topics of a sensor of a kind (the `stem` of its section), of which it publishes
    one, by its name in the scenario's list; None = it has none."""
    begin = _SPACES.get(kind, kind)
    space = begin if name is None else f"{begin}/{name}"
    return tuple(Topic(f"{space}/{end}", of, (UKF_FUSION,)) for end, of in _AIDS[begin].items())


def aid_topic(name: str) -> Topic | None:
    """Return the topic of an aid that a scenario names; None = it is of none."""
    found = _OF_AID.fullmatch(name)
    every = aid_topics(found[1], found[2]) if found and found[1] in _AIDS else ()
    return next((topic for topic in every if topic.name == name), None)


TRUTH_FIX = Topic("ground_truth/fix", NavSatFix, (GRAVIMETER,))
TRUTH_ODOM = Topic("ground_truth/odom", Odometry)
INS_FIX = Topic("ins/fix", NavSatFix)
INS_ERROR = Topic("ins/error", Odometry)
"""What the filter finds wrong with the solution of an INS: its difference from nav/odom of the
stamp, on axes east, north, up (frame and child frame ``enu``)."""
GRAVIMETRY = Topic("gravimeter/data_raw", AccelWithCovarianceStamped)
GRAVITY = Topic("gravimeter/gravity", AccelWithCovarianceStamped)
DISTURBANCE = Topic("gravimeter/disturbance", AccelWithCovarianceStamped)
MAGNETIC_FIELD = Topic("magnetometer/data_raw", MagneticField)
"""A vector; its length is the reading, unless there is a scalar instrument, too."""
SCALAR_FIELD = Topic("magnetometer/scalar", MagneticField)
"""Of a scalar instrument next to a vector one: the total field on z."""
ANOMALY = Topic("magnetometer/anomaly", MagneticField)
TERMS = Topic("magnetometer/terms", PointCloud2)
"""In place of the anomaly where the matcher estimates what the vehicle adds: a reading with what
that is made of (`isogal_ros.messages.magnetometer`)."""
CLEARANCE = Topic("altimeter/range", Range)
TERRAIN = Topic("altimeter/terrain", NavSatFix)
GROUND_PRESSURE = Topic("ground/data_raw", FluidPressure)
"""Of the barometer of a vehicle on the ground; may be the same messages as BAROMETER."""
GROUND_HEIGHT = Topic("ground/terrain", NavSatFix)
SOUNDINGS = Topic("altimeter/points", PointCloud2)
"""Of an altimeter with several beams, in place of the range: where they meet the ground."""
FAN = Topic("altimeter/scan", LaserScan)
"""The same as ranges by angle, if `altimeter.message` says so."""
FOOTPRINTS = Topic("altimeter/footprints", PointCloud2)
"""In place of the terrain: its height under each beam (`isogal_ros.messages.altimeter`)."""
FULL_GRADIENT = Topic("gradiometer/data_raw", PointCloud2)
GRADIENT = Topic("gradiometer/gradient", PointCloud2)
FIX = Topic("pmht_mm/fix", NavSatFix, (UKF_FUSION, INS_SIM), single=False)
INFORMATION = Topic("pmht_mm/information", PointCloud2, (UKF_FUSION,), single=False)
"""Before each fix: all of it, as `isogal_ros.messages.fix_information` describes."""
POSE = Topic("pmht_mm/pose", PoseWithCovarianceStamped, single=False)
"""After each fix the same in the frame ``map``, for filters that take poses; none where a batch
gave no fix."""
CANDIDATES = Topic("pmht_mm/candidates", PointCloud2)
INITIAL_POSE = Topic("initialpose", PoseWithCovarianceStamped, single=False)
"""Where the vehicle is, from a user: the filter starts anew there."""
NAV_FIX = Topic("nav/fix", NavSatFix, (GRAVIMETER, PMHT_MM))
NAV_ODOM = Topic("nav/odom", Odometry, (GRAVIMETER, PMHT_MM, INS_SIM))
NAV_COVARIANCE = Topic("nav/covariance", Float64MultiArray, (GRAVIMETER, PMHT_MM))
"""Stamp (s, ns), then the 7 x 7 covariance, row by row, of the errors north, east (m), v_north,
v_east (m/s), attitude about north, east, down (rad), which an Odometry cannot carry."""
NAV_PATH = Topic("nav/path", Path)
PROTECTION_LEVEL = Topic("nav/protection_level", Float64)
"""m, one after each nav/odom, which has the stamp and the covariance that it is computed from."""
SMOOTHED = Topic("nav/smoothed", Odometry)
"""States of the past, each once, as all data up to `fusion.lag` later have them; none without a
lag."""
NAV_AIDS = Topic("nav/aids", DiagnosticArray)
"""Which aids the navigator uses, since when not, and why."""
NAVIGATOR = "navigator"
"""Name of its last status, after those of the aids, which have the names of their topics."""
TF = None if TFMessage is None else Topic("/tf", TFMessage, single=False)
TF_STATIC = None if TFMessage is None else Topic("/tf_static", TFMessage, single=False)
TRANSFORMS = () if TF is None else (TF,)
DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray, (INS_SIM,), single=False)

OF_EVERY_GRAPH = (
    CLOCK, TRUTH_FIX, TRUTH_ODOM, INS_FIX, FIX, INFORMATION, POSE, CANDIDATES, INITIAL_POSE,
    NAV_FIX, NAV_ODOM, NAV_COVARIANCE, NAV_PATH, PROTECTION_LEVEL, NAV_AIDS, *TRANSFORMS,
    DIAGNOSTICS,
)  # fmt: skip
ALL = tuple(one for one in vars().values() if isinstance(one, Topic) and one is not TF_STATIC)
"""Isogal's own; the field of another package brings its topics along
(`isogal_ros.messages.adapter`). Of those of instruments and aids a graph has its own only."""


def topic_named(name: str, of: Iterable[Topic], where: str) -> Topic:
    """Return the topic of a name, among some or of an aid; raises InputError, which begins with
    `where` and names the nearest."""
    known = {topic.name.lstrip("/"): topic for topic in of}
    topic = known.get(name) or aid_topic(name)
    if topic is None:
        raise InputError(f"{where}: the graph has no topic {name!r}{nearest(name, known, 0.4)}")
    return topic


def type_name(message_type: type[Message]) -> str:
    """Return the ROS name of a message class, for example ``sensor_msgs/msg/Imu``."""
    package, _, _ = message_type.__module__.partition(".")
    return f"{package}/msg/{message_type.__name__}"
