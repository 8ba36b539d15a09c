"""The filter of a node from its start on: samples, what is published of them, and what survives a
restart."""

import math
from collections.abc import Iterator

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped

from isogal.arrays import Array
from isogal.fields.known_gravity import known_gravity
from isogal.fusion.alignment import Alignment
from isogal.fusion.assumed import filter_model
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import PositionFix, SampleNoise
from isogal.fusion.prediction import FilterDivergenceError
from isogal.fusion.sample_stream import SampleStream
from isogal.fusion.segment import AT_ONCE
from isogal.fusion.state import FilterState
from isogal.passage import Passage
from isogal.sensors.trajectory import build_trajectory
from isogal_ros.messages.checks import BadMessageError, require_later
from isogal_ros.messages.frames import map_frame
from isogal_ros.messages.ins_solution import inertial_topics
from isogal_ros.messages.stamps import from_seconds, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.checkpoint import Checkpoint
from isogal_ros.nodes.health import ERROR, WARN
from isogal_ros.nodes.stuck import TimeJumps
from ukf_fusion_node.beginning import Beginning, placed
from ukf_fusion_node.sample_checks import SampleMonitor, SampleReport
from ukf_fusion_node.settings import UkfFusionSettings

ROUNDED = 0.05
"""By which the samples may come faster than a multiple of the rate of odometry."""


