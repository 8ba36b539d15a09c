"""The checkpoint of a node: what it goes on from when it is started again in the same run."""

import time
from collections.abc import Collection
from pathlib import Path
from typing import Any

from isogal import checkpoints
from isogal.checkpoints import Omit, Restore, Saved
from isogal.errors import InputError
from isogal_ros.messages.stamps import from_seconds, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import OK, WARN

SYNC_EVERY = 1.0
"""s of wall time between checkpoints that also survive the end of the machine."""


class Checkpoint:
    """Reads and writes the checkpoint of a node, where its parameter `checkpoint` names a folder.

    It belongs to the node's run and sections of the scenario as they were at its start.

    Parameters
    ----------
    node : GraphNode
        Whose; reports what goes wrong.
    omit, restore, packages : optional
        See `isogal.checkpoints`.
    """

    def __init__(
        self,
        node: GraphNode,
        omit: Omit = lambda value: False,
        restore: Restore | None = None,
        packages: Collection[str] = ("isogal",),
    ) -> None:
        folder = node.settings.checkpoint
        self._path = Path(folder) / f"{node.get_name()}.checkpoint" if folder else None
        sections = node.scenario.model_dump(mode="json", include=set(node.sections))
        self._owner = checkpoints.owner(node.get_name(), node.settings.run, sections)
        self._age = from_seconds(node.settings.checkpoint_age)
        self._node, self._omit, self._restore = node, omit, restore
        self._packages = packages
        self._synced = 0.0
        self.reason = "no checkpoint"
        """Why there is none to go on from."""
        self.found = self._read()
        """What an earlier process of this run has left; None = nothing."""

    def _read(self) -> Saved | None:
        if self._path is None:
            return None
        try:
            return checkpoints.load(self._path, self._owner, self._packages, self._restore)
        except InputError as error:
            self.reason = str(error)
            self._node.log(WARN, f"checkpoint refused: {error}")
            return None

    def take(self, ns: int) -> Saved | None:
        """Return what was found if it is true for data that go on at a stamp, once; else `reason`
        says why not."""
        found, self.found = self.found, None
        if found is None:
            return None
        age = ns - found.time
        if 0 <= age <= self._age:
            text = f"goes on from the checkpoint of {to_seconds(found.time):.0f} s"
            self._node.log(OK, f"{text}, {to_seconds(age):.1f} s before the data")
            return found
        why = "too old" if age > 0 else "of a later time"
        self.reason = f"the checkpoint of {to_seconds(found.time):.3f} s is {why}"
        self._node.log(WARN, f"checkpoint refused: {self.reason}")
        return None

    @property
    def is_kept(self) -> bool:
        """Whether anything is written."""
        return self._path is not None

    def save(self, ns: int, content: Any) -> None:
        """Write what is true at a stamp; a failure is reported and changes nothing else."""
        if self._path is None:
            return
        sync = time.monotonic() - self._synced > SYNC_EVERY
        try:
            checkpoints.save(self._path, self._owner, Saved(ns, content), self._omit, sync)
        except (InputError, TypeError) as error:
            self._node.health.drop("checkpoint", f"not written: {error}")
            return
        if sync:
            self._synced = time.monotonic()

    def forget(self) -> None:
        """Delete what is on the disk."""
        self.found = None
        if self._path is not None:
            self._path.unlink(missing_ok=True)
