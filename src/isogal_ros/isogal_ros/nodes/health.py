"""What a node reports of itself on /diagnostics."""

import math
import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from isogal_ros.messages.stamps import set_stamp

if TYPE_CHECKING:
    from isogal_ros.nodes.publishing import Publishing

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

Figure = bool | int | float | str | None
STARTING = "starting"
"""What a node says before anything else."""


class Health:
    """State, figures and counts of dropped messages of one node, published on change and, as the
    node's timer has it (`renew`), once a period.

    What it says is logged as well, where it is another than before but for its numbers.

    A drop raises the level to WARN until a whole period has passed without one; the counts stay.

    Parameters
    ----------
    name : str
        Of the status.
    publisher : Publishing
        Of /diagnostics.
    log : callable
        Called with level and text of what is new.
    """

    def __init__(
        self, name: str, publisher: "Publishing", log: Callable[[bytes, str], None]
    ) -> None:
        self.name, self._publisher, self._log = name, publisher, log
        self.figures: dict[str, Figure] = {}
        """Shown as key-value pairs."""
        self.dropped: dict[str, int] = {}
        """Number of dropped messages by topic."""
        self.why: dict[str, str] = {}
        """Why the last of them was dropped."""
        self.stamp = 0
        """Time of the data, ns."""
        self._level, self.message = OK, STARTING
        """What the node says of its own state."""
        self._reasons: dict[str, str] = {}
        self._concerns: dict[str, tuple[bytes, str]] = {}
        self._kinds: dict[tuple[str, str], int] = {}

    def state(self, level: bytes, message: str) -> None:
        """Set the node's own state; a change is published at once."""
        if (level, message) != (self._level, self.message):
            if level != OK and without_numbers(message) != without_numbers(self.message):
                self._log(level, message)
            elif level == OK and self._level != OK:
                self._log(level, f"{message} again")
            self._level, self.message = level, message
            self.publish()

    def concern(self, name: str, text: str | None, level: bytes = WARN) -> None:
        """Set what is wrong apart from the node's own state, until it is cleared (None)."""
        known = self._concerns.get(name)
        if text is None:
            if known is not None:
                del self._concerns[name]
                self._log(OK, f"no longer {name}")
                self.publish()
        else:
            self._concerns[name] = level, text
            if known is None:
                self._log(level, text)
                self.publish()

    def count(self, name: str, more: int = 1) -> None:
        """Count up a figure."""
        self.figures[name] = int(self.figures.get(name) or 0) + more

    def drop(self, topic: str, reason: str) -> None:
        """Count a message that was not used; a new topic or reason is published at once."""
        self.dropped[topic] = self.dropped.get(topic, 0) + 1
        known = self._reasons.get(topic)
        self._reasons[topic] = self.why[topic] = reason
        if known is None or without_numbers(known) != without_numbers(reason):
            self._say_drop(topic, reason)
            self.publish()

    def _say_drop(self, topic: str, reason: str) -> None:
        """Log the first drop of its kind, then each time there are ten times as many."""
        kind = topic, without_numbers(reason)
        count = self._kinds[kind] = self._kinds.get(kind, 0) + 1
        if math.log10(count).is_integer():
            times = f" ({count} times)" if count > 1 else ""
            self._log(WARN, f"{topic}: message dropped: {reason}{times}")

    def renew(self) -> None:
        """Publish because a period has passed."""
        self.publish()
        self._reasons.clear()

    def publish(self, *more: DiagnosticStatus) -> None:
        """Publish now, together with other statuses."""
        level, message = self._level, self.message
        for of_concern, text in self._concerns.values():
            level = max(level, of_concern)
            message += f"; {text}"
        if self._reasons:
            level = max(level, WARN)
            message += "; dropped " + ", ".join(
                f"{topic}: {reason}" for topic, reason in self._reasons.items()
            )
        dropped = {f"dropped {topic}": count for topic, count in self.dropped.items()}
        own = status(self.name, level, message, {**self.figures, **dropped})
        array = DiagnosticArray(status=[own, *more])
        set_stamp(array.header.stamp, self.stamp)
        self._publisher.publish(array)


def status(
    name: str, level: bytes, message: str, figures: Mapping[str, Figure]
) -> DiagnosticStatus:
    """Return one diagnostic status.

    Parameters
    ----------
    name, message : str
        What it is about, and how that is.
    level : bytes
        Of DiagnosticStatus.
    figures : mapping
        Shown as key-value pairs.
    """
    values = [
        KeyValue(key=key, value=f"{value:.9g}" if isinstance(value, float) else str(value))
        for key, value in figures.items()
    ]
    return DiagnosticStatus(
        level=level, name=name, message=message, hardware_id="isogal", values=values
    )


def figures_of(item: DiagnosticStatus) -> dict[str, str]:
    """Return the key-value pairs of a status."""
    return {pair.key: pair.value for pair in item.values}


def without_numbers(text: str) -> str:
    """Return a text without its numbers: those that differ in numbers only are the same."""
    return re.sub(r"[0-9.]+", "", text)
