"""What is wrong with IMU samples that could each be right, and what is not known after some were
missing."""

import math
import time
from collections import deque
from collections.abc import Callable

from isogal.arrays import Array, Booleans
from isogal.inertial.rotations import rotate
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.nodes.stuck import Repetitions

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
SENSORS = ("specific force", "angular rate")
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


class StuckError(BadMessageError):
    """A sample of which an axis has been stuck.

    Parameters
    ----------
    text : str
    samples : int
        How many samples before it were taken for true and are not, where that has just been found
        out; else 0.
    """

    def __init__(self, text: str, samples: int) -> None:
        super().__init__(text)
        self.samples = samples


class SampleMonitor:
    """Looks at samples one after the other.

    Parameters
    ----------
    acceleration, turn_rate : float
        Most that the vehicle can do, m/s² and rad/s; a sample beyond is a spike.
    clock : callable
        Wall time, s.
    noisy : (6,) array, optional
        Which axes have noise, so that a value does not come twice.
    """

    def __init__(
        self,
        acceleration: float,
        turn_rate: float,
        clock: Callable[[], float] = time.monotonic,
        noisy: Booleans | None = None,
    ) -> None:
        self._acceleration, self._turn_rate, self._clock = acceleration, turn_rate, clock
        self._noisy = [True] * 6 if noisy is None else noisy.tolist()
        self._axes = [Repetitions(LEAST, LEARNT) for _ in AXES]
        self._heard: float | None = None

    def take(self, force: Array, rate: Array) -> None:
        """Look at a sample (3,), (3,); raises BadMessageError where it cannot be true."""
        self._heard = self._clock()
        values = force.tolist() + rate.tolist()
        for axis, value in zip(self._axes, values, strict=True):
            axis.take(value)
        self._refuse_stuck()
        beyond = abs(math.hypot(*values[:3]) - GRAVITY)
        if beyond > self._acceleration:
            raise BadMessageError(
                f"specific force {beyond:.0f} m/s² beyond gravity; max_acceleration is"
                f" {self._acceleration:g} m/s²"
            )
        turn = math.hypot(*values[3:])
        if turn > self._turn_rate:
            raise BadMessageError(
                f"angular rate {turn:.2g} rad/s; max_turn_rate is {self._turn_rate:g} rad/s"
            )

    def _refuse_stuck(self) -> None:
        if not any(axis.count for axis in self._axes):  # as of nearly all samples
            return
        found = {
            name: axis
            for name, axis, noisy in zip(AXES, self._axes, self._noisy, strict=True)
            if noisy and axis.beyond is not None
        }
        if found:
            counts = [axis.count for axis in found.values()]
            raise StuckError(
                f"{', '.join(found)} stuck for {counts[0] + 1} samples: taken as missing",
                0 if any(axis.beyond for axis in found.values()) else max(counts),
            )

    @property
    def stuck(self) -> str | None:
        """Which axes have not moved for long; None = all have."""
        names = [name for name, axis in zip(AXES, self._axes, strict=True) if axis.count >= STUCK]
        return f"stuck: {', '.join(names)}" if names else None

    @property
    def silent(self) -> str | None:
        """That there has been no sample for long; None = there has."""
        gone = 0.0 if self._heard is None else self._clock() - self._heard
        return f"no IMU samples for {gone:.0f} s of wall time" if gone > SILENT else None


_Sample = tuple[list[float], list[float]]
"""Specific force and angular rate."""
_Pair = tuple[float, float]
"""Of both, m/s² and rad/s."""


class Spikes:
    """Finds a sample that differs from both its neighbours by much more than samples have differed
    for a while: a fault, not a motion. That shows when the next one comes.

    A motion that the accelerometers and the gyroscopes feel at once is believed.
    """

    def __init__(self) -> None:
        self._samples: deque[_Sample] = deque(maxlen=2)
        self._changes: deque[_Pair] = deque(maxlen=REMEMBERED)

    def take(self, force: Array, rate: Array) -> str | None:
        """Take a sample (3,), (3,), m/s² and rad/s; return what is wrong with the one before it,
        which is forgotten."""
        new = force.tolist(), rate.tolist()
        if len(self._samples) == 2:
            before, last = self._samples
            away = _distance(last, before)
            if (which := self._spike(away, _distance(new, before))) is not None:
                self._samples[-1] = new
                unit = ("m/s²", "rad/s")[which]
                return f"{SENSORS[which]} of one sample {away[which]:.2g} {unit} out of line"
            self._changes.append(away)
        self._samples.append(new)
        return None

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


def _distance(one: _Sample, other: _Sample) -> _Pair:
    """Return how far apart two samples are, m/s² and rad/s."""
    return math.dist(one[0], other[0]), math.dist(one[1], other[1])


class GravityDirection:
    """Averages the upward specific force, minute by minute: wrong axes or units of an IMU, or a
    lost attitude, show there even where nothing else measures the height."""

    def __init__(self) -> None:
        self._sum, self._count, self._since = 0.0, 0, float("nan")
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
