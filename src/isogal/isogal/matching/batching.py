"""From scans, one by one, to batches: the only place that knows when a batch is due and what the
navigator's error does over it."""

import math
from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fields.measured import measured_field
from isogal.inertial.error_state import BATCH_STATES, HORIZONTAL_STATES
from isogal.matching.expansion import expansion_of
from isogal.matching.interfaces import Batch
from isogal.matching.parameters import InstrumentErrors, Parameters
from isogal.matching.path import Path, sensed
from isogal.matching.reading_noise import (
    height_states,
    joined,
    noise_states,
    of_vehicle,
    surely_at,
)
from isogal.matching.registry import able
from isogal.matching.scans import Collected, Scans
from isogal.matching.transitions import (
    Bridge,
    across,
    backwards,
    carried,
)
from isogal.matrices import symmetric
from isogal.passage import History
from isogal.scenario import Assumed
from isogal.scenario import Matcher as MatcherSettings
from isogal.sensors.lag import Lag
from isogal.sensors.platform import mean_error
from isogal.sensors.reduction import State


def fix_due(scans: int, settings: MatcherSettings) -> bool:
    """Whether a batch ends with the scan that makes `scans` of them (counted from 1)."""
    return (
        scans >= settings.batch_length
        and (scans - settings.batch_length) % settings.scans_between_fixes == 0
    )


