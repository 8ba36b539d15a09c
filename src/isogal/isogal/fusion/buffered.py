"""A navigator that takes fixes of any age: IMU samples and states are buffered, and a late fix is
applied where it belongs.

The state at the fix's stamp is taken from the buffer, updated, and propagated again through the
buffered IMU samples and the fixes that came after: the result is exactly that of a fix that had
come on time."""

from bisect import bisect_left
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.fusion.belief import Belief, InformationUpdate, Update, UpdateResult
from isogal.fusion.gate import RejectedError
from isogal.fusion.model import FilterModel
from isogal.fusion.navigator import FilterDivergenceError, NavigatorRun, propagate
from isogal.fusion.outage import HELD, UnknownMotion, grow, keep_going, steady_sample
from isogal.fusion.state import FilterState
from isogal.inertial.dead_reckoning import dead_reckoned
from isogal.inertial.error_state import Estimate


@dataclass(slots=True, eq=False)
class _Step:
    time: float
    force: Array
    rate: Array
    height: float
    belief: Belief
    fixes: list[Update]
    missing: float = 0.0
    """s at the beginning of the interval without data."""
    change: tuple[Array, Array] | None = None
    """Of specific force and angular rate over that."""


class BufferedNavigator:
    """The filter of one run, fed sample by sample.

    Parameters
    ----------
    model : FilterModel
    state : FilterState
        One run (R = 1), at `time`.
    time : float
        s.
    horizon : float
        How old a fix may be, s.
    motion : UnknownMotion, optional
        How the vehicle may move where samples are missing.
    sample : (3,) and (3,) arrays, optional
        Specific force and angular rate of the sample that ended at `time`; None = of a vehicle
        that moves steadily.
    """

    def __init__(
        self,
        model: FilterModel,
        state: FilterState,
        time: float = 0.0,
        horizon: float = 1200.0,
        motion: UnknownMotion | None = None,
        sample: tuple[Array, Array] | None = None,
    ) -> None:
        if len(state) != 1:
            raise ValueError("BufferedNavigator navigates one run")
        self.model = model
        self.horizon = horizon
        self.motion = motion or UnknownMotion()
        before = steady_sample(state) if sample is None else sample
        self._steps: deque[_Step] = deque(
            [_Step(time, *before, float(state.position[0, 2]), Belief.sure(state.copy()), [])]
        )

    @property
    def time(self) -> float:
        """Stamp of the newest state, s."""
        return self._steps[-1].time

    @property
    def sample(self) -> tuple[Array, Array]:
        """Specific force and angular rate of the newest sample; do not change them."""
        return self._steps[-1].force, self._steps[-1].rate

    @property
    def state(self) -> FilterState:
        """The newest state (R = 1); do not change it. While it is open whether there was a
        manoeuvre in a gap, mean and covariance over both."""
        return self._steps[-1].belief.merged

    @property
    def undecided(self) -> bool:
        """Whether it is open if there was a manoeuvre in a gap."""
        return len(self._steps[-1].belief) > 1

    def propagate(
        self,
        time: float,
        specific_force: Array,
        angular_rate: Array,
        height: float,
        missing: float = 0.0,
    ) -> None:
        """Advance to `time` with the means over the interval that ends there.

        Parameters
        ----------
        specific_force, angular_rate : (3,) arrays
            Body axes, m/s², rad/s.
        height : float
            Known height at `time`, m; NaN = not known.
        missing : float
            How much of the time since the last stamp the sample does not cover, s; the covariance
            grows by what may have happened meanwhile (`isogal.fusion.outage`).

        Raises
        ------
        ValueError
            The stamp is not later than the newest, or a value is not finite; nothing is changed.
        FilterDivergenceError
            The covariance is no longer positive definite.
        """
        if not time > self.time:
            raise ValueError(f"stamp {time:.3f} s is not later than {self.time:.3f} s")
        if not (
            np.isfinite(specific_force).all()
            and np.isfinite(angular_rate).all()
            and not np.isinf(height)
        ):
            raise ValueError("IMU sample is not finite")
        new = _Step(
            time,
            np.array(specific_force, float),
            np.array(angular_rate, float),
            float(height),
            self._steps[-1].belief.copy(),
            [],
            missing,
        )
        if missing > 0.0:
            force, rate = self.sample
            new.change = new.force - force, new.rate - rate
        self._apply(new, self.time)
        self._steps.append(new)
        while len(self._steps) > 2 and self._steps[1].time < time - self.horizon:
            self._steps.popleft()

    def back(self, samples: int) -> None:
        """Forget the newest samples: they were not true. Up to one that a fix has been taken at,
        the last true one stands for them."""
        first = max(1, len(self._steps) - samples)
        while len(self._steps) > first and not self._steps[-1].fixes:
            self._steps.pop()
        true = self._steps[first - 1]
        for index in range(first, len(self._steps)):
            self._steps[index].force, self._steps[index].rate = true.force, true.rate
        self._replay(first - 1)

    def at(self, time: float, relative_to: Estimate | None = None) -> "NavigatorAt":
        """Return the navigator at a stamp, for `isogal.fix.apply_fix`; information is
        relative to an estimate (`update_information`)."""
        return NavigatorAt(self, time, relative_to)

    def update_position(
        self, time: float, latitude: float, longitude: float, covariance: Array
    ) -> UpdateResult:
        """Apply a position fix (rad; (2, 2) north-east m²) of any stamp within the horizon.

        A stamp between two IMU samples counts at the sample nearest to it if that is within half
        an interval; else the fix is carried to the next sample with the velocity there. There is
        none in a gap of more than `HELD`."""
        covariance = np.array(covariance, float)
        ahead = self._ahead(time)

        def apply(state: FilterState) -> tuple[Array, float]:
            place = np.array([latitude, longitude, state.position[0, 2]])
            if ahead > 0.0 and np.isfinite(place).all():
                place = dead_reckoned(place, state.velocity[0], ahead)
            run = NavigatorRun(state, self.model, 0)
            return run.update_position(place[0], place[1], covariance)

        return self.update(time, apply)

    def update_information(
        self, time: float, vector: Array, matrix: Array, relative_to: Estimate | None = None
    ) -> UpdateResult:
        """Apply a likelihood in information form (`isogal.fusion.navigator.update_information`)
        of any stamp within the horizon.

        Parameters
        ----------
        vector, matrix : (n,), (n, n) arrays
        relative_to : Estimate, optional
            The navigator's estimate at the stamp that the error is that of; None = as it is now.
            Where the navigator's estimate is another, or becomes another because an older fix
            comes later, the information is carried over to it. A stamp between two samples
            counts as in `update_position`.
        """
        if relative_to is not None and (ahead := self._ahead(time)) > 0.0:
            place = dead_reckoned(relative_to.position, relative_to.velocity, ahead)
            relative_to = relative_to._replace(position=place)
        told, gate = (np.array(vector), np.array(matrix)), self.model.gate(len(vector))
        return self.update(time, InformationUpdate(*told, relative_to, gate))

    def widen(self, time: float, covariance: Array) -> UpdateResult:
        """Add (7, 7) to the covariance of a batch's states at any stamp within the horizon: the
        navigator was found lost."""

        def apply(state: FilterState) -> tuple[Array, float]:
            NavigatorRun(state, self.model, 0).widen(covariance)
            return np.zeros(2), 0.0

        return self.update(time, apply)

    def _ahead(self, time: float) -> float:
        """Return by how much (s) the sample that a stamp counts at is later, 0 where that is less
        than half an interval."""
        times = [step.time for step in self._steps]
        index = bisect_left(times, time - 0.5 * self.model.dt)
        later = times[index] - time if index < len(times) else 0.0
        return later if later > 0.5 * self.model.dt + 1e-6 else 0.0

    def update(self, time: float, update: Update) -> UpdateResult:
        """Apply an update of the state at a stamp within the horizon; a stamp between two IMU
        samples counts as in `update_position`."""
        times = [step.time for step in self._steps]
        late = self.time - time
        if not np.isfinite(time) or time < times[0] - 0.5 * self.model.dt:
            return UpdateResult.refused(
                f"fix of {time:.1f} s is older than the buffer ({times[0]:.1f} s)", late
            )
        index = bisect_left(times, time - 0.5 * self.model.dt)
        if index == len(times):
            return UpdateResult.refused(
                f"fix of {time:.1f} s is ahead of the navigator ({self.time:.1f} s)", late
            )
        target = self._steps[index]
        gap = target.missing if target.missing > HELD and self._ahead(time) > 0.0 else 0.0
        if gap > 0.0 and time < times[index - 1] + gap:
            return UpdateResult.refused(
                f"fix of {time:.1f} s: there are no inertial data of then", late
            )
        before = target.belief.copy()
        try:
            innovation, nis = target.belief.apply(update)
            target.fixes.append(update)
            self._replay(index)
        except RejectedError as error:
            # kept: with an older fix that comes later it may be within the gate
            target.fixes.append(update)
            return UpdateResult(False, str(error), error.innovation, error.nis, late, True)
        except (ValueError, FilterDivergenceError) as error:
            if target.fixes and target.fixes[-1] is update:
                target.fixes.pop()
            target.belief = before
            self._replay(index)
            return UpdateResult.refused(str(error), late)
        return UpdateResult(True, None, innovation, nis, late)

    def _replay(self, index: int) -> None:
        for i in range(index + 1, len(self._steps)):
            current = self._steps[i]
            current.belief = self._steps[i - 1].belief.copy()
            self._apply(current, self._steps[i - 1].time)
            for update in current.fixes:
                with suppress(RejectedError):
                    current.belief.apply(update)

    def _apply(self, step: _Step, start: float) -> None:
        interval = step.time - start
        if step.change is not None:
            if step.missing > HELD:
                interval -= step.missing
            self._bridge(step, step.change)
        model = (
            self.model
            if abs(interval - self.model.dt) < 1e-6
            else replace(self.model, dt=interval)
        )
        belief = step.belief
        force, rate = (
            np.repeat(sample[None, None], len(belief), axis=0)
            for sample in (step.force, step.rate)
        )
        propagate(belief.state, model, force, rate, np.array([step.height]))

    def _bridge(self, step: _Step, change: tuple[Array, Array]) -> None:
        """Carry a belief over missing samples."""
        steady, manoeuvre = (self.motion.seen(change, which) for which in (False, True))
        if step.missing <= HELD:
            for state in step.belief.each():
                grow(state, 0, step.missing, steady)
            return
        step.belief = Belief.sure(step.belief.merged)
        keep_going(step.belief.state, self.model, step.missing, step.height)
        motions = [steady]
        if manoeuvre != steady:
            step.belief = step.belief.divided(self.motion.log_probabilities(step.missing))
            motions.append(manoeuvre)
        for row, motion in enumerate(motions):
            grow(step.belief.state, row, step.missing, motion)


