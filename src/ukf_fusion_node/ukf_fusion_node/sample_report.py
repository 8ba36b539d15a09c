"""What is said of inertial samples: which are missing, what is not known since, whether they point
upwards, and how far an alignment by them is."""

from collections import deque

from isogal.arrays import Array
from isogal.fusion.alignment import Alignment
from isogal.fusion.outage import HELD
from isogal.fusion.sample_stream import SampleStream
from isogal_ros.messages.stamps import SECOND, from_seconds, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import ERROR, OK, WARN
from ukf_fusion_node.sample_checks import GravityDirection
from ukf_fusion_node.settings import UkfFusionSettings

LEARNT = 30
"""Samples after which it is known how fast they come."""
UNRESOLVED = (
    "samples were missing for long: whether there was a sharp manoeuvre is for fixes to say"
)
FAST = 0.75
"""Of the interval that was told: less is no jitter."""


class SampleReport:
    """Tells a node's health.

    Parameters
    ----------
    node : GraphNode
    dt : float
        s between the filter's steps.
    """

    def __init__(self, node: GraphNode[UkfFusionSettings], dt: float) -> None:
        self._health, self._max_gap, self._dt = node.health, node.settings.max_gap, dt
        self._sample = 1.0 / node.scenario.imu.rate
        batch = node.scenario.matcher.batch_length * node.scenario.gravimeter.interval
        self._settles = from_seconds(2.0 * batch)
        self._gap: int | None = None
        """Stamp (ns) of the end of a long gap, or of the last fix since then that did not agree
        with the filter; None = fixes have agreed with it for `_settles` since."""
        self._noted = -SECOND
        """When samples of a fast IMU were missing, ns."""
        self._row: deque[float] = deque(maxlen=LEARNT)
        """The newest intervals between samples that are steps, s."""
        self._gravity = GravityDirection()

    def begin(self) -> None:
        """Begin with another navigator."""
        self._gravity = GravityDirection()
        self._health.concern("aligning", None)

    def gap(self, ns: int, interval: float) -> float:
        """Tell of samples that are missing in an interval (s) since the newest state (its stamp);
        return the time that they leave uncovered, s."""
        samples = round(interval / self._dt) - 1
        self._row.append(interval)
        if samples < 1:
            self._health.state(*self._steps)
            return 0.0
        self._health.count("IMU samples missing", samples)
        self._missing(samples, to_seconds(ns) + interval, interval)
        return interval - self._dt

    @property
    def _steps(self) -> tuple[bytes, str]:
        """Level and text of the node's state where no sample is missing: whether samples, each of
        which is a step of the filter, come much faster than told."""
        mean = sum(self._row) / len(self._row)
        if len(self._row) < LEARNT or mean > FAST * self._dt:
            return OK, "navigating"
        text = f"IMU samples come at {1.0 / mean:.0f} Hz, imu.rate says {1.0 / self._dt:g}"
        return WARN, f"{text}: each is a step of the filter, which takes its time"

    def stream(self, stream: SampleStream, missing: int) -> None:
        """Tell of samples of a fast IMU that are missing since the last step, for a second by the
        stamps, and of a rate that is not as told."""
        if not stream.known:
            return
        if stream.missing or "IMU samples missing" in self._health.figures:
            self._health.figures["IMU samples missing"] = stream.missing
        if missing > 0:
            self._noted = stream.ns
            self._missing(missing, to_seconds(stream.ns), missing * self._sample)
        elif stream.ns - self._noted > SECOND:
            told, rate = 1.0 / self._sample, stream.measured_rate
            text = f"IMU samples come at {rate:.0f} Hz, imu.rate says {told:g}: taken as they come"
            self._health.state(*((OK, "navigating") if stream.as_told else (WARN, text)))

    def _missing(self, samples: int, end: float, lasted: float) -> None:
        """Say that samples are missing before a time, which lasted for another (s)."""
        level = ERROR if lasted > self._max_gap else WARN
        self._health.state(level, f"{samples} IMU samples missing before {end:.3f} s, bridged")

    def step(self, ns: int, force: Array, attitude: Array | None, missing: float) -> None:
        """Tell of what has led to a state.

        Parameters
        ----------
        ns : int
            Stamp of the state.
        force : (3,) array
            Specific force, FRD, m/s².
        attitude : (4,) array, optional
            Quaternion FRD to NED that it belongs to; None = not known yet.
        missing : float
            s without samples before it.
        """
        if attitude is not None:
            said = self._gravity.take(to_seconds(ns), force, attitude)
            self._health.concern("upright", said, ERROR)
        if missing > HELD:
            self._gap = ns

    def alignment(self, alignment: Alignment) -> None:
        """Tell how far an alignment is."""
        share, text = alignment.progress
        self._health.figures |= {
            "aligned": alignment.aligned,
            "aligned, %": round(100.0 * share),
            "heading 1-sigma, mrad": 1e3 * alignment.heading_sigma,
        }
        self._health.concern("aligning", None if alignment.aligned else text)

    def unfit(self, ns: int) -> None:
        """Note that a fix did not agree with the filter, at a stamp of that."""
        if self._gap is not None:
            self._gap = ns

    def unresolved(self, ns: int, undecided: bool) -> None:
        """Tell what is not known of the last long gap, at a stamp; `undecided`: the filter itself
        leaves it open.

        The filter goes on as if the vehicle had made no manoeuvre in it, or one of the size that
        it was set to expect (`isogal.fusion.outage`). A sharper turn is neither, and one heading
        error suits a few fixes as well as another: the first that contradict it may come after
        minutes."""
        if self._gap is not None and ns - self._gap > self._settles and not undecided:
            self._gap = None
        self._health.concern("gap", None if self._gap is None else UNRESOLVED)
