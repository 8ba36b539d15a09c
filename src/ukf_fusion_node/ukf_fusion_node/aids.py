"""Readings of sensors beside the IMU: when they are due, and what the filter does with them."""

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from std_srvs.srv import SetBool

from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import reading_of
from isogal.fusion.state import FilterState
from isogal_ros import topics
from isogal_ros.messages.aids import Aid, Reading, each_aid, read_aid
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import map_frame
from isogal_ros.messages.stamps import from_seconds, set_stamp, to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import OK, status
from isogal_ros.topics import Message, Topic
from ukf_fusion_node.measuring import Measured
from ukf_fusion_node.settings import UkfFusionSettings
from ukf_fusion_node.stamp_queue import StampQueue

NO_FIX = "the receiver has no fix"
NO_NAVIGATOR = "there was no navigator yet"
SWITCHED_OFF = "switched off by the service toggle"
SIGMA = "horizontal 1-sigma"


@dataclass
class _Source:
    """Readings of one topic that wait for the navigator to reach their stamps."""

    aid: Aid
    publishers: Callable[[], int]
    measured: Measured
    waiting: StampQueue[Reading | None]
    is_on: bool = True
    """Whether nobody has switched it off."""
    newest: int = -1
    """Stamp of the newest reading; -1 = none yet."""

    def is_due(self, ns: int, now: int, begin: int) -> bool:
        """Whether a reading of a stamp up to `ns` is still to come; it is waited for as long as
        another one would take, by the newest stamp `now` that has come."""
        interval, delay = map(from_seconds, (self.aid.settings.interval, self.aid.settings.delay))
        due = (begin if self.newest < 0 else self.newest) + interval + delay
        return due <= ns and now < due + interval and self.publishers() > 0


class Aids:
    """Subscribes to the sensors that the scenario has.

    A sample of the IMU waits for the readings that are due at its stamp, so that what the filter
    publishes does not depend on which message arrives first.

    Parameters
    ----------
    node : GraphNode
        Its scenario says which sensors there are; its health is told.
    advance : callable
        Called when a reading has come.
    """

    def __init__(self, node: GraphNode[UkfFusionSettings], advance: Callable[[], None]) -> None:
        self._scenario, self._advance = node.scenario, advance
        self._frames = map_frame(node.scenario), node.settings.velocity_frame
        self._sources: dict[str, _Source] = {}
        self._first = sys.maxsize
        """Stamp of the first IMU sample."""
        self._each = [(aid.topic, *aid.instead) for aid in each_aid(node.scenario)]
        for aid in each_aid(node.scenario):
            for topic in (aid.topic, *aid.instead):
                self._add(node, topic, aid)
        self._publisher, self._message = node.advertise(topics.NAV_AIDS), topics.NAV_AIDS.type()
        self._period = from_seconds(node.settings.diagnostics_period)
        self._space = f"{node.get_namespace().strip('/')}/".lstrip("/")
        self._said: list[str] = []
        """Which aids were said to be in use, at a stamp (ns)."""
        self._said_at = -1

    def _add(self, node: GraphNode[UkfFusionSettings], topic: Topic, aid: Aid) -> None:
        """Listen to a topic of an aid, and offer the service toggle/<topic>, which says whether it
        is used."""

        def take(message: Message) -> None:
            ns = to_ns(message.header.stamp)
            try:
                source.waiting.add(ns, read_aid(message, aid.settings, *self._frames))
            except BadMessageError as error:
                source.measured.absent(str(error))
                raise
            source.newest = max(source.newest, ns)
            self._advance()

        def toggle(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            source.is_on, response.success = request.data, True
            response.message = f"{topic.name} is {'used' if request.data else 'not used'}"
            return response

        publishers = node.listen(topic, take).get_publisher_count
        measured = Measured(topic.name, node.health, aid.settings.interval)
        waiting = StampQueue[Reading | None](from_seconds(node.settings.max_gap))
        source = self._sources[topic.name] = _Source(aid, publishers, measured, waiting)
        node.create_service(SetBool, f"toggle/{topic.name}", toggle)

    def are_due(self, ns: int, now: int) -> bool:
        """Whether readings of stamps up to `ns`, that of the first of the IMU samples that wait,
        are still to come; `now` is the stamp of the last."""
        if not self._sources:
            return False
        self._first = min(ns, self._first)
        begin = self._first - from_seconds(1.0 / self._scenario.imu.rate)
        return any(source.is_due(ns, now, begin) for source in self._sources.values())

    def apply(self, navigator: InertialNavigator | None, ns: int) -> None:
        """Apply the readings up to a stamp, which the navigator has reached. Those that are ahead
        of it by more than a gap in its samples may be are of another clock: it refuses them."""
        if navigator is None:
            return
        if self._sources:
            self._tell(ns, navigator)
        for source in self._sources.values():
            for stamp, reading in source.waiting.due(ns):
                if stamp > ns:
                    source.newest = ns
                self._use(source, stamp, reading, navigator)

    def _use(
        self, source: _Source, ns: int, reading: Reading | None, navigator: InertialNavigator
    ) -> None:
        """Measure with a reading of a stamp, or say why not."""
        if not source.is_on:
            source.measured.absent(SWITCHED_OFF)
            return
        measurement, time = None, to_seconds(ns)
        if reading is not None:
            value, stated = reading
            rate = navigator.sample_at(time)[1]
            measurement = reading_of(source.aid.settings, value, self._scenario, rate, stated)
        if measurement is None:
            source.measured.absent(NO_FIX)
        else:
            source.measured.take(ns, navigator.measure(time, measurement))

    def _tell(self, ns: int, navigator: InertialNavigator) -> None:
        """Publish the state of each aid on nav/aids at a stamp (ns), once a period and when one is
        lost or comes back. Of one that may come on several topics nothing is said of those on
        which it never came, but of the first where it has not come at all."""
        found = {name: source.measured for name, source in self._sources.items()}
        in_use = [name for name, one in found.items() if one.in_use(ns)]
        if in_use == self._said and 0 <= ns - self._said_at < self._period:
            return
        self._said, self._said_at = in_use, ns
        set_stamp(self._message.header.stamp, ns)
        self._message.status = [
            found[one.name].status(self._space + one.name, one.name in in_use)
            for either in self._each
            for one in [one for one in either if found[one.name].has_come] or either[:1]
        ]
        text, figures = "no satellites are used", {SIGMA: _sigma(navigator.state)}
        if (without := navigator.without_satellites) is not None:
            sigma = _sigma(without.after.merged)
            text = f"without satellites since {without.since:.0f} s it would be {sigma:.0f} m"
            figures |= {f"{SIGMA} without satellites": sigma, "without since": without.since}
        self._message.status.append(status(self._space + topics.NAVIGATOR, OK, text, figures))
        self._publisher.publish(self._message)

    def pass_by(self, ns: int) -> None:
        """Let the readings up to a stamp go, at which there is no navigator yet."""
        for source in self._sources.values():
            for _ in source.waiting.due(ns):
                source.measured.absent(NO_NAVIGATOR)

    def begin_anew(self) -> None:
        """Forget what has come: time may begin anew."""
        self._first = sys.maxsize
        for source in self._sources.values():
            source.waiting.forget()
            source.newest = source.measured.newest = -1


def _sigma(state: FilterState) -> float:
    """Return the 1-sigma of the position along the worst horizontal direction, m."""
    return float(np.sqrt(np.linalg.eigvalsh(state.covariance[:2, :2])[-1]))
