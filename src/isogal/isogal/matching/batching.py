"""From scans, one by one, to batches: the only place that knows when a batch is due and what the
navigator's error does over it."""

import math
from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.fields.measured import measured_field
from isogal.inertial.error_state import BATCH_STATES, HORIZONTAL_STATES
from isogal.matching.expansion import Expansion, expansion_of
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
from isogal.matching.residual_gravity import UNMOVED
from isogal.matching.scans import Collected, Scan, Scans
from isogal.matching.transitions import (
    Bridge,
    across,
    backwards,
    carried,
)
from isogal.matrices import symmetric
from isogal.passage import History
from isogal.scenario import Assumed, Gravimeter, Height
from isogal.scenario import Matcher as MatcherSettings
from isogal.sensors.lag import Lag
from isogal.sensors.platform import mean_error
from isogal.sensors.reduction import Reduction, State


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
    settings : scenario.Matcher
    reduction : Reduction
        How the readings were reduced; says how the navigator's error got into them.
    context : int
        How many scans before the batch the matcher wants to see as well.
    instrument : scenario.Gravimeter, optional
        What is known of readings that are one number: how late they are, and their noise beside
        the white one; default: nothing.
    height : scenario.Height, optional
        What is known of the height that readings are reduced with; default: that it is exact.
    expansion : Expansion, optional
        Of readings that are more than one number.
    marks : int
        How many empty scans (`mark`) there may be in a batch beside its own.
    """

    def __init__(
        self,
        settings: MatcherSettings,
        reduction: Reduction,
        context: int = 0,
        instrument: Gravimeter | None = None,
        height: Height | None = None,
        expansion: Expansion | None = None,
        marks: int = 0,
    ) -> None:
        self.settings = settings
        self.expansion = expansion
        self.reduction = reduction
        self.instrument = instrument or Gravimeter()
        self._height = height or Height()
        shape = (1, 1) if expansion is None else expansion.shape
        lag = Lag.of(self.instrument)
        self._filters = shape[0] == 1 and able(settings.name, "takes_filters")
        self._lag = lag._replace(filter_time=0.0) if self._filters else lag
        self._longest = settings.batch_length + context + marks
        older = math.ceil(self._lag.reach / self.instrument.interval)
        self._scans = Scans(self._longest + older, shape)
        self._count = 0
        self._unused = 0
        self._bridge: Bridge | None = None
        self._correction: Array | None = np.zeros(BATCH_STATES)
        self.gravity = UNMOVED
        """What moves the navigator within a batch; nothing, unless it is set."""

    @classmethod
    def of(cls, assumed: Assumed, context: int = 0, marks: int = 0) -> "BatchBuilder":
        """Return the builder of a scenario's batches for a matcher with a context, with room for
        marks; raises InputError where the scenario cannot be used."""
        return cls(
            assumed.matcher,
            measured_field(assumed).reduction(assumed),
            context,
            assumed.gravimeter,
            assumed.height.together(assumed.heights or ()),
            expansion_of(assumed),
            marks,
        )

    @property
    def ready(self) -> bool:
        """Whether the newest scan ends a batch that has not been built yet."""
        return self._unused > 0 and fix_due(self._count, self.settings)

    @property
    def whole(self) -> bool:
        """Whether there are as many scans as a batch has: not where it began amid a run."""
        return len(self._scans) >= self.settings.batch_length

    @property
    def has_new(self) -> bool:
        """Whether any reading has come since the last batch."""
        newest = self._scans.readings(self._scans.last(self._unused))
        return bool(np.isfinite(newest[..., 0]).any())

    @property
    def collected(self) -> Collected:
        """What has been collected."""
        scans = tuple(self._scans[k] for k in range(len(self._scans)))
        return Collected(
            scans, self._count, self._unused, self._bridge, self.gravity, self._correction
        )

    def restore(self, collected: Collected) -> None:
        """Go on from what an earlier builder of the same settings had collected."""
        self._scans = Scans(self._scans.most, self._scans.shape)
        self._scans.extend(collected.scans)
        self._count, self._unused = collected.count, collected.unused
        self._bridge, self._correction = collected.bridge, collected.correction
        self.gravity = collected.gravity or self.gravity

    def begin(self, earlier: int) -> None:
        """Note, before the first scan, how many there have been before: batches then end where
        they would have ended."""
        if self._count == 0:
            self._count = earlier

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
        before = self._scans[-1].level if len(self._scans) else height
        level = surely_at(self._height, before, height)
        place = latitude, longitude, velocity
        self._scans.add(Scan(time, *place, reading, sigma, offset, height, level))
        self._count += 1
        self._unused += 1

    def mark(self, end: "BatchBuilder") -> bool:
        """Add an empty scan where another builder's newest one is, unless this one has its newest
        there: the batch is to end there. It is none of those that batches are counted by. Return
        whether the batch can end there: this one has none after it."""
        newest, own = end._scans[-1], self._scans[-1]
        if newest.time > own.time + 1e-9:
            self._scans.add(replace(newest, reading=np.nan, sigma=self.instrument.sigma))
            self._unused = min(self._unused + 1, len(self._scans))
        return own.time <= newest.time + 1e-9

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
        if not len(self._scans):
            return
        if self._bridge is not None:
            self._scans.forget_readings(self._bridge.time)
        newest = self._scans[-1]
        at = newest.latitude, newest.velocity, begin
        self._bridge = Bridge.of(end, carried(before, at, end), after)

    def correct(self, time: float, jump: Array) -> None:
        """Carry a jump of the navigator at `time` back to the scans already collected.

        Parameters
        ----------
        jump : (7,) array
            After minus before, in a batch's states (`isogal.inertial.error_state`). Older
            positions move by what the jump means back then, and readings by what their reduction
            would have been with the better estimate.
        """
        if self._correction is not None:
            self._correction = self._correction + jump
        which = self._scans.until(time + 1e-9)
        if which.start == which.stop:
            return
        latitude, longitude, velocity, times = self._scans.track(which)
        plain = backwards(latitude, velocity, times, time)
        every, _ = across(self._bridge, plain, latitude, velocity, times, time)
        moved = (every @ jump)[:, :HORIZONTAL_STATES]
        at_scan = self._jacobian(latitude, longitude, velocity)
        self._scans.move(which, moved, (at_scan * moved).sum(axis=1))

    def build(self, prior: Array) -> Batch:
        """Return the batch that the newest scan ends.

        Parameters
        ----------
        prior : (7, 7) array
            The navigator's covariance there, of a batch's states.
        """
        scans = self._scans.last(self._longest)
        latitude, longitude, velocity, times = self._scans.track(scans)
        prior = symmetric(prior)
        backward, every, apart = self._errors(latitude, velocity, times, times[-1], prior)
        at_scan = self._jacobian(latitude, longitude, velocity)
        by_error, beside = (_of_rows(part, at_scan) for part in (every, apart))
        sigma, readings = self._scans.sigmas(scans), self._scans.readings(scans)
        offset = mean_error(self.instrument) + self._scans.offsets(scans)
        new = min(self._unused, len(times))
        self._unused = 0
        correction, self._correction = self._correction, np.zeros(BATCH_STATES)
        batch = Batch(
            time=times,
            latitude=latitude,
            longitude=longitude,
            velocity=velocity,
            reading=readings[:, 0, 0] - offset,
            sigma=sigma,
            covariance=prior,
            by_error=by_error,
            backward=backward,
            new=new,
            apart=beside,
            instrument=InstrumentErrors(
                self._noise(scans, velocity, times),
                self.instrument.bias_walk,
                self.instrument.delay_sigma,
                self._added(times, latitude, longitude, self._scans.heights(scans), velocity),
                self.instrument.filter_time if self._filters else 0.0,
            ),
            history=History(correction),
            cut=0 if self._bridge is None else int((times < self._bridge.time).sum()),
        )
        if self._lag.mean > 0.0:
            batch = self._late(batch, prior)
        if self.expansion is None:
            return batch
        return self.expansion.expand(batch, readings, offset)

    def _noise(self, scans: slice, velocity: Array, times: Array) -> Parameters | None:
        """Return what readings have beside white noise, errors of their height included."""
        states = noise_states(self.instrument, times, velocity)
        if self._height.measured:
            latitude, longitude, *_ = self._scans.track(scans)
            up = self._scans.heights(scans)
            at = State(latitude, longitude, up, velocity[:, 0], velocity[:, 1])
            states += height_states(self._height, self.reduction, at, self._scans.levels(scans))
        return joined(states)

    def _late(self, batch: Batch, prior: Array) -> Batch:
        """Return a batch of readings that are late, each where the vehicle was when it
        was sensed (docs/mathematics.md, section 4.7)."""
        every_scan = self._scans.every
        latitude, longitude, velocity, times = self._scans.track(every_scan)
        path = Path(times, latitude, longitude, self._scans.heights(every_scan), velocity)
        seen, reading = sensed(path, batch.time, batch.reading, self._lag, self.reduction)
        latitude, longitude = np.asarray(seen.latitude), np.asarray(seen.longitude)
        velocity = np.stack([seen.v_north, seen.v_east], axis=-1)
        told_of = batch.time - self._lag.mean
        end = float(batch.time[-1])
        _, every, apart = self._errors(latitude, velocity, told_of, end, prior)
        at_scan = self._jacobian(latitude, longitude, velocity)
        added = self._added(told_of, latitude, longitude, np.asarray(seen.height), velocity)
        return replace(
            batch,
            latitude=latitude,
            longitude=longitude,
            velocity=velocity,
            reading=reading,
            by_error=_of_rows(every, at_scan),
            apart=_of_rows(apart, at_scan),
            instrument=replace(batch.instrument, added=added),
            end_place=batch.end,
        )

    def _errors(
        self,
        latitude: Array,
        velocity: Array,
        times: Array,
        end: float,
        prior: Array,
    ) -> tuple[Array, Array, Array]:
        """Return `backwards` of scans, and both of `across`, what gravity moves with the latter;
        `prior` (7, 7) is the navigator's covariance at the end."""
        plain = backwards(latitude, velocity, times, end)
        every, apart = across(self._bridge, plain, latitude, velocity, times, end)
        moved = self.gravity.apart(velocity, times, end, prior)
        return plain, every, np.concatenate([apart, moved], axis=2)

    def _added(
        self, time: Array, latitude: Array, longitude: Array, height: Array, velocity: Array
    ) -> Array | None:
        """Return (T,) what the reduction adds to readings at the scans; None of readings that are
        several numbers.

        Of heights that the vehicle has gone to: a model of late readings that took for its motion
        what errors of a measured height change by would foretell these errors, and be believed."""
        if self._scans.shape[0] > 1:
            return None
        up = of_vehicle(self._height, time, height)
        at = State(latitude, longitude, up, velocity[:, 0], velocity[:, 1])
        return self.reduction.reduce(np.zeros(len(latitude)), at)

    def _jacobian(self, latitude: Array, longitude: Array, velocity: Array) -> Array:
        """Return (T, 4) d(reading)/d(navigator's error at the scan) by the reduction; its height
        is known.
        """
        return self.reduction.jacobian(
            State(latitude, longitude, 0.0, velocity[:, 0], velocity[:, 1])
        )


def _of_rows(errors: Array, jacobian: Array) -> Array:
    """Return (T, 3, K) position errors and what the reduction adds to readings, of errors at the
    scans (T, 7, K) and the reduction's Jacobian (T, 4)."""
    reading = np.einsum("ti,tij->tj", jacobian, errors[:, :4])
    return np.concatenate([errors[:, :2], reading[:, None]], axis=1)
