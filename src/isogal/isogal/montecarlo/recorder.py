"""The record of the closed loop, collected while it runs."""

from collections.abc import Sequence

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.records import RunDetail, Runs
from isogal.fix import Candidates, Status
from isogal.fusion.measurements import Outcome
from isogal.fusion.state import FilterState
from isogal.maps.channels import RouteMap, channels_of
from isogal.navigator import Applied
from isogal.sensors.trajectory import Trajectory


class Recorder:
    """Arrays of R runs that are filled as the loop goes on and become a record (`Runs`).

    Parameters
    ----------
    trajectory : Trajectory
    index : (K,) array
        IMU intervals before each navigation state that is recorded: the start, then each scan.
    ends : (B,) array
        Indices of the states at which a batch ends, into `index`.
    runs : int
        R.
    smoothed : bool
        Whether smoothed states are recorded, too.
    """

    def __init__(
        self, trajectory: Trajectory, index: Integers, ends: Integers, runs: int, smoothed: bool
    ) -> None:
        self.time = trajectory.time[index]
        self.latitude, self.longitude = trajectory.latitude[index], trajectory.longitude[index]
        self.ends = ends
        states, batches = (runs, len(index)), (runs, len(ends))
        which = ["", "smoothed_"] if smoothed else [""]
        self._states = {f"{one}error": np.full((*states, 2), np.nan) for one in which}
        self._states |= {f"{one}covariance": np.full((*states, 2, 2), np.nan) for one in which}
        self._fix_error = np.full((*batches, 2), np.nan)
        self._fix_covariance = np.full((*batches, 2, 2), np.nan)
        self._fix_seconds = np.zeros(batches)
        self._status = np.full(batches, Status.DECLINED.value, dtype=np.object_)
        self._reason = np.full(batches, "no batch: not aligned, or no reading", dtype=np.object_)
        # for the figures of the first run
        self._candidates: list[Candidates | None] = []
        self._reading = np.full(len(index) - 1, np.nan)
        self._seen = np.full((len(index) - 1, 2), np.nan)

    def write_track(self, run: int, first: int, track: Array) -> None:
        """Write a run's states from a state on (`isogal.fusion.prediction.TRACK_COLUMNS`)."""
        self._write("", run, first, track[:, :2], track[:, [10, 11, 11, 12]])

    def write_smoothed(self, run: int, first: int, states: Sequence[FilterState]) -> None:
        """Write smoothed states of a run, from a state on."""
        places = np.array([state.position[:2] for state in states])
        covariances = np.array([state.covariance[:2, :2] for state in states])
        self._write("smoothed_", run, first, places, covariances)

    def _write(self, which: str, run: int, first: int, places: Array, covariance: Array) -> None:
        here = slice(first, first + len(places))
        truth = self.latitude[here], self.longitude[here]
        self._states[f"{which}error"][run, here] = horizontal_difference(
            places[:, 0], places[:, 1], *truth
        )
        self._states[f"{which}covariance"][run, here] = covariance.reshape(-1, 2, 2)

    def write_readings(self, scans: Integers, readings: Array, track: Array) -> None:
        """Write the first run's readings (K,) or (K, C) of some scans, and its track there."""
        self._reading[scans] = readings.reshape(len(readings), -1)[:, 0]  # the first channel
        self._seen[scans] = track[:, :2]

    def write_fix(self, run: int, batch: int, applied: Applied) -> None:
        """Write a run's fix of a batch, and whether the navigator rejected it or a share of it."""
        fix = applied.fix
        rejected = [one for one in applied.innovations if one.outcome is Outcome.REJECTED]
        status = Status.REJECTED if rejected else fix.status
        reason = fix.reason
        if rejected:
            reason = f"rejected by the navigator: {rejected[-1].reason}"
        self._fix_seconds[run, batch] = applied.seconds
        self._status[run, batch], self._reason[run, batch] = status.value, reason or ""
        if fix.published:
            truth = [np.interp(fix.time, self.time, x) for x in (self.latitude, self.longitude)]
            place = fix.latitude, fix.longitude
            self._fix_error[run, batch] = horizontal_difference(*place, *truth)
            self._fix_covariance[run, batch] = fix.covariance
        if run == 0:
            self._candidates.append(fix.candidates)

    def record(self, unaided_error: Array, field_map: RouteMap) -> Runs:
        """Return all that was written, with the error of the unaided navigators (R, K, 2)."""
        return Runs(
            time=self.time,
            latitude=self.latitude,
            longitude=self.longitude,
            **self._states,
            unaided_error=unaided_error,
            fix_time=self.time[self.ends],
            fix_error=self._fix_error,
            fix_covariance=self._fix_covariance,
            fix_status=self._status.astype(np.str_),
            fix_reason=self._reason.astype(np.str_),
            posterior_error=self._states["error"][:, self.ends],
            posterior_covariance=self._states["covariance"][:, self.ends],
            fix_seconds=self._fix_seconds,
            detail=self._detail(field_map),
        )

    def _detail(self, field_map: RouteMap) -> RunDetail:
        shown = channels_of(field_map)[0]
        used = np.isfinite(self._seen[:, 0])  # the first of several fields has not each scan
        return RunDetail(
            scan_time=self.time[1:][used],
            reading=self._reading[used],
            map_value=shown.value(self.latitude[1:][used], self.longitude[1:][used]),
            map_value_navigator=shown.value(*self._seen[used].T),
            **RunDetail.flatten(self._candidates),
        )
