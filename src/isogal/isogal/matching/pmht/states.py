"""States that hypotheses have beside the navigator's error: map errors and the instrument's."""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.frames import horizontal_difference
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap, by_channel, channels_of
from isogal.maps.displacement import EXTENT, displacement_at, length_of
from isogal.matching.interfaces import Batch, SecondaryBatch
from isogal.matching.parameters import Parameters

UNKNOWN = ("bias", "drift", "delay", "coupling_forward", "coupling_right", "filter_error", "")
"""States of every instrument that is one number: what readings are off by (map's unit), by how
much that changes per s, by how many s readings are later than specified, what they take from
horizontal accelerations (map's unit per m/s²), by how many s the time constant of its low-pass
filter is longer than the model's, and that filter's value (map's unit)."""
BIAS, DRIFT, DELAY, COUPLING_FORWARD, COUPLING_RIGHT, FILTER_ERROR, FILTER = range(7)
TENSOR_ORDER, MOST_ERRORS = 2, 24
"""Scans whose map errors of one potential say what those of the next are. Against the whole
covariance a straight track has 1.4 to 1.5 times the error with independent chains, 1.2 to 1.3 with
one scan, 1.1 to 1.2 with two, 1.1 with three. Beams need as many scans as their footprints are
long, since what is behind meets where others have been; not more than so many errors in all."""


@dataclass(frozen=True, slots=True, eq=False)
class States:
    """The states of an instrument, theta: C numbers."""

    names: tuple[str, ...]
    """(C,) as the diagnostics have them; "" of those that they do not have."""
    sigma: Array
    """(C,) 1-sigma before any reading; of those of UNKNOWN, which come last, models say it."""
    time: Array
    """(C,) s, correlation time; inf = does not decay."""
    walk: Array
    """(C,) random walk, unit per root second."""
    channels: int
    """U: K times `order`, or two where it is `smooth`."""
    unknown: int
    """How many of UNKNOWN there are: all, or none of readings that are several numbers."""
    slow: int = 0
    """How many of them, the first, are slow errors of the navigator's sensors (`Passage`)."""
    smooth: bool = False
    """Whether the map's error has a slope, a second state of models in which it has no kinks."""
    order: int = 1
    """Scans whose map errors say what the next ones are, where those of one scan depend on each
    other; 1 = the last one."""

    @classmethod
    def of(cls, batch: Batch, field_map: AnyMap) -> "States":
        """Return those of the batches of a run, by its first one."""
        more = 0 if batch.channel is not None else len(UNKNOWN)
        walk = np.array([batch.instrument.bias_walk, *(0.0 for _ in UNKNOWN[1:])])[:more]
        none = np.zeros((len(batch), more))
        unknown = Parameters(UNKNOWN[:more], np.zeros(more), none, walk=walk)
        slow = None
        passage, layout = batch.history.passage, batch.layout
        if passage is not None:
            sigma = np.sqrt(np.diag(passage.after))[BATCH_STATES:]
            slow = Parameters(("",) * len(sigma), sigma, np.zeros((len(batch), len(sigma))))
        every = Parameters.together([slow, batch.instrument.parameters, unknown])
        assert every is not None
        channels, order = len(channels_of(field_map)), 1
        if layout is not None and layout.beams:
            channels = layout.rows
            order = _scans_underneath(batch, channels)
        elif layout is not None and layout.of_one_potential is not None:
            order = TENSOR_ORDER
        smooth = more > 0 and channels * order == 1
        return cls(
            every.names,
            every.sigma,
            every.times,
            every.walks,
            2 if smooth else channels * order,
            more,
            0 if slow is None else len(slow.sigma),
            smooth,
            order,
        )

    @property
    def moving(self) -> Integers:
        """(n,) which states are of the navigator: its error, and slow ones of its sensors."""
        first = BATCH_STATES + self.channels
        return np.concatenate([np.arange(BATCH_STATES), np.arange(first, first + self.slow)])

    @property
    def count(self) -> int:
        """N, of the navigator, the map's errors and the instrument."""
        return BATCH_STATES + self.channels + len(self.sigma)


def footprints(batch: Batch, beams: int) -> Array:
    """Return (B, 2) m north and east of the first where the beams of the batch's last scan met the
    ground."""
    last = np.arange(len(batch) - beams, len(batch))
    lat, lon = batch.latitude[last], batch.longitude[last]
    return horizontal_difference(lat, lon, lat[:1], lon[:1])


def _scans_underneath(batch: Batch, beams: int) -> int:
    """Return how many scans it takes until the last beam is where the first one was."""
    foot = footprints(batch, beams)
    along = batch.velocity[-1]
    speed = math.hypot(*along)
    if not speed > 0.0:
        return 1
    extent = np.ptp(foot @ along) / speed
    interval = float(batch.time[-1] - batch.time[-1 - beams]) if len(batch) > beams else math.inf
    return max(1, min(math.ceil(extent / (speed * interval)), MOST_ERRORS // beams))


def displaceable(one: SecondaryBatch) -> SecondaryBatch:
    """Return a field's batch with two more parameters where its map may show anomalies beside
    their place: in which direction, and how far in 1-sigmas (`isogal.maps.displacement`)."""
    batch, length = one.batch, length_of(channels_of(one.field_map)[0])
    if length is None:
        return one
    channel = np.zeros(len(batch), np.int64) if batch.channel is None else batch.channel
    place = batch.latitude, batch.longitude
    size = by_channel(one.field_map, channel, displacement_at, *place)
    speed = float(np.hypot(*batch.velocity.mean(axis=0)))
    time = EXTENT * length / speed if speed > 0.0 else math.inf
    moves = np.einsum("t,ij->tij", size, np.eye(2))
    states = np.ones(2), np.zeros((len(batch), 2))
    shift = Parameters(("", ""), *states, position=moves, time=np.full(2, time))
    return replace(one, batch=replace(batch, instrument=batch.instrument.along(shift)))
