"""Own parameters of isogal_mavlink."""

from pydantic import Field

from isogal_ros.mavlink.decoding import ROWS
from isogal_ros.mavlink.encoding import GPS_INPUT, SENT
from isogal_ros.nodes.settings import NodeSettings


class MavlinkSettings(NodeSettings):
    """Own parameters of isogal_mavlink."""

    address: str = Field(
        "127.0.0.1:14550",
        description="host:port that takes MAVLink 2 by UDP, a router or autopilot",
    )
    message: str = Field(
        GPS_INPUT, description=f"what is sent: {', '.join(SENT)}; empty = nothing but heartbeats"
    )
    receive: str = Field(
        "",
        description=(
            "host:port at which messages of the vehicle's sensors are taken, and published on the"
            " graph's topics; empty = none"
        ),
    )
    sensors: tuple[str, ...] = Field(
        ("HIGHRES_IMU", "SCALED_PRESSURE", "GPS_RAW_INT"),
        description=f"messages that are taken, one for each topic; of {', '.join(ROWS)}",
    )
    rate: float = Field(5.0, gt=0.0, le=50.0, description="most messages a second, Hz")
    system_id: int = Field(1, ge=1, le=255, description="of the vehicle")
    component_id: int = Field(
        197, ge=1, le=255, description="of this node; 197 = visual inertial odometry"
    )
    satellites: int = Field(
        10, ge=0, le=255, description="satellites_visible of GPS_INPUT, as the autopilot wants it"
    )
