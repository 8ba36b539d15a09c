"""What is wrong with IMU samples that could each be right, and what is said of those that are
missing."""

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from isogal.arrays import Array, Booleans
from isogal.fusion.alignment import Alignment
from isogal.fusion.outage import HELD
from isogal.fusion.sample_stream import SampleStream
from isogal.inertial.rotations import rotate
from isogal_ros.messages.stamps import SECOND, from_seconds, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import ERROR, OK, WARN
from isogal_ros.nodes.stuck import Repetitions
from ukf_fusion_node.settings import UkfFusionSettings

AXES = (
    "accelerometer x", "accelerometer y", "accelerometer z",
    "gyroscope x", "gyroscope y", "gyroscope z",
)  # fmt: skip
STUCK = 60
"""Samples of exactly the same value after which an axis counts as stuck: noise never repeats."""
LEARNT = 60
"""Changes of an axis after which it is known how long it rests: of one that counts in coarse steps
the same value may come several times."""
LEAST = 5
"""Repetitions that are taken for noise of coarse steps at any rate (`stuck.Repetitions`)."""
SILENT = 10.0
"""s of wall time without a sample that are an error."""
GRAVITY = 9.81
REMEMBERED = 60
"""Changes from sample to sample that say how much the vehicle moves."""
BEYOND = 20.0
"""How many times the largest of them a sample has to be away. Of noise and waves the largest
change of one minute differs from that of another by a factor of two or three."""
FELT = 2.0
"""How many times the largest of them says that the other kind of sensor has felt it, too."""
BACK = 0.25
"""Of its distance, by which the next sample may miss the one before: more is a manoeuvre."""
LEAST_DISTANCE = 1e-2, 1e-3
"""m/s², rad/s: less, for one sample, does no harm."""
SENSORS = ("specific force", "m/s²"), ("angular rate", "rad/s")

_Pair = tuple[float, float]
"""Of specific force and angular rate, m/s² and rad/s."""


class Untrue(NamedTuple):
    """What a sample has shown."""

    before: int
    """How many samples before it were taken for true and are not."""
    why: str
    refused: bool
    """Whether it is not true itself."""


class SampleMonitor:
    """Looks at samples one after the other.

    A sample that differs from both its neighbours by much more than samples have differed for a
    while is a fault, not a motion, unless accelerometers and gyroscopes feel it at once; that
    shows when the next one comes.

    Parameters
    ----------
    acceleration, turn_rate : float
        Most that the vehicle can do, m/s² and rad/s; a sample beyond is a spike.
    clock : callable
        Wall time, s.
    noisy : (6,) array
        Which axes have noise, so that a value does not come twice.
    """

    def __init__(
        self,
        acceleration: float,
        turn_rate: float,
        clock: Callable[[], float],
        noisy: Booleans,
    ) -> None:
        self._acceleration, self._turn_rate, self._clock = acceleration, turn_rate, clock
        self._axes = {name: Repetitions(LEAST, LEARNT) for name in AXES}
        self._noisy = [name for name, is_noisy in zip(AXES, noisy, strict=True) if is_noisy]
        self._heard: float | None = None
        self._samples: deque[tuple[list[float], list[float]]] = deque(maxlen=2)
        self._changes: deque[_Pair] = deque(maxlen=REMEMBERED)

    def take(self, force: Array, rate: Array) -> Untrue | None:
        """Look at a sample (3,), (3,), m/s² and rad/s; return what is not true (None = all may
        be)."""
        self._heard = self._clock()
        sample = force.tolist(), rate.tolist()
        for axis, value in zip(self._axes.values(), sample[0] + sample[1], strict=True):
            axis.take(value)
        if (stuck := self._refuse_stuck()) is not None:
            return stuck
        beyond, turn = abs(math.hypot(*sample[0]) - GRAVITY), math.hypot(*sample[1])
        if beyond > self._acceleration:
            limit = f"max_acceleration is {self._acceleration:g} m/s²"
            return Untrue(0, f"specific force {beyond:.0f} m/s² beyond gravity; {limit}", True)
        if turn > self._turn_rate:
            limit = f"max_turn_rate is {self._turn_rate:g} rad/s"
            return Untrue(0, f"angular rate {turn:.2g} rad/s; {limit}", True)
        return self._compare(sample)

    def _refuse_stuck(self) -> Untrue | None:
        if not any(axis.count for axis in self._axes.values()):  # as of nearly all samples
            return None
        found = [name for name in self._noisy if self._axes[name].beyond is not None]
        if not found:
            return None
        axes = [self._axes[name] for name in found]
        before = 0 if any(axis.beyond for axis in axes) else max(axis.count for axis in axes)
        text = f"{', '.join(found)} stuck for {axes[0].count + 1} samples: taken as missing"
        return Untrue(before, text, True)

    def _compare(self, new: tuple[list[float], list[float]]) -> Untrue | None:
        """Compare the sample before with both its neighbours; a spike is forgotten."""
        if len(self._samples) < 2:
            self._samples.append(new)
            return None
        before, last = self._samples
        away = math.dist(last[0], before[0]), math.dist(last[1], before[1])
        missed = math.dist(new[0], before[0]), math.dist(new[1], before[1])
        if (which := self._spike(away, missed)) is None:
            self._changes.append(away)
            self._samples.append(new)
            return None
        self._samples[-1] = new
        name, unit = SENSORS[which]
        return Untrue(1, f"{name} of one sample {away[which]:.2g} {unit} out of line", False)

    def _spike(self, away: _Pair, missed: _Pair) -> int | None:
        """Return which of `SENSORS` alone has felt something of which the next sample knows
        nothing; None = neither."""
        both = range(2)
        if len(self._changes) < REMEMBERED or all(away[k] <= LEAST_DISTANCE[k] for k in both):
            return None
        usual = [max(change[k] for change in self._changes) for k in both]
        felt = [k for k in both if away[k] > FELT * usual[k]]
        beyond = (max(BEYOND * usual[k], LEAST_DISTANCE[k]) for k in both)
        found = [k for k, far in enumerate(beyond) if away[k] > far and missed[k] < BACK * away[k]]
        return found[0] if found and len(felt) == 1 else None

    @property
    def stuck(self) -> str | None:
        """Which axes have not moved for long; None = all have."""
        names = [name for name, axis in self._axes.items() if axis.count >= STUCK]
        return f"stuck: {', '.join(names)}" if names else None

    @property
    def silent(self) -> str | None:
        """That there has been no sample for long; None = there has."""
        gone = 0.0 if self._heard is None else self._clock() - self._heard
        return f"no IMU samples for {gone:.0f} s of wall time" if gone > SILENT else None