@dataclass(frozen=True, slots=True, eq=False)
class NavigatorAt:
    """A buffered navigator at one stamp (a `isogal.fix.FixTarget`)."""

    navigator: BufferedNavigator
    time: float
    """s."""
    relative_to: Estimate | None = None
    """The estimate that information is relative to; None = the navigator's as it is now."""

    def assume_map_error(self, sigma: float, length: float) -> UpdateResult:
        """See `isogal.fusion.navigator.assume_map_error`."""

        def apply(state: FilterState) -> tuple[Array, float]:
            NavigatorRun(state, self.navigator.model, 0).assume_map_error(sigma, length)
            return np.zeros(2), 0.0

        return self.navigator.update(self.time, apply)

    def widen(self, covariance: Array) -> UpdateResult:
        """See `BufferedNavigator.widen`."""
        return self.navigator.widen(self.time, covariance)

    def update_information(self, vector: Array, matrix: Array) -> UpdateResult:
        """See `BufferedNavigator.update_information`."""
        return self.navigator.update_information(self.time, vector, matrix, self.relative_to)

    def update_position(
        self, latitude: float, longitude: float, covariance: Array
    ) -> UpdateResult:
        """See `BufferedNavigator.update_position`."""
        return self.navigator.update_position(self.time, latitude, longitude, covariance)
