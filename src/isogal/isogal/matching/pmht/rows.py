"""The new readings of a batch as rows that are linear but for the map.

With x the navigator's error at the batch end (7), u the map error of each channel in units of its
1-sigma and theta the states of the instrument, row t says

    level = map(place - A (x, theta)) + J (x, theta) + load u + white noise,

`level` the reading less what is known to be in it, `place` where the navigator believes it was
taken, A = `Rows.place` (m per unit) and J = `Rows.reading`. Between rows u and theta change as
first-order Gauss-Markov processes, random walks or not at all: `keep` and `fresh`.
docs/mathematics.md, section 5.
"""

import itertools
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian, radii
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap, by_channel, channels_of
from isogal.maps.error_model import Chain, chained, independent, shares, smooth
from isogal.maps.field_map import FieldMap
from isogal.maps.quantities import GRAVITY
from isogal.maps.roughness import roughness_at
from isogal.matching.interfaces import Batch
from isogal.matching.parameters import InstrumentErrors
from isogal.matching.path import hermite
from isogal.matching.pmht.states import (
    BIAS,
    COUPLING_FORWARD,
    COUPLING_RIGHT,
    DELAY,
    DRIFT,
    States,
    footprints,
)
from isogal.matching.transitions import rates
from isogal.sensors.gravimeter_errors import accelerations

OF_LENGTHS = ("load", "step", "joined")
"""Columns of rows that have another axis in front."""
PAST, LONGEST = 5.0, 25
"""s between the points of the past that rows have, and how many: two minutes."""
CHUNK = 15
"""Readings that hypotheses take in one update: with twice as many the first fix takes twice as
long, 0.2 s where the map is rough."""


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
    """(L, n, U) map errors per unit of the U states u, for each of the models' L correlation
    lengths; in units of a model's sigma."""
    noise: Array
    """(n,) variance."""
    keep: Array
    """(n, N - 7) share of a state that is left since the row before; of u, 1."""
    fresh: Array
    """(n, N - 7) variance that has joined it; of u, 0."""
    step: Array
    """(L, n, U, U) what has become of u since the row before, for each of the L lengths."""
    joined: Array
    """(L, n, U, U) covariance that has joined u; 0 of a row at the place of the one before, whose
    `step` does not count."""
    added: Array
    """(n,) what the reduction adds to the readings."""
    past: Array
    """(n, Q, 3) where the vehicle was before, rad beside the row's place, and what less was added
    then, `PAST` s apart."""
    elapsed: Array
    """(n,) s since the reading before."""
    channel: Integers
    """(n,)."""
    swift: Array
    """(n, 2, 7) root of the map's unit per unit of the navigator's error: readings become less by
    the sum of the squares of both."""


def some(rows: Rows, first: int, last: int) -> Rows:
    """Return rows from a first one to before a last one."""
    part = slice(first, last)
    return Rows._make(
        np.ascontiguousarray(column[:, part] if name in OF_LENGTHS else column[part])
        for name, column in zip(Rows._fields, rows, strict=True)
    )


def together(parts: Sequence[Rows]) -> Rows:
    """Return the rows of several parts."""
    return Rows._make(
        np.concatenate(columns, axis=1 if name in OF_LENGTHS else 0)
        for name, *columns in zip(Rows._fields, *parts, strict=True)
    )


