"""What the matcher's node goes on from when it is started again: scans, the matcher's memory and
the stamp of the last scan of each field. The maps that a memory refers to are not saved: they are
parts of the node's own map."""

from typing import Any

import numpy as np

from isogal.maps.channels import ChannelMap, RouteMap
from isogal.maps.field_map import FieldMap
from isogal.maps.tiled_map import TiledMap
from isogal.matching.interfaces import Batch, Matcher
from isogal.matching.scans import Collected
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.checkpoint import Checkpoint


def checkpoint_of(node: GraphNode, field_map: RouteMap, matcher: Matcher) -> Checkpoint:
    """Return the checkpoint of a node with a map; the matcher's package may have dataclasses in
    its memory."""

    def map_of(known: Any) -> Any:
        batch = known["batch"]
        if not isinstance(batch, Batch):
            raise TypeError("a map of no batch")
        return field_map.near(batch.latitude, batch.longitude)

    packages = {"isogal", type(matcher).__module__.partition(".")[0]}
    maps = FieldMap | ChannelMap | TiledMap
    return Checkpoint(node, lambda value: isinstance(value, maps), map_of, packages)


def are_scans(collected: tuple[Collected, ...]) -> bool:
    """Whether what a checkpoint has of each field are scans at places."""
    return all(
        isinstance(one, Collected)
        and all(
            np.isfinite([scan.time, scan.latitude, scan.longitude]).all() for scan in one.scans
        )
        for one in collected
    )
