"""From scans, one by one, to batches: the only place that knows when a batch is due and what the navigator's error does over it."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isogal.earth.ellipsoid import metres_per_radian
from isogal.matching.interfaces import Batch
from isogal.scenario import Matcher as MatcherSettings
from isogal.sensors.gravimeter import reading_jacobian

Array = NDArray[np.float64]


@dataclass(slots=True)
class _Scan:
    time: float
    latitude: float
    longitude: float
    velocity: Array
    reading: float
    sigma: float
    offset: float


def fix_due(scans: int, settings: MatcherSettings) -> bool:
    """Whether a batch ends with the scan that makes `scans` of them (counted from 1)."""
    return scans >= settings.batch_length and (scans - settings.batch_length) % settings.scans_between_fixes == 0


def transition(age: Array) -> Array:
    """Return (T, 2, 4): the position error a time `age` (T,) s before the batch end per unit of error at the batch end.

    A constant velocity error over the batch: d_position(t) = d_position(end) - age d_velocity(end) (SCIENCE 3).
    """
    matrix = np.zeros((len(age), 2, 4))
    matrix[:, 0, 0] = matrix[:, 1, 1] = 1.0
    matrix[:, 0, 2] = matrix[:, 1, 3] = -age
    return matrix


class BatchBuilder:
    """Collects the scans of one run.

    Parameters
    ----------
    settings : scenario.Matcher
    quantity : str
        What the readings are; says how the navigator's error got into them (`reading_jacobian`).
    context : int
        How many scans before the batch the matcher wants to see as well.
    """

    def __init__(self, settings: MatcherSettings, quantity: str, context: int = 0) -> None:
        self.settings = settings
        self.quantity = quantity
        self._scans: deque[_Scan] = deque(maxlen=settings.batch_length + context)
        self._count = 0
        self._unused = 0

    @property
    def ready(self) -> bool:
        """Whether the newest scan ends a batch that has not been built yet."""
        return self._unused > 0 and fix_due(self._count, self.settings)

    def add_scan(
        self,
        time: float,
        latitude: float,
        longitude: float,
        velocity: Array,
        reading: float,
        sigma: float,
        offset: float = 0.0,
    ) -> None:
        """Add a scan: where the navigator was (rad), its velocity (2,) north-east m/s, the reduced reading (NaN = none)."""
        self._scans.append(_Scan(time, latitude, longitude, np.array(velocity, float), reading, sigma, offset))
        self._count += 1
        self._unused += 1

    def correct(self, time: float, jump: Array) -> None:
        """Carry a jump of the navigator at `time` back to the scans already collected.

        Parameters
        ----------
        jump : (4,) array
            After minus before: north m, east m, v_north, v_east m/s. Older positions move by what the jump means back then, and readings by
            what their reduction would have been with the better estimate.
        """
        scans = [scan for scan in self._scans if scan.time <= time + 1e-9]
        if not scans:
            return
        latitude, _, velocity, age = self._arrays(scans, time)
        shift = transition(age) @ jump
        full = np.concatenate([shift, np.broadcast_to(jump[2:], shift.shape)], axis=1)
        change = (reading_jacobian(self.quantity, latitude, velocity[:, 0], velocity[:, 1]) * full).sum(axis=1)
        north, east = metres_per_radian(latitude)
        for i, scan in enumerate(scans):
            scan.latitude += shift[i, 0] / north[i]
            scan.longitude += shift[i, 1] / east[i]
            scan.velocity = scan.velocity + jump[2:]
            scan.reading += change[i]

    def build(self, prior: Array) -> Batch:
        """Return the batch that the newest scan ends, with the navigator's (4, 4) covariance there as prior."""
        scans = list(self._scans)
        latitude, longitude, velocity, age = self._arrays(scans, scans[-1].time)
        moves = transition(age)
        at_scan = reading_jacobian(self.quantity, latitude, velocity[:, 0], velocity[:, 1])
        jacobian = np.einsum("ti,tij->tj", at_scan[:, :2], moves)
        jacobian[:, 2:] += at_scan[:, 2:]
        new = min(self._unused, len(scans))
        self._unused = 0
        return Batch(
            time=np.array([scan.time for scan in scans]),
            latitude=latitude,
            longitude=longitude,
            velocity=velocity,
            reading=np.array([scan.reading for scan in scans]),
            sigma=np.array([scan.sigma for scan in scans]),
            offset=np.array([scan.offset for scan in scans]),
            transition=moves,
            reading_jacobian=jacobian,
            prior=0.5 * (prior + prior.T),
            new=new,
        )

    @staticmethod
    def _arrays(scans: list[_Scan], end: float) -> tuple[Array, Array, Array, Array]:
        return (
            np.array([scan.latitude for scan in scans]),
            np.array([scan.longitude for scan in scans]),
            np.array([scan.velocity for scan in scans]),
            end - np.array([scan.time for scan in scans]),
        )