class BatchBuilder:
    """Collects the scans of one run.

    Parameters
    ----------
    assumed : Assumed
        Of one field: section `matcher`, how its readings are reduced, and what is known of them
        and of the height that they are reduced with.
    context : int
        How many scans before the batch the matcher wants to see as well.
    marks : int
        How many empty scans (`mark`) there may be in a batch beside its own.

    Raises
    ------
    InputError
        What is assumed cannot be used.
    """

    def __init__(self, assumed: Assumed, context: int = 0, marks: int = 0) -> None:
        self.settings, self.instrument = assumed.matcher, assumed.gravimeter
        self.expansion = expansion_of(assumed)
        self.reduction = measured_field(assumed).reduction(assumed)
        self._height = assumed.height.together(assumed.heights or ())
        shape = (1, 1) if self.expansion is None else self.expansion.shape
        lag = Lag.of(self.instrument)
        self._filters = shape[0] == 1 and able(self.settings.name, "takes_filters")
        self._lag = lag._replace(filter_time=0.0) if self._filters else lag
        self._longest = self.settings.batch_length + context + marks
        self._kept = self._longest + math.ceil(self._lag.reach / self.instrument.interval)
        self.collected = Collected(Scans.none(shape))
        """What there is so far; may be set to what an earlier builder had."""

    @property
    def ready(self) -> bool:
        """Whether the newest scan ends a batch that has not been built yet."""
        return self.collected.unused > 0 and fix_due(self.collected.count, self.settings)

    @property
    def whole(self) -> bool:
        """Whether there are as many scans as a batch has: not where it began amid a run."""
        return len(self.collected.scans.time) >= self.settings.batch_length

    @property
    def has_new(self) -> bool:
        """Whether the newest batch has a reading that no earlier one has used."""
        scans, unused = self.collected.scans, self.collected.unused
        return unused > 0 and bool(np.isfinite(scans.reading[-unused:, :, 0]).any())

    def begin(self, earlier: int) -> None:
        """Note, before the first scan, how many there have been before: batches then end where
        they would have ended."""
        if self.collected.count == 0:
            self.collected = replace(self.collected, count=earlier)

    def add_scan(
        self,
        time: float,
        latitude: float,
        longitude: float,
        velocity: Array,
        reading: float | Array,
        sigma: float,
        offset: float = 0.0,
        height: float = 0.0,
    ) -> None:
        """Add a scan.

        Parameters
        ----------
        time : float
            s, later than that of the scan before.
        latitude, longitude : float
            rad, where the navigator believes to be.
        velocity : (2,) array
            Its velocity north and east, m/s.
        reading : float or array
            Reduced with the navigator's state of the scan, map's unit; of more than one number
            those of `Expansion.shape`. NaN = none.
        sigma : float
            1-sigma of its white noise.
        offset : float
            What is known to be wrong with it.
        height : float
            m.
        """
        earlier = self.collected.scans.level
        level = surely_at(self._height, earlier[-1] if len(earlier) else height, height)
        if isinstance(reading, np.ndarray):
            reading = reading.reshape(self.collected.scans.reading.shape[1:])
        place = latitude, longitude, velocity
        self._add(1, time, *place, reading, sigma, offset, height, level)

    def _add(self, counted: int, *scan: float | Array) -> None:
        """Add a scan, which counts or not."""
        known = self.collected
        self.collected = replace(
            known,
            scans=known.scans.added(self._kept, *scan),
            count=known.count + counted,
            unused=known.unused + 1,
        )

    def mark(self, end: "BatchBuilder") -> bool:
        """Add an empty scan where another builder's newest one is, unless this one has its newest
        there: the batch is to end there. It is none of those that batches are counted by. Return
        whether the batch can end there: this one has none after it."""
        newest, own = end.collected.scans.part(slice(-1, None)), self.collected.scans.time
        time = float(newest.time[0])
        if time > own[-1] + 1e-9:
            nothing = {"reading": np.array([np.nan]), "sigma": np.array([self.instrument.sigma])}
            self._add(0, *(column[0] for column in newest._replace(**nothing)))
        return bool(own[-1] <= time + 1e-9)

    def bridge(self, begin: float, before: Array, end: float, after: Array) -> None:
        """Note that there were no inertial data between two times: scans on either side then no
        longer hang together by the navigator's track alone (docs/mathematics.md, section 4.8).
        Readings before an earlier gap are given up.

        Parameters
        ----------
        begin, end : float
            s.
        before, after : (7, 7) arrays
            The navigator's covariance at both.
        """
        known = self.collected
        if not len(known.scans.time):
            return
        scans = known.scans
        if known.bridge is not None:
            given_up = scans.time < known.bridge.time
            reading = np.where(given_up[:, None, None], np.nan, scans.reading)
            scans = scans._replace(reading=reading)
        at = float(scans.latitude[-1]), scans.velocity[-1], begin
        bridge = Bridge.of(end, carried(before, at, end), after)
        self.collected = replace(known, scans=scans, bridge=bridge)

    def correct(self, time: float, jump: Array) -> None:
        """Carry a jump of the navigator at `time` back to the scans already collected.

        Parameters
        ----------
        jump : (7,) array
            After minus before, in a batch's states (`isogal.inertial.error_state`). Older
            positions move by what the jump means back then, and readings by what their reduction
            would have been with the better estimate.
        """
        known = self.collected
        which = slice(0, int(np.searchsorted(known.scans.time, time + 1e-9, side="right")))
        scans = known.scans
        if which.stop:
            scans = self._corrected(which, time, jump)
        self.collected = replace(known, scans=scans, correction=known.correction + jump)

    def _corrected(self, which: slice, time: float, jump: Array) -> Scans:
        """Return the scans, some of them moved by a jump at a time."""
        scans = Scans(*(column.copy() for column in self.collected.scans))
        some = scans.part(which)
        plain = backwards(some.latitude, some.velocity, some.time, time)
        bridge = self.collected.bridge
        every, _ = across(bridge, plain, some.latitude, some.velocity, some.time, time)
        moved = (every @ jump)[:, :HORIZONTAL_STATES]
        at_scan = self._jacobian(some.latitude, some.longitude, some.velocity)
        some.reading[..., 0] += (at_scan * moved).sum(axis=1)[:, None]
        north, east = metres_per_radian(some.latitude)
        some.latitude[:] += moved[:, 0] / north
        some.longitude[:] += moved[:, 1] / east
        some.velocity[:] += moved[:, 2:]
        return scans

    def build(self, prior: Array) -> Batch:
        """Return the batch that the newest scan ends.

        Parameters
        ----------
        prior : (7, 7) array
            The navigator's covariance there, of a batch's states.
        """
        known, prior = self.collected, symmetric(prior)
        scans = known.scans.part(slice(-self._longest, None))
        times, latitude, longitude, velocity = scans[:4]
        end = float(times[-1])
        offset = mean_error(self.instrument) + scans.offset
        reading, height, told_of = scans.reading[:, 0, 0] - offset, scans.height, times
        backward = plain = backwards(latitude, velocity, times, end)
        late = self._lag.mean > 0.0
        if late:  # each is where the vehicle was when it was sensed (docs/mathematics.md, 4.7)
            every_scan = known.scans
            track = every_scan.latitude, every_scan.longitude, every_scan.height
            path = Path(every_scan.time, *track, every_scan.velocity)
            at, reading = sensed(path, times, reading, self._lag, self.reduction)
            latitude, longitude = np.asarray(at.latitude), np.asarray(at.longitude)
            velocity = np.stack([at.v_north, at.v_east], axis=-1)
            height, told_of = np.asarray(at.height), times - self._lag.mean
            plain = backwards(latitude, velocity, told_of, end)
        every, apart = across(known.bridge, plain, latitude, velocity, told_of, end)
        moved = known.gravity.apart(velocity, told_of, end, prior)
        at_scan = self._jacobian(latitude, longitude, velocity)
        batch = Batch(
            time=times,
            latitude=latitude,
            longitude=longitude,
            velocity=velocity,
            reading=reading,
            sigma=scans.sigma,
            covariance=prior,
            by_error=_of_rows(every, at_scan),
            backward=backward,
            new=min(known.unused, len(times)),
            apart=_of_rows(np.concatenate([apart, moved], axis=2), at_scan),
            instrument=InstrumentErrors(
                self._noise(scans),
                self.instrument.bias_walk,
                self.instrument.delay_sigma,
                self._reduced(told_of, latitude, longitude, height, velocity),
                self.instrument.filter_time if self._filters else 0.0,
            ),
            history=History(known.correction),
            cut=0 if known.bridge is None else int((times < known.bridge.time).sum()),
            end_place=(float(scans.latitude[-1]), float(scans.longitude[-1])) if late else None,
        )
        self.collected = replace(known, unused=0, correction=np.zeros(BATCH_STATES))
        if self.expansion is None:
            return batch
        return self.expansion.expand(batch, scans.reading, offset)

    def _noise(self, scans: Scans) -> Parameters | None:
        """Return what readings have beside white noise, errors of their height included."""
        states = noise_states(self.instrument, scans.time, scans.velocity)
        if self._height.measured:
            at = State(scans.latitude, scans.longitude, scans.height, *scans.velocity.T)
            states += height_states(self._height, self.reduction, at, scans.level)
        return joined(states)

    def _reduced(
        self, time: Array, latitude: Array, longitude: Array, height: Array, velocity: Array
    ) -> Array | None:
        """Return (T,) what the reduction adds to readings at the scans; None of readings that are
        several numbers.

        Of heights that the vehicle has gone to: a model of late readings that took for its motion
        what errors of a measured height change by would foretell these errors, and be believed."""
        if self.collected.scans.reading.shape[1] > 1:
            return None
        up = of_vehicle(self._height, time, height)
        at = State(latitude, longitude, up, *velocity.T)
        return self.reduction.reduce(np.zeros(len(latitude)), at)

    def _jacobian(self, latitude: Array, longitude: Array, velocity: Array) -> Array:
        """Return (T, 4) d(reading)/d(navigator's error at the scan) by the reduction; its height
        is known."""
        return self.reduction.jacobian(State(latitude, longitude, 0.0, *velocity.T))


def _of_rows(errors: Array, jacobian: Array) -> Array:
    """Return (T, 3, K) position errors and what the reduction adds to readings, of errors at the
    scans (T, 7, K) and the reduction's Jacobian (T, 4)."""
    reading = np.einsum("ti,tij->tj", jacobian, errors[:, :4])
    return np.concatenate([errors[:, :2], reading[:, None]], axis=1)
