"""The new readings of a batch as rows that are linear but for the map.

With x the navigator's error at the batch end (7), u the map error of each channel in units of its
1-sigma and theta the states of the instrument, row t says

    level = map(place - A (x, theta)) + J (x, theta) + load u + white noise,

`level` the reading less what is known to be in it, `place` where the navigator believes it was
taken, A = `Rows.place` (m per unit) and J = `Rows.reading`. Between rows u and theta change as
first-order Gauss-Markov processes, random walks or not at all: `keep` and `fresh`.
docs/mathematics.md, section 5.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap, by_channel, channels_of
from isogal.maps.field_map import FieldMap
from isogal.maps.tensor_error import shares, tensor_covariance
from isogal.matching.interfaces import Batch
from isogal.matching.parameters import Parameters
from isogal.matching.pmht.low_pass import path_nodes

UNKNOWN = ("bias", "drift", "delay")
"""States of every instrument that is one number: what readings are off by (map's unit), by how
much that changes per s, and by how many s readings are later than told."""
BIAS, DRIFT, DELAY = range(3)
ORDER = 2
"""Scans whose map errors of one potential say what those of the next are. Against the whole
covariance a straight track has 1.4 to 1.5 times the error with independent chains, 1.2 to 1.3 with
one scan, 1.1 to 1.2 with two, 1.1 with three."""
LEAST_STEP_M, NUGGET = 1.0, 1e-6
"""Nearer to the scan before map errors are the same; share of their variance that is each one's
own, against rounding."""


class Rows(NamedTuple):
    """n readings of K channels and N states in all, as compiled loops take them. SI, radians."""

    latitude: Array
    """(n,)."""
    longitude: Array
    """(n,)."""
    radian: Array
    """(n, 2) rad per m to north and to east."""
    level: Array
    """(n,) map's unit."""
    place: Array
    """(n, 2, N) m north and east per unit of the states."""
    reading: Array
    """(n, N)."""
    load: Array
    """(L, n, K) map errors per unit of u, for each of the correlation lengths of the models; in
    units of a model's sigma."""
    noise: Array
    """(n,) variance."""
    travelled: Array
    """(n,) m since the row before."""
    keep: Array
    """(n, N - 7) share of a state that is left since the row before; of u the models say it."""
    fresh: Array
    """(n, N - 7) variance that has joined it."""
    step: Array
    """(L, n, U, U) what has become of all U map errors since the row before where they depend on
    each other, instead of `keep`; U = 0 where they do not."""
    joined: Array
    """(L, n, U, U) covariance that has joined them; 0 where `step` is of no concern."""
    rate: Array
    """(n,) change per s of what the reduction adds to the readings."""
    velocity: Array
    """(n, 2) m/s."""
    nodes: Array
    """(n, Q, 3) points (rad beside the row's place) and weights that a reading is a mean over."""
    channel: Integers
    """(n,)."""


@dataclass(frozen=True, slots=True, eq=False)
class States:
    """The states of an instrument, theta: C numbers."""

    names: tuple[str, ...]
    """Of the first of them; there may be fewer than C."""
    sigma: Array
    """(C,) 1-sigma before any reading; of those of UNKNOWN, which come last, models say it."""
    time: Array
    """(C,) s, correlation time; inf = does not decay."""
    walk: Array
    """(C,) random walk, unit per root second."""
    channels: int
    """K; of one potential ORDER times as many."""
    unknown: int
    """How many of UNKNOWN there are: all, or none of readings that are several numbers."""

    @classmethod
    def of(cls, batch: Batch, field_map: AnyMap) -> "States":
        """Return those of the batches of a run, by its first one."""
        told = Parameters.together([batch.noise, batch.parameters])
        if told is None:
            told = Parameters((), np.zeros(0), np.zeros((len(batch), 0)))
        more = 0 if batch.channel is not None else len(UNKNOWN)
        last = np.array([batch.bias_walk, 0.0, 0.0])[:more]
        channels = len(channels_of(field_map)) if batch.beam is None else batch.rows_per_scan
        if batch.of_one_potential is not None:
            channels *= ORDER
        return cls(
            told.names,
            np.concatenate([told.sigma, np.zeros(more)]),
            np.concatenate([told.times, np.full(more, np.inf)]),
            np.concatenate([told.walks, last]),
            channels,
            more,
        )

    @property
    def count(self) -> int:
        """N, of the navigator, the map's errors and the instrument."""
        return BATCH_STATES + self.channels + len(self.sigma)


@dataclass(frozen=True, slots=True)
class Epoch:
    """When readings were taken."""

    start: float
    """s, the run's first one."""
    time: float
    """s, the last one."""
    steps: Array
    """(ORDER, 2) m, north and east, from one of the last scans to the next."""


@lru_cache(maxsize=4)  # several ask it of the same batch
def navigator_states(batch: Batch) -> tuple[Array, Array]:
    """Return the navigator's covariance (7, 7) of its error x at the batch end, and (4 + M, 7) the
    batch's unknowns, xi and its nuisance parameters, per unit of x. Of a batch without attitude
    that is 1e-12 rad and nothing follows from it."""
    prior = batch.prior
    if batch.attitude is None:
        covariance = np.diag(np.full(BATCH_STATES, 1e-24))
        covariance[:4, :4] = prior
        return covariance, np.eye(4 + batch.nuisance_reading.shape[1], BATCH_STATES) * (
            np.arange(BATCH_STATES) < 4
        )
    by_xi, root = batch.attitude
    inverse = np.linalg.pinv(root)
    cross = by_xi @ prior
    covariance = np.block([[prior, cross.T], [cross, cross @ by_xi.T + root @ root.T]])
    by_seven = np.block([[np.eye(4), np.zeros((4, 3))], [-inverse @ by_xi, inverse]])
    return 0.5 * (covariance + covariance.T), by_seven


def rows_of(
    batch: Batch, field_map: AnyMap, states: States, lengths: Array, last: Epoch | None
) -> tuple[Rows | None, Epoch | None]:
    """Return the new readings of a batch, None where there are none, and the last one's epoch.

    Parameters
    ----------
    lengths : (L,) array
        Correlation lengths of the map's error that models have, m.
    last : Epoch, optional
        Of the last reading before; None = there was none.
    """
    new = np.arange(len(batch) - batch.new, len(batch))
    which = new[(new >= batch.cut) & np.isfinite(batch.reading[new])]
    if not which.size:
        return None, last
    maps = channels_of(field_map)
    latitude, longitude, time = (a[which] for a in (batch.latitude, batch.longitude, batch.time))
    channel = np.zeros_like(which) if batch.channel is None else batch.channel[which]
    part = np.zeros_like(which) if batch.beam is None else batch.beam[which]
    velocity = batch.velocity[which]
    first = last or _before(batch, which)
    elapsed = np.diff(time, prepend=first.time)
    # places would have beams apart, and what fixes have moved the navigator by
    moved = velocity * elapsed[:, None]
    travelled = np.hypot(*moved.T)
    names = batch.of_one_potential
    steps, step, joined = _tensor_steps(names, moved, first.steps, lengths, last is None)
    rounding = np.array([one.quantisation**2 / 12.0 for one in maps])[channel]
    north, east = metres_per_radian(latitude)
    keep, fresh = _changes(states, elapsed)
    place, reading = _effects(batch, which, states, navigator_states(batch)[1], first.start)
    rows = Rows(
        np.ascontiguousarray(latitude),
        np.ascontiguousarray(longitude),
        np.stack([1.0 / north, 1.0 / east], axis=-1),
        batch.reading[which] - batch.offset[which],
        place,
        reading,
        _loads(batch, which, field_map, states, lengths, channel, part),
        _white(batch)[which] + rounding,
        travelled,
        keep,
        fresh,
        step,
        joined,
        np.zeros(len(which)) if batch.reading_rate is None else batch.reading_rate[which],
        np.ascontiguousarray(velocity),
        path_nodes(batch, which),
        channel.astype(np.int64),
    )
    return rows, Epoch(first.start, float(time[-1]), steps)


def _before(batch: Batch, which: Integers) -> Epoch:
    """Return the epoch before the first reading of a run: as if one had been there."""
    begin = float(batch.time[which[0]])
    later = batch.time[which] - begin
    interval = float(later[later > 0.0].min()) if later.any() else 10.0
    return Epoch(begin, begin, np.tile(batch.velocity[which[0]] * interval, (ORDER, 1)))


def _changes(states: States, elapsed: Array) -> tuple[Array, Array]:
    """Return `Rows.keep` and `Rows.fresh`; those of map errors are the models'."""
    keep = np.exp(-elapsed[:, None] / states.time)
    stationary = np.where(np.isfinite(states.time), states.sigma, 0.0)
    fresh = stationary**2 * (1.0 - keep**2) + states.walk**2 * elapsed[:, None]
    map_errors = np.ones((len(elapsed), states.channels))
    return (
        np.ascontiguousarray(np.concatenate([map_errors, keep], axis=1)),
        np.ascontiguousarray(np.concatenate([0.0 * map_errors, fresh], axis=1)),
    )


def _white(batch: Batch) -> Array:
    """Return (T,) the variance of readings that they have in common with no other."""
    noise = batch.noise
    if noise is None or batch.reading_covariance is None:
        return batch.sigma**2
    common = (noise.sigma * noise.reading) ** 2
    return np.asarray(np.diag(batch.reading_covariance) - common.sum(axis=1))


def _effects(
    batch: Batch, which: Integers, states: States, by_seven: Array, start: float
) -> tuple[Array, Array]:
    """Return `Rows.place` and `Rows.reading`."""
    n, first = len(which), BATCH_STATES + states.channels
    place, reading = np.zeros((n, 2, states.count)), np.zeros((n, states.count))
    xi, rest = by_seven[:4], by_seven[4:]
    place[..., :BATCH_STATES] = (
        batch.transition[which] @ xi + batch.nuisance_position[which] @ rest
    )
    reading[:, :BATCH_STATES] = (
        batch.reading_jacobian[which] @ xi + batch.nuisance_reading[which] @ rest
    )
    told = Parameters.together([batch.noise, batch.parameters])
    if told is not None:
        told = told.part(which)
        last = first + len(told.sigma)
        place[..., first:last], reading[:, first:last] = told.moves, told.reading
    if states.unknown:
        bias, drift, delay = states.count - states.unknown + np.arange(states.unknown)
        reading[:, bias], reading[:, drift] = 1.0, batch.time[which] - start
        place[..., delay] = batch.velocity[which]
        if batch.reading_rate is not None:
            reading[:, delay] = batch.reading_rate[which]
    return place, reading


def _loads(
    batch: Batch,
    which: Integers,
    field_map: AnyMap,
    states: States,
    lengths: Array,
    channel: Integers,
    part: Integers,
) -> Array:
    """Return `Rows.load`.

    The errors of K channels of one potential are u times their 1-sigmas. Those of others or of
    beams at one epoch have a covariance with a Cholesky factor C, and are C u. Along the track each decays by the same exp(-d / L), so that u are independent
    Gauss-Markov processes: of beams this is an exponential in the sum of the distances along and
    across the track."""
    maps = channels_of(field_map)
    own = by_channel(field_map, channel, "sigma_at", batch.latitude[which], batch.longitude[which])
    usual = np.array([stated_sigma(one) for one in maps])[channel]
    ratio = np.where(
        (usual > 0.0) & np.isfinite(own), own / np.where(usual > 0.0, usual, 1.0), 1.0
    )
    if batch.of_one_potential is not None:
        names = batch.of_one_potential
        sigma = np.concatenate([np.sqrt(shares(names)), np.zeros(states.channels - len(names))])
        factor = np.diag(sigma)[None] + np.zeros((len(lengths), 1, 1))
        row = channel
    elif batch.beam is not None:
        factor, row = _beam_factors(batch, states.channels, lengths), part
    else:
        factor = np.eye(states.channels)[None] + np.zeros((len(lengths), 1, 1))
        row = channel
    return np.ascontiguousarray(factor[:, row] * ratio[:, None])


def _tensor_steps(
    names: Sequence[str] | None, moved: Array, before: Array, lengths: Array, begins: bool
) -> tuple[Array, Array, Array]:
    """Return `Epoch.steps` after rows that are (n, 2) m from those before, `Rows.step` and
    `Rows.joined`, given `Epoch.steps` before and whether a run begins with them.

    Map errors of one potential have a covariance that says what to expect of the next scan's by
    those of ORDER scans, as if those before did not matter (a vector autoregression; Vecchia 1988,
    J. R. Stat. Soc. B 50:297)."""
    count = len(moved)
    if names is None:
        nothing = np.zeros((len(lengths), count, 0, 0))
        return before, nothing, nothing
    size, whole = len(names), ORDER * len(names)
    step, joined = (np.zeros((len(lengths), count, whole, whole)) for _ in range(2))
    if begins:
        moved = np.concatenate([before[:1], moved[1:]])
    scans = np.flatnonzero(np.hypot(*moved.T) > LEAST_STEP_M)
    trail = np.concatenate([before[1:], moved[scans]])
    back = np.stack([trail[ORDER - 1 - k :][: len(scans)] for k in range(ORDER)], axis=1)
    places = np.concatenate([np.zeros((len(scans), 1, 2)), -np.cumsum(back, axis=1)], axis=1)
    places = np.repeat(places, size, axis=1)
    apart = places[:, None] - places[:, :, None]
    channel = np.tile(np.arange(size), ORDER + 1)
    unit = np.tile(1.0 / np.sqrt(shares(names)), ORDER + 1)
    older = np.arange(size, whole)
    for k, length in enumerate(lengths):
        every = tensor_covariance(names, channel, apart, float(length)) * unit[:, None] * unit
        every = every + NUGGET * np.eye(len(channel))
        now, cross = every[:, :size, :size], every[:, size:, :size]
        gain = np.linalg.solve(every[:, size:, size:], cross).swapaxes(1, 2)
        step[k, scans, :size] = gain
        step[k][scans[:, None], older, older - size] = 1.0
        joined[k][scans[:, None, None], np.arange(size)[:, None], np.arange(size)] = (
            now - gain @ cross
        )
        if begins:
            step[k, 0], joined[k, 0] = 0.0, every[0, :whole, :whole]
    return np.concatenate([before, moved[scans]])[-ORDER:], step, joined


def _beam_factors(batch: Batch, beams: int, lengths: Array) -> Array:
    """Return (L, B, B) Cholesky factors of the map errors' correlation under the beams of the
    batch's last scan."""
    assert batch.beam is not None
    last = np.arange(len(batch) - beams, len(batch))
    lat, lon = batch.latitude[last], batch.longitude[last]
    apart = horizontal_difference(lat[:, None], lon[:, None], lat, lon)
    distance = np.hypot(apart[..., 0], apart[..., 1])
    return np.stack([_factor(np.exp(-distance / length)) for length in lengths])


def _factor(covariance: Array) -> Array:
    """Return a lower factor of a covariance that may be singular."""
    size = len(covariance)
    return np.linalg.cholesky(covariance + 1e-9 * np.trace(covariance) / size * np.eye(size))


def stated_sigma(one: FieldMap) -> float:
    """Return the mean of what a map says of its own error (map's unit); 0 where it says nothing of
    the whole of it."""
    if one.error_stated is False:
        return 0.0
    sigma = np.asarray(one.sigma, dtype=np.float64)
    known = sigma[np.isfinite(sigma)]
    return float(known.mean()) if known.size else 0.0


def usual_noise(rows: Rows) -> float:
    """Return the usual 1-sigma of the white noise, map's unit."""
    return math.sqrt(float(np.median(rows.noise)))
