"""What the matcher's node goes on from when it is started again: scans and memory."""

from typing import Any

import numpy as np

from isogal.maps.channels import ChannelMap
from isogal.maps.field_map import FieldMap
from isogal.maps.tiled_map import TiledMap
from isogal.matching.interfaces import Batch, Matcher
from isogal.matching.joint_batches import JointBatches
from isogal.matching.scans import Collected
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.checkpoint import Checkpoint


class Survival:
    """The checkpoint of scans, the matcher's memory and the stamp of the last scan.

    The maps that a memory refers to are not saved: they are parts of the node's own map.

    Parameters
    ----------
    node : GraphNode
    field_map : map
        The node's.
    matcher : Matcher
        Its package may have dataclasses in its memory.
    """

    def __init__(self, node: GraphNode, field_map: Any, matcher: Matcher) -> None:
        self._map = field_map
        packages = {"isogal", type(matcher).__module__.partition(".")[0]}
        self._checkpoint = Checkpoint(
            node,
            lambda value: isinstance(value, FieldMap | ChannelMap | TiledMap),
            self._map_of,
            packages,
        )

    def _map_of(self, known: Any) -> Any:
        batch = known["batch"]
        if not isinstance(batch, Batch):
            raise TypeError("a map of no batch")
        return self._map.near(batch.latitude, batch.longitude)

    def take(self, ns: int) -> tuple[tuple[Collected, ...], Any, tuple[int, ...]] | None:
        """Return scans, memory and the last scan's stamp of each field, where there are any that a
        scan of a stamp may follow."""
        saved = self._checkpoint.take(ns)
        if saved is None:
            return None
        collected, memory, last = saved.content
        if any(
            not isinstance(one, Collected)
            or any(
                not np.isfinite([scan.time, scan.latitude, scan.longitude]).all()
                for scan in one.scans
            )
            for one in collected
        ):
            return None
        return collected, memory, last

    def keep(self, ns: int, batches: JointBatches, memory: Any, last: tuple[int, ...]) -> None:
        """Write what is true after the scan of a stamp."""
        if self._checkpoint.is_kept:
            self._checkpoint.save(ns, (batches.collected, memory, last))

    def forget(self) -> None:
        """Delete it."""
        self._checkpoint.forget()
