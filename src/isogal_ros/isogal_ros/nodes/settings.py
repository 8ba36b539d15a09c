"""Parameters that every node has besides the sections of the scenario."""

from pydantic import BaseModel, ConfigDict, Field

from isogal_ros import topics
from isogal_ros.messages.drivers import Driver
from isogal_ros.messages.frames import BASE, MAP, ODOM, FrameNames


class NodeSettings(BaseModel):
    """Parameters that every node of the graph has besides its sections of the scenario."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    autostart: bool = Field(
        True, description="activate the node when it is made; false: by its lifecycle services"
    )
    run: int = Field(0, ge=0, description="index of the run: which random numbers of the seed")
    recorders: int = Field(
        0, ge=0, le=100, description="recorders that must listen before the node is ready"
    )
    peers: tuple[str, ...] = Field(
        topics.NODES, description="nodes of the graph that must listen before the node is ready"
    )
    closing_time: float = Field(
        2.0,
        gt=0.0,
        le=60.0,
        description="s of wall time in which the node ends when it is asked to",
    )
    checkpoint: str = Field(
        "",
        description=(
            "folder of checkpoints, from which a node that is started again goes on; empty = none"
        ),
    )
    checkpoint_age: float = Field(
        3600.0,
        gt=0.0,
        description="how much older than the data a checkpoint, or a filter's state, may be, s",
    )
    diagnostics_period: float = Field(1.0, gt=0.0, description="wall time between diagnostics, s")
    drivers: dict[str, Driver] = Field(
        default_factory=dict,
        description=(
            "how messages of sensors come, by topic, where that is not as the graph has them:"
            " {TOPIC: {frame: of its messages, rotation: [roll, pitch, yaw] deg, translation:"
            " [x, y, z] m, from_tf: whether these are those of /tf_static, unit: mGal}}"
        ),
    )
    tf_timeout: float = Field(
        10.0, gt=0.0, description="how long transforms that `drivers` asks for are waited for, s"
    )
    map_frame: str = Field(MAP, min_length=1, description="what the frame map is called outside")
    odom_frame: str = Field(ODOM, min_length=1, description="what the frame odom is called")
    base_frame: str = Field(BASE, min_length=1, description="what the frame base_link is called")
    tf_prefix: str = Field(
        "", description="put before the names of all frames, with a slash between"
    )

    @property
    def frame_names(self) -> FrameNames:
        """What frames are called outside."""
        prefix = self.tf_prefix.strip("/")
        return FrameNames(self.map_frame, self.odom_frame, self.base_frame, prefix)
