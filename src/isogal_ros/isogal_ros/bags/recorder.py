"""The recorder: every topic of the graph into one bag."""

import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import ClassVar

from pydantic import Field
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.qos import HistoryPolicy

from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.metadata import qos_entries
from isogal_ros.bags.writer import BagWriter, scenario_text
from isogal_ros.messages.adapter import topics_in_use
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.ins_solution import inertial_topics
from isogal_ros.messages.prepared import peek_ns
from isogal_ros.messages.stamps import SECOND
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import OK
from isogal_ros.nodes.settings import NodeSettings
from isogal_ros.nodes.spin import main_of
from isogal_ros.nodes.stuck import TimeJumps
from isogal_ros.topics import Topic

RECORDER = "isogal_recorder"
JUMP = 60 * SECOND
"""ns between two stamps, beyond which time has jumped, or a stamp is wrong."""


class RecorderSettings(NodeSettings):
    """Own parameters of isogal_recorder."""

    bag: str = Field("bag", min_length=1, description="folder of the bag")
    replace: bool = Field(False, description="delete an earlier bag in that folder")
    resume: bool = Field(
        False, description="go on in a further file where there is a bag of this run already"
    )
    compress: bool = Field(True, description="zstd")
    disk_warning: float = Field(
        1.0, ge=0.0, description="free space on the bag's disk below which it warns, GB"
    )


class RecorderNode(GraphNode[RecorderSettings]):
    """Writes messages as they come, serialised; the bag also keeps the scenario.

    Log time is that of the stamps, as with ``ros2 bag record --use-sim-time``, and never earlier
    than the message's own, unless that is far from all others: to where time jumps is for the
    inertial data to say, not for a clock of another simulation or a single wrong stamp, after
    which all messages would have the same time. The simulator may publish some steps at once, and
    its clock is then ahead of the navigator: what that publishes has the time of its newest stamp.
    Publish time is the wall clock at reception, as the events executor does not tell when a
    serialised message was sent."""

    sections: ClassVar[Sequence[str]] = tuple(Scenario.model_fields)
    settings_model: ClassVar[type[NodeSettings]] = RecorderSettings

    def setup(self) -> None:
        """Open the bag and subscribe to everything."""
        texts = {
            "scenario": scenario_text(self.scenario),
            "run": str(self.settings.run),
            "entrance": self._entrance.text(),
            "namespace": self.get_namespace().strip("/"),
        }
        own = self.settings
        try:
            self.writer = BagWriter(Path(own.bag), texts, own.replace, own.compress, own.resume)
        except OSError as error:
            raise InputError(f"bag: {own.bag}: cannot be written: {error.strerror}") from None
        self.get_logger().info(f"records into {self.writer.path}")
        self._now = self._navigated = 0
        """The time, and that of the navigator, ns."""
        self._inertial, self._has_inertial = inertial_topics(self.scenario.ins), False
        self._jumps = TimeJumps(JUMP, back=True)
        self.watch("short of disk space", self._disk)
        for topic in topics_in_use(self.scenario):
            self._record(topic)

    def _record(self, topic: Topic) -> None:
        is_clock, by_navigator = topic is topics.CLOCK, topic.name.startswith("nav/")
        is_inertial = topic in self._inertial

        def write(data: bytes) -> None:
            if not self.active or self.finished:
                return
            if is_clock or hasattr(listening.type, "header"):
                stamp = peek_ns(data)
                self._go_on(is_inertial, stamp)
                if by_navigator:
                    self._navigated = max(self._navigated, min(stamp, self._now))
            try:
                if not self.writer.knows(name):
                    self._add(name, listening.type)
                now = self._navigated if by_navigator else self._now
                self.writer.write(name, data, now, time.time_ns())
            except OSError as error:
                self._failed_to_write(error)

        listening = self.hear(topic, write)
        name = listening.topic_name

    def _go_on(self, is_inertial: bool, stamp: int) -> None:
        """Take the stamp (ns) of a message, which may be one of inertial data, for the time, if
        that is what it is."""
        self._has_inertial |= is_inertial
        if self._now and (is_inertial or not self._has_inertial):
            try:
                self._jumps.check(stamp, self._now)
            except BadMessageError:
                return
        elif self._now and abs(stamp - self._now) > JUMP:
            return
        begins_anew = stamp < self._now - JUMP
        self._now = stamp if begins_anew else max(self._now, stamp)
        self._navigated = min(self._navigated, self._now)

    def _add(self, name: str, kind: type[topics.Message]) -> None:
        """Make a topic known to the bag with what its publishers offer; the history is not part of
        discovery, so it is the graph's own."""
        offers = self.get_publishers_info_by_topic(name)
        profiles = [offer.qos_profile for offer in offers] or [topics.LOSSLESS]
        for profile in profiles:
            if profile.history == HistoryPolicy.UNKNOWN:
                profile.history, profile.depth = topics.LOSSLESS.history, topics.LOSSLESS.depth
        entries = qos_entries(profiles)
        type_hash = str(offers[0].topic_type_hash) if offers else ""
        self.writer.add_topic(name, topics.type_name(kind), entries, type_hash)

    def _failed_to_write(self, error: OSError) -> None:
        """End; what is in the file stays."""
        if not self.exit_code:
            self.fail(
                f"{self.writer.path}: cannot be written: {error.strerror or error}; the recording"
                " ends here, and can be read"
            )

    def _disk(self) -> str | None:
        """Say when the disk is nearly full."""
        try:
            free = shutil.disk_usage(self.writer.folder).free / 1e9
        except OSError as error:
            return f"{self.writer.folder}: {error.strerror}"
        if free >= self.settings.disk_warning:
            return None
        return (
            f"the disk of {self.writer.folder} has {free:.3g} GB left (disk_warning:"
            f" {self.settings.disk_warning:g} GB)"
        )

    def _beat(self) -> None:
        if self.active and not self.finished:
            self._bring_out(self.writer.flush)
            self.health.figures |= {"messages": self.writer.messages, "bag": self.settings.bag}
            if not self.finished:
                self.health.state(OK, "recording")
        super()._beat()

    def received(self) -> int | None:
        """Count the messages written."""
        return self.writer.messages if self.configured else None

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Finish the bag."""
        self._bring_out(self.writer.close)
        return super().on_cleanup(state)

    def close(self, timeout: float = 1.0) -> None:
        """Destroy the node and finish the bag."""
        if self.configured:
            self._bring_out(self.writer.close)
            self.get_logger().info(f"{self.writer.messages} messages recorded")
        super().close(timeout)

    def _bring_out(self, write: Callable[[], None]) -> None:
        """Bring to the disk what is not there."""
        try:
            write()
        except OSError as error:
            self._failed_to_write(error)


main = main_of(RecorderNode, RECORDER)
"""Entry point of the console script."""


if __name__ == "__main__":
    main()