class Navigation:
    """Takes IMU samples; waits for a start where nothing fits the first of them.

    Parameters
    ----------
    node : GraphNode
        Its scenario and settings; its health is told.
    """

    def __init__(self, node: GraphNode[UkfFusionSettings]) -> None:
        self._settings, self._health, self._scenario = node.settings, node.health, node.scenario
        measured = node.scenario.height.measured
        self._height = math.nan if measured else node.scenario.route.height
        self._frame = map_frame(node.scenario)
        known = known_gravity(node.scenario.gravity_field, build_trajectory(node.scenario))
        self.model = filter_model(node.scenario, known)
        of_step = node.scenario.samples_per_step
        self._has_imu = not node.scenario.ins.gives_solution
        streams = of_step > 1 and self._has_imu
        self._stream = SampleStream(node.scenario.imu.rate, of_step) if streams else None
        self._checkpoint = Checkpoint(node)
        self._beginning = Beginning(node, self.model, self._checkpoint)
        self._report = SampleReport(node, self.model.dt)
        self.navigator: InertialNavigator | None = None
        """None = it has no start yet."""
        self.ns = -1
        """Stamp of the newest state."""
        self._published = -1
        """Newest stamp published since the start."""
        self._fixed = -1
        """Stamp of the last fix, or of the start."""
        self.rate = np.zeros(3)
        """Angular rate of the newest sample, FRD."""
        self._inertial = inertial_topics(node.scenario.ins)[-1].name
        self._max_gap = from_seconds(node.settings.max_gap)
        self._longest = from_seconds(node.settings.checkpoint_age)
        """ns without samples after which nothing is known any more."""
        self.time_jumps = TimeJumps(self._max_gap)
        limits = node.settings.max_acceleration, node.settings.max_turn_rate
        # what an INS felt may well come twice, where it is at rest, or to its last digit
        noisy = (np.array(self.model.noise) > 0.0) & self._has_imu
        self._monitor = SampleMonitor(*limits, node.monotonic, noisy)
        node.watch("silent", lambda: self._monitor.silent, ERROR)
        self._warm_up()

    def _warm_up(self) -> None:
        """Compile, or load, the filter's kernels before the first sample comes."""
        start, dt = self._beginning.start, self.model.dt
        navigator = InertialNavigator(self.model, start)
        latitude, longitude, height = start.position.tolist()
        navigator.imu(dt, np.array([0.0, 0.0, -9.8]), np.zeros(3), height)
        navigator.measure(dt, PositionFix(latitude, longitude, np.eye(2) * 1e6))

    @property
    def state(self) -> FilterState:
        """The newest state."""
        assert self.navigator is not None
        return self.navigator.state

    def latest(self) -> tuple[int, FilterState, Array]:
        """Return stamp, state and angular rate, to be published.

        Samples that were found untrue are forgotten (`back`), what was published of them is not:
        until there are later ones, it is what becomes of the state until the newest stamp
        published, if the vehicle goes on as it did."""
        ns = self._published = self.reached
        assert self.navigator is not None
        ahead = ns > self.ns
        state = self.navigator.forecast(to_seconds(ns), self._height) if ahead else self.state
        return ns, state, self.rate

    @property
    def reached(self) -> int:
        """The stamp (ns) of `latest`."""
        return max(self.ns, self._published)

    def matched(self, ns: int) -> None:
        """Note the stamp of a fix that has been dealt with, or of a batch without one."""
        self._fixed = max(ns, self._fixed)

    @property
    def passage(self) -> Passage | None:
        """What has become of the error since the last fix, at the newest stamp published."""
        if self.navigator is None or self._published > self.ns or not self.aligned:
            return None
        try:
            return self.navigator.passage(to_seconds(self._fixed))
        except FilterDivergenceError:
            return None

    def require_later(self, ns: int) -> None:
        """Raise BadMessageError unless a sample's stamp is later than the newest state's and than
        the newest that was published."""
        newest = self._published
        if self.navigator is not None:
            newest = max(newest, self.ns if self._stream is None else self._stream.ns)
        require_later(ns, newest)

    def check(self, ns: int, force: Array, rate: Array, stepped: bool) -> None:
        """Look at a sample before the filter takes it, and take back those that were not true.

        Parameters
        ----------
        ns : int
            Stamp.
        force, rate : (3,) arrays
            FRD, m/s² and rad/s.
        stepped : bool
            Whether its interval is known otherwise than by its stamp.

        Raises
        ------
        BadMessageError
            It cannot be true.
        """
        untrue = self._monitor.take(force, rate)
        if untrue is not None:
            went_back = self.back(untrue.before)
            if untrue.refused:
                raise BadMessageError(untrue.why)
            if went_back:
                self._health.drop(self._inertial, untrue.why)
        self._health.concern("stuck", self._monitor.stuck)
        if self.navigator is None or stepped:
            return
        self.time_jumps.check(ns, self.ns)
        if ns - self.ns > self._longest:
            hours = to_seconds(ns - self.ns) / 3600.0
            self._give_up(f"no IMU samples for {hours:.1f} h, or a clock was set")

    def begin(self, ns: int, solution: Array | None = None) -> bool:
        """Begin with the first sample (its stamp), or with the first solution (10,) of an INS, if
        there is something to begin with; return whether it has begun at the start itself, which is
        then to be published."""
        begun = self._beginning.find(ns, solution)
        if begun is not None:
            self._use(begun.ns, begun.navigator)
        if self._stream is not None:
            self._stream.begin(self.ns)
        return begun is not None and begun.fresh

    def _use(self, ns: int, navigator: InertialNavigator) -> None:
        """Go on with another navigator, whose state is of a stamp."""
        self.navigator, self.ns, self._fixed = navigator, ns, ns
        self._report.begin()

    def awaits(self, ns: int) -> bool:
        """Whether a stamp is so little ahead of the newest state that it will be reached."""
        return self.navigator is not None and 0 < ns - self.ns <= self._max_gap

    def place(self, ns: int, pose: PoseWithCovarianceStamped) -> None:
        """Navigate from a pose on: from its stamp, or from now where that is 0; from the first
        sample if there was none. By the solution of an INS only its position counts: velocity and
        attitude go with the INS's.

        Parameters
        ----------
        ns : int
            Stamp.
        pose : PoseWithCovarianceStamped

        Raises
        ------
        BadMessageError
            The pose cannot be used, or the history does not reach its stamp.
        """
        turns = self._has_imu and (self.navigator is None or pose.pose.covariance[-1] > 0.0)
        if self.navigator is None:
            start = self._beginning.start
            self._beginning.place(ns, placed(start, pose, self._frame, turns))
            return
        if not (self.aligned or pose.pose.covariance[-1] > 0.0):
            raise BadMessageError("the variance of yaw must be positive: the heading is unknown")
        ns = ns or self.ns
        try:
            known = self.navigator.state_at(to_seconds(ns)) if ns <= self.ns else None
        except ValueError as error:
            raise BadMessageError(f"{error}; 0 = now") from None
        if known is None:
            text = f"stamp {to_seconds(ns):.1f} s is ahead of the navigator"
            raise BadMessageError(f"{text} ({to_seconds(self.ns):.1f} s); 0 = now")
        navigator = self._beginning.navigator(ns, placed(known, pose, self._frame, turns))
        try:
            navigator.follow(self.navigator)
        except FilterDivergenceError as error:
            raise BadMessageError(str(error)) from None
        self._use(self.ns, navigator)
        self._fixed = ns

    def reset(self) -> str:
        """Forget all: navigate from the scenario's start where it fits the next sample, else from
        a pose that is to come; return what it does next."""
        self._beginning.reset()
        self.navigator, self._published = None, -1
        self._health.state(WARN, "reset; waits for IMU samples")
        return "waits for a start"

    def sample(
        self,
        ns: int,
        force: Array,
        rate: Array,
        interval: float | None = None,
        declared: Array | None = None,
    ) -> Iterator[None]:
        """Take a sample: advance by each step that ends with it, and yield after each.

        Parameters
        ----------
        interval : float, optional
            s before its stamp that it is of, where that is known.
        declared : (3,) array, optional
            Variance of the rate as the sample declares it, (rad/s)²; not of a fast IMU.

        Raises
        ------
        BadMessageError
            It cannot be used.
        """
        if self._stream is None:
            gap = to_seconds(ns - self.ns)
            if interval is None:
                missing = self._report.gap(self.ns, gap)
            else:
                missing = gap - interval if gap - interval > AT_ONCE else 0.0
                self._report.gap(self.ns, gap - interval + self.model.dt)
            self._advance(ns, force, rate, missing)
            if declared is not None and self.navigator is not None:
                self.navigator.measure(to_seconds(ns), SampleNoise(declared, self.model.dt))
            yield
            return
        before = self._stream.missing
        for step in self._stream.take(ns, force, rate):
            self._advance(step.ns, step.force, step.rate, step.missing)
            self.rate = rate
            yield
        self._report.stream(self._stream, self._stream.missing - before)

    def between(self) -> tuple[int, FilterState, Array] | None:
        """Return stamp, state and angular rate of the newest sample of a fast IMU where that is
        within a step and odometry is due (`odometry_rate`); None = it is not.

        The state of the last step is carried by the samples since then; the filter takes them only
        with the step that they make."""
        stream, most, navigator = self._stream, self._settings.odometry_rate, self.navigator
        if stream is None or not stream.pending or most == 0.0:
            return None
        if navigator is None or not self.aligned:
            return None
        every = max(1, math.ceil(stream.measured_rate / most - ROUNDED))
        if stream.pending % every:
            return None
        one = stream.unfinished()
        sample = one.force, one.rate, self._height, one.missing
        try:
            return one.ns, navigator.carried(to_seconds(one.ns), *sample), stream.newest_rate
        except FilterDivergenceError:  # the step says so
            return None

    def _advance(self, ns: int, force: Array, rate: Array, missing: float) -> None:
        assert self.navigator is not None
        try:
            self.navigator.imu(to_seconds(ns), force, rate, self._height, missing)
        except FilterDivergenceError as error:
            self._give_up(str(error))
            raise BadMessageError(str(error)) from None
        self.ns, self.rate = ns, rate
        if isinstance(self.navigator, Alignment):
            self._report.alignment(self.navigator)
        self._report.step(ns, force, self.state.attitude if self.aligned else None, missing)

    def _give_up(self, why: str) -> None:
        """Navigate no longer, and go on from nothing that is known."""
        self.navigator = None
        self._report.begin()
        self._beginning.reset(why)

    @property
    def aligned(self) -> bool:
        """Whether the state may be trusted: not while it is still being aligned."""
        return self.navigator is None or self.navigator.aligned

    def back(self, samples: int) -> bool:
        """Forget the newest samples, which were not true, and return whether they are forgotten;
        of a fast IMU they are too few to matter, and stay."""
        if self.navigator is None or self._stream is not None or not samples:
            return False
        self.navigator.back(samples)
        self.ns, self.rate = from_seconds(self.navigator.time), self.navigator.sample[1]
        self.keep()
        return True

    def tell_unresolved(self) -> None:
        """Tell what is not known of the last long gap."""
        undecided = self.navigator is not None and self.aligned and self.navigator.undecided
        self._report.unresolved(self.ns, undecided)

    def unfit(self) -> None:
        """Note that a fix did not agree with the filter."""
        self._report.unfit(self.ns)

    def keep(self) -> None:
        """Write a checkpoint of the newest state and the sample that led to it, unless it is still
        being aligned."""
        assert self.navigator is not None
        if not self.aligned:
            return
        self._checkpoint.save(self.ns, (self.state, self.navigator.sample))
