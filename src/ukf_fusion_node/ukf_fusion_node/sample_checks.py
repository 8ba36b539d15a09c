"""What is asked of an inertial sample before the filter takes it."""

from isogal.arrays import Array
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import ERROR
from isogal_ros.topics import Topic
from ukf_fusion_node.navigation import Navigation
from ukf_fusion_node.watch import Leaps, LoneSamples, StuckError, Watch


class SampleChecks:
    """Whether samples can be true; takes back those that were not.

    Parameters
    ----------
    node : GraphNode
        Its settings say what the vehicle can do; its health is told.
    navigation : Navigation
    topic : Topic
        Of the samples.
    """

    def __init__(self, node: GraphNode, navigation: Navigation, topic: Topic) -> None:
        self.leaps = Leaps(from_seconds(node.settings.max_gap))
        limits = node.settings.max_acceleration, node.settings.max_turn_rate
        self._watch = Watch(*limits, node.monotonic, navigation.noisy)
        self._lone = LoneSamples()
        self._health, self._navigation, self._topic = node.health, navigation, topic
        node.watch("silent", lambda: self._watch.silent, ERROR)

    def take(self, ns: int, force: Array, rate: Array, stepped: bool) -> None:
        """Check a sample of a stamp (ns); `stepped`: its interval is known otherwise.

        Raises
        ------
        BadMessageError
            It cannot be true.
        """
        try:
            self._watch.take(force, rate)
        except StuckError as error:
            self._navigation.back(error.samples)
            raise
        self._health.concern("stuck", self._watch.stuck)
        untrue = self._lone.take(force, rate)
        if untrue and self._navigation.back(1):
            self._health.drop(self._topic.name, untrue)
        if self._navigation.navigator is not None and not stepped:
            self.leaps.check(ns, self._navigation.ns)
