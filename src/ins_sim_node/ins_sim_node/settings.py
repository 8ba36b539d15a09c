"""Own parameters of ins_sim_node."""

from pydantic import Field

from isogal_ros.nodes.settings import NodeSettings


class InsSimSettings(NodeSettings):
    """How the simulation keeps time."""

    rate: float = Field(
        1.0,
        ge=0.0,
        le=10000.0,
        description="simulated seconds per second; 0 = as fast as the graph can",
    )
    lock_step: bool = Field(
        True,
        description=(
            "wait at each step until the graph has answered it, so that no message is lost"
        ),
    )
    ahead: int = Field(
        10,
        ge=1,
        le=1000,
        description=(
            "in lock-step at rate 0: IMU samples that are published at once where no reading comes"
            " until the last of them"
        ),
    )
    start_timeout: float = Field(
        300.0, gt=0.0, description="s to wait for the other nodes before the first step"
    )
    reply_timeout: float = Field(120.0, gt=0.0, description="s to wait for the answers to a step")
    exit_at_end: bool = Field(True, description="end the process after the last step")