LASTS = 60.0
"""s over which the specific force is averaged."""
MOST = 3.0
"""m/s² by which the mean may differ from gravity: a vehicle that does so truly changes its
vertical speed by 180 m/s within a minute. Banked or not does not matter."""
UNLIKE = (
    "axes (x forward, y left, z up) or units (m/s², rad/s) of imu/data_raw are wrong, or the"
    " attitude is lost"
)
"""What is wrong where it differs."""


class GravityDirection:
    """Averages the upward specific force, minute by minute: wrong axes or units of an IMU, or a
    lost attitude, show there even where nothing else measures the height."""

    def __init__(self) -> None:
        self._sum, self._count, self._since = 0.0, 0, math.nan
        self._text: str | None = None

    def take(self, time: float, force: Array, attitude: Array) -> str | None:
        """Take a sample and return what was wrong over the last whole minute; None = nothing.

        Parameters
        ----------
        time : float
            s, increasing.
        force : (3,) array
            Specific force FRD, m/s².
        attitude : (4,) array
            Quaternion w, x, y, z that turns FRD to north, east, down.
        """
        if not self._count:
            self._since = time
        self._sum -= rotate(*attitude.tolist(), *force.tolist())[2]
        self._count += 1
        if time - self._since >= LASTS:
            mean, self._sum, self._count = self._sum / self._count, 0.0, 0
            found = f"specific force over a minute is {mean:.3g} m/s² upwards, not {GRAVITY:.3g}"
            self._text = f"{found}: {UNLIKE}" if abs(mean - GRAVITY) > MOST else None
        return self._text


INTERVALS = 30
"""Samples after which it is known how fast they come."""
FAST = 0.75
"""Of the interval that was told: less is no jitter."""
UNRESOLVED = (
    "samples were missing for long: whether there was a sharp manoeuvre is for fixes to say"
)


class SampleReport:
    """Tells a node's health which samples are missing, what is not known since, whether they point
    upwards, and how far an alignment by them is.

    Parameters
    ----------
    node : GraphNode
    dt : float
        s between the filter's steps.
    """

    def __init__(self, node: GraphNode[UkfFusionSettings], dt: float) -> None:
        self._health, self._max_gap, self._dt = node.health, node.settings.max_gap, dt
        self._told = node.scenario.imu.rate
        batch = node.scenario.matcher.batch_length * node.scenario.gravimeter.interval
        self._settles = from_seconds(2.0 * batch)
        self._gap: int | None = None
        """Stamp (ns) of the end of a long gap, or of the last fix since then that did not agree
        with the filter; None = fixes have agreed with it for `_settles` since."""
        self._noted = -SECOND
        """When samples of a fast IMU were missing, ns."""
        self._row: deque[float] = deque(maxlen=INTERVALS)
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
            mean = sum(self._row) / len(self._row)
            as_told = len(self._row) < INTERVALS or mean > FAST * self._dt
            self._say_rate(as_told, 1.0 / mean)
            return 0.0
        self._health.count("IMU samples missing", samples)
        self._say_missing(samples, to_seconds(ns) + interval, interval)
        return interval - self._dt

    def stream(self, stream: SampleStream, missing: int) -> None:
        """Tell of samples of a fast IMU that are missing since the last step, for a second by the
        stamps, and of a rate that is not as told."""
        if not stream.known:
            return
        if stream.missing or "IMU samples missing" in self._health.figures:
            self._health.figures["IMU samples missing"] = stream.missing
        if missing > 0:
            self._noted = stream.ns
            self._say_missing(missing, to_seconds(stream.ns), missing / self._told)
        elif stream.ns - self._noted > SECOND:
            self._say_rate(stream.as_told, stream.measured_rate)

    def _say_missing(self, samples: int, end: float, lasted: float) -> None:
        """Say that samples are missing before a time, which lasted for another (s)."""
        level = ERROR if lasted > self._max_gap else WARN
        self._health.state(level, f"{samples} IMU samples missing before {end:.3f} s, bridged")

    def _say_rate(self, as_told: bool, rate: float) -> None:
        text = f"IMU samples come at {rate:.0f} Hz, imu.rate says {self._told:g}"
        self._health.state(*((OK, "navigating") if as_told else (WARN, text)))

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
