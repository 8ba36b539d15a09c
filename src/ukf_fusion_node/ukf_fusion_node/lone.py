"""A single IMU sample out of line with those on either side of it."""

from collections import deque

import numpy as np

from isogal.arrays import Array

REMEMBERED = 60
"""Changes from sample to sample that say how much the vehicle moves."""
BEYOND = 20.0
"""How many times the largest of them a sample has to be away. Of noise and waves the largest
change of one minute differs from that of another by a factor of two or three."""
FELT = 2.0
"""How many times the largest of them says that the other kind of sensor has felt it, too."""
BACK = 0.25
"""Of its distance, by which the next sample may miss the one before: more is a manoeuvre."""
LEAST = np.array([1e-2, 1e-3])
"""m/s², rad/s: less, for one sample, does no harm."""
NAMES = ("specific force", "angular rate")


class LoneSamples:
    """Finds a sample that differs from both its neighbours by much more than samples have differed
    for a while: a fault, not a motion. That shows when the next one comes.

    A motion that the accelerometers and the gyroscopes feel at once is believed.
    """

    def __init__(self) -> None:
        self._samples: deque[tuple[Array, Array]] = deque(maxlen=2)
        self._changes: deque[Array] = deque(maxlen=REMEMBERED)

    def take(self, force: Array, rate: Array) -> str | None:
        """Take a sample (3,), (3,), m/s² and rad/s; return what is wrong with the one before it,
        which is forgotten."""
        new = force, rate
        if len(self._samples) == 2:
            before, last = self._samples
            away, missed = _distance(last, before), _distance(new, before)
            if len(self._changes) == REMEMBERED:
                usual = np.max(self._changes, axis=0)
                lone = (away > np.maximum(BEYOND * usual, LEAST)) & (missed < BACK * away)
                if lone.any() and (away > FELT * usual).sum() == 1:
                    self._samples.pop()
                    self._samples.append(new)
                    which = int(np.argmax(lone))
                    unit = ("m/s²", "rad/s")[which]
                    return f"{NAMES[which]} of one sample {away[which]:.2g} {unit} out of line"
            self._changes.append(away)
        self._samples.append(new)
        return None


def _distance(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Return (2,) how far apart two samples are, m/s² and rad/s."""
    return np.array([np.linalg.norm(a - b) for a, b in zip(one, other, strict=True)])