def parts_of(rows: Rows) -> list[Rows]:
    """Return rows in parts of at most so many as hypotheses take in one update: the first of them
    leave few places where there were many."""
    count = len(rows.level)
    number = -(-count // CHUNK)
    ends = [count * k // number for k in range(number + 1)]
    return [some(rows, *pair) for pair in itertools.pairwise(ends)] if number > 1 else [rows]


@dataclass(frozen=True, slots=True)
class Epoch:
    """When readings were taken."""

    start: float
    """s, the run's first one."""
    time: float
    """s, the last one."""
    velocity: Array
    """(2,) m/s there, as the navigator believes now."""
    steps: Array
    """(order, 2) m, north and east, from one of the last scans to the next."""


def rows_of(
    batch: Batch,
    field_map: AnyMap,
    states: States,
    lengths: Array,
    last: Epoch | None,
    rough: Array | None = None,
) -> tuple[Rows | None, Epoch | None]:
    """Return the new readings of a batch, None where there are none, and the last one's epoch.

    Parameters
    ----------
    lengths, rough : (L,) arrays
        See `Models.shapes`.
    last : Epoch, optional
        Of the last reading before; None = there was none.
    """
    new = np.arange(len(batch) - batch.new, len(batch))
    which = new[(new >= batch.cut) & np.isfinite(batch.reading[new])]
    if not which.size:
        return None, last
    rounding = np.array([one.quantisation**2 / 12.0 for one in channels_of(field_map)])
    latitude, longitude, time = (a[which] for a in (batch.latitude, batch.longitude, batch.time))
    channel = np.zeros_like(which) if batch.channel is None else batch.channel[which]
    velocity = batch.velocity[which]
    first = _before(batch, which, states.order, last)
    elapsed = np.diff(time, prepend=first.time)
    rough = np.zeros(len(lengths)) if rough is None else rough
    # places would have beams apart, and what fixes have moved the navigator by
    moved = velocity * elapsed[:, None]
    shapes = lengths, rough
    steps, step, joined = _of_map(batch, states, moved, first.steps, shapes, last is None)
    north, east = metres_per_radian(latitude)
    keep, fresh = _changes(states, elapsed)
    instrument = batch.instrument.part(which)
    place, reading = _effects(batch, which, instrument, states, first)
    rows = Rows(
        np.ascontiguousarray(latitude),
        np.ascontiguousarray(longitude),
        np.stack([1.0 / north, 1.0 / east], axis=-1),
        batch.reading[which],
        place,
        reading,
        _loads(batch, which, field_map, states.channels, channel, rough),
        batch.sigma[which] ** 2 + rounding[channel],
        keep,
        fresh,
        step,
        joined,
        np.zeros(len(which)) if instrument.added is None else instrument.added,
        _past(batch, which, states),
        elapsed,
        channel.astype(np.int64),
        _swift(batch, which, field_map),
    )
    return rows, Epoch(first.start, float(time[-1]), velocity[-1], steps)


def _of_map(
    batch: Batch,
    states: States,
    moved: Array,
    before: Array,
    shapes: tuple[Array, Array],
    begins: bool,
) -> tuple[Array, Array, Array]:
    """Return how map errors of `Models.shapes` go on; other parameters and results as those of
    `chained`."""
    count, (lengths, rough) = states.channels // states.order, shapes
    layout = batch.layout
    if layout is None or not (layout.beams or layout.of_one_potential):
        travelled = np.hypot(*moved.T)
        step, joined = independent(count, travelled, lengths)
        for k in np.flatnonzero(rough > 0.0) if states.smooth else ():
            step[k], joined[k] = smooth(travelled, lengths[k])
        return before, step, joined
    feet = footprints(batch, count) if layout.beams else np.zeros((count, 2))
    chain = Chain(states.order, feet, layout.of_one_potential)
    return chained(chain, moved, before, lengths, begins)


def _before(batch: Batch, which: Integers, order: int, last: Epoch | None) -> Epoch:
    """Return the epoch before the first reading of a batch, as the navigator believes now; of a
    run, as if one had been there."""
    if last is not None:
        jump = batch.history.correction
        return last if jump is None else replace(last, velocity=last.velocity + jump[2:4])
    begin = float(batch.time[which[0]])
    later = batch.time[which] - begin
    interval = float(later[later > 0.0].min()) if later.any() else 10.0
    velocity = batch.velocity[which[0]]
    return Epoch(begin, begin, velocity, np.tile(velocity * interval, (order, 1)))


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


def _swift(batch: Batch, which: Integers, field_map: AnyMap) -> Array:
    """Return `Rows.swift` of rows `which` (n,): the Eötvös acceleration, which a reduction adds,
    contains v_n² / (M + h) and v_e² / (N + h) (`earth.gravity.eotvos`)."""
    reduced = batch.by_error[which, 2, 2:4].any(axis=1) & (field_map.quantity in GRAVITY)
    root = np.sqrt(reduced / np.stack(radii(batch.latitude[which])))
    return np.ascontiguousarray(root.T[..., None] * batch.backward[which, 2:4])


def _past(batch: Batch, which: Integers, states: States) -> Array:
    """Return `Rows.past` of rows `which` (n,) of a batch; two points where no model asks for
    it."""
    if not states.unknown or batch.rows_per_scan > 1:
        return np.zeros((len(which), 2, 3))
    past = np.zeros((len(which), LONGEST, 3))
    time = batch.time[which]
    ages = PAST * np.arange(past.shape[1])
    north, east = metres_per_radian(batch.latitude)
    velocity = batch.velocity
    columns = [
        (batch.latitude, velocity[:, 0] / north),
        (batch.longitude, velocity[:, 1] / east),
    ]
    added = batch.instrument.added
    if added is not None:
        columns.append((-added, -rates(added[:, None], batch.time)[:, 0]))
    for k, (value, slope) in enumerate(columns):
        then = hermite((time[:, None] - ages).ravel(), batch.time, value, slope)[0]
        past[..., k] = then.reshape(past.shape[:2]) - value[which][:, None]
    return past


def _effects(
    batch: Batch, which: Integers, instrument: InstrumentErrors, states: States, before: Epoch
) -> tuple[Array, Array]:
    """Return `Rows.place` and `Rows.reading` of rows `which` (n,), with what is known of the
    readings of these."""
    n, first = len(which), BATCH_STATES + states.channels + states.slow
    place, reading = np.zeros((n, 2, states.count)), np.zeros((n, states.count))
    place[..., :BATCH_STATES] = batch.by_error[which, :2]
    reading[:, :BATCH_STATES] = batch.by_error[which, 2]
    parameters = instrument.parameters
    if parameters is not None:
        last = first + len(parameters.sigma)
        place[..., first:last], reading[:, first:last] = parameters.moves, parameters.reading
    if states.unknown:
        time, velocity = batch.time[which], batch.velocity[which]
        unknown = reading[:, -states.unknown :]
        unknown[:, BIAS], unknown[:, DRIFT] = 1.0, time - before.start
        place[..., -states.unknown + DELAY] = velocity
        if batch.instrument.added is not None:
            unknown[:, DELAY] = rates(batch.instrument.added[:, None], batch.time)[which, 0]
        each = np.append(before.time, time)
        later = each[1:] > each[:-1]  # than the row before: another scan
        if later.any():
            begins = np.append(True, later)
            moving = accelerations(each[begins], np.vstack([before.velocity, velocity])[begins])
            of_scan = np.cumsum(later)
            unknown[:, COUPLING_FORWARD] = moving[of_scan, 0]
            unknown[:, COUPLING_RIGHT] = moving[of_scan, 1]
    return place, reading


def usual_noise(rows: Rows) -> float:
    """Return the usual 1-sigma of the white noise, map's unit."""
    return math.sqrt(statistics.median(rows.noise.tolist()))


def _loads(
    batch: Batch, which: Integers, field_map: AnyMap, errors: int, channel: Integers, rough: Array
) -> Array:
    """Return `Rows.load` (L, n, U) of rows `which` (n,) of a batch, with a channel each: map
    errors in units of their own 1-sigmas, those of this scan's channels or beams first; what a
    grid leaves out is in proportion to how rough the map is there, `rough` (L,) as
    `Models.shapes` has it."""
    maps = channels_of(field_map)
    place = batch.latitude[which], batch.longitude[which]
    own = by_channel(field_map, channel, FieldMap.sigma_at, *place)
    usual = np.array([one.usual_sigma for one in maps])[channel]
    ratio = np.where(
        (usual > 0.0) & np.isfinite(own), own / np.where(usual > 0.0, usual, 1.0), 1.0
    )
    layout, of_row = batch.layout, channel
    if layout is not None:
        of_row = layout.index[which]
        if layout.of_one_potential is not None:
            ratio = ratio * np.sqrt(shares(layout.of_one_potential))[channel]
    ratio = np.repeat(ratio[None], len(rough), axis=0)
    for k in np.flatnonzero(rough > 0.0):
        here = by_channel(field_map, channel, roughness_at, *place)
        ratio[k] = np.where(np.isfinite(here), here / rough[k], 1.0)
    load = np.zeros((len(rough), len(which), errors))
    load[:, np.arange(len(which)), of_row] = ratio
    return load
