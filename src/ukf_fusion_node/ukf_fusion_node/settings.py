"""Own parameters of ukf_fusion_node."""

import math

from pydantic import Field

from isogal_ros.messages.altimeter import ALTIMETER
from isogal_ros.messages.drivers import Triple
from isogal_ros.messages.frames import BASE
from isogal_ros.messages.gravimeter import PLATFORM
from isogal_ros.messages.magnetometer import MAGNETOMETER
from isogal_ros.nodes.settings import NodeSettings

_FROM_SCENARIO = (math.nan, math.nan, math.nan)


class UkfFusionSettings(NodeSettings):
    """Parameters that are not keys of a scenario. A start of NaN is the scenario's, with its
    initial errors drawn."""

    imu_frame: str = Field(
        BASE, description="frame of imu/data_raw, axes forward, left, up; empty = take any"
    )
    velocity_frame: str = Field(
        BASE, description="frame of velocity/data_raw, axes forward, left, up; empty = take any"
    )
    horizon: float = Field(1200.0, ge=0.0, le=1e8, description="how old a fix may be, s")
    max_gap: float = Field(
        10.0,
        gt=0.0,
        description="longest gap between IMU samples that is bridged without an error, s",
    )
    publish_tf: bool = Field(
        True, description="publish map to odom and odom to base_link on /tf (needs tf2_msgs)"
    )
    publish_map_tf: bool = Field(
        True, description="map to odom among them; false where another filter publishes that"
    )
    sensor_frames: tuple[str, ...] = Field(
        (PLATFORM, ALTIMETER, MAGNETOMETER),
        description="frames published on /tf_static at base_link, unturned; empty where the"
        " vehicle's own description does it",
    )
    odometry_rate: float = Field(
        50.0,
        ge=0.0,
        le=1000.0,
        description="most messages a second on nav/odom and /tf where the IMU is faster than the"
        " filter's steps, Hz; 0 = one a step",
    )
    path_interval: float = Field(
        60.0,
        gt=0.0,
        description="time between poses kept for nav/path, s; doubled whenever there are 200",
    )
    start_time: float = Field(
        0.0,
        description="stamp at which the start is true, s; NaN = when the first IMU sample comes",
    )
    max_acceleration: float = Field(
        30.0, gt=0.0, description="most that the vehicle can do; a sample beyond is dropped, m/s²"
    )
    max_turn_rate: float = Field(
        3.0, gt=0.0, description="most that it can turn; a sample beyond is dropped, rad/s"
    )
    outage_acceleration: float = Field(
        0.1,
        ge=0.0,
        le=100.0,
        description="1-sigma of how a manoeuvre accelerates while IMU samples are missing, m/s²",
    )
    outage_turn_rate: float = Field(
        1e-3, ge=0.0, le=10.0, description="1-sigma of how it turns meanwhile, rad/s"
    )
    manoeuvre_interval: float = Field(
        600.0, gt=0.0, description="mean time between manoeuvres of the vehicle, s"
    )
    start_position: Triple = Field(
        _FROM_SCENARIO, description="first latitude deg, longitude deg, height m; NaN = as drawn"
    )
    start_velocity: Triple = Field(
        _FROM_SCENARIO, description="first velocity north, east, down, m/s; NaN = as drawn"
    )
    start_attitude: Triple = Field(
        _FROM_SCENARIO, description="first roll, pitch, heading, deg; NaN = as drawn"
    )
