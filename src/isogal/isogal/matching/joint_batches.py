"""From scans of several fields, one by one, to batches with a common end.

Each field has a `BatchBuilder` of its own; the field with the least time between its fixes says
when a batch ends, for all of them. Where another field has no scan at that stamp, an empty one
marks it, so that its batch ends there, too."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from isogal.arrays import Array
from isogal.fields.known_gravity import KnownGravity, residual_gravity
from isogal.maps.channels import AnyMap
from isogal.matching.batching import BatchBuilder
from isogal.matching.interfaces import Batch, Fix, Matcher, SecondaryBatch
from isogal.matching.residual_gravity import ResidualGravity
from isogal.matching.scans import Collected
from isogal.matching.update_schedule import UpdateSchedule
from isogal.scenario import Assumed
from isogal.sensors.trajectory import build_trajectory

MapNear = Callable[[int, Batch], AnyMap]
"""Returns the map of a field around a batch."""


class JointBatches:
    """Collects the scans of one run.

    Parameters
    ----------
    builders : sequence of BatchBuilder
        Of each field.
    lead : int
        See `isogal.matching.update_schedule.UpdateSchedule`.
    gravity : KnownGravity, optional
        What the navigator knows of horizontal gravity; default: that it is normal gravity's.
    """

    def __init__(
        self,
        builders: Sequence[BatchBuilder],
        lead: int = 0,
        gravity: KnownGravity | None = None,
    ) -> None:
        self.builders, self._lead = tuple(builders), lead
        self._gravity = gravity or KnownGravity()
        self._assume(ResidualGravity.of(self._gravity))

    @classmethod
    def of(
        cls, assumed: Assumed, matcher: Matcher, gravity: KnownGravity | None = None
    ) -> "JointBatches":
        """Return those of all fields for their matcher (`registry.build_run_matcher`).

        Parameters
        ----------
        gravity : KnownGravity, optional
            What the navigator knows of horizontal gravity; default: as it is assumed.

        Raises
        ------
        InputError
            What is assumed cannot be used.
        """
        if gravity is None:
            gravity = residual_gravity(assumed.gravity_field, build_trajectory(assumed))
        each = assumed.each_field
        schedule = UpdateSchedule.of(each)
        builders = [
            BatchBuilder.of(one, matcher.context, schedule.marks(field, one))
            for field, one in enumerate(each)
        ]
        return cls(builders, schedule.lead, gravity)

    @property
    def ready(self) -> bool:
        """Whether the newest scans end a batch that has not been built yet."""
        return self.builders[self._lead].ready

    @property
    def collected(self) -> tuple[Collected, ...]:
        """What has been collected of each field; scans are shared."""
        return tuple(builder.collected for builder in self.builders)

    @property
    def whole(self) -> bool:
        """See `BatchBuilder.whole`; of the first field."""
        return self.builders[self._lead].whole

    def bridge(self, begin: float, before: Array, end: float, after: Array) -> None:
        """See `BatchBuilder.bridge`."""
        for builder in self.builders:
            builder.bridge(begin, before, end, after)

    def learn(self, fix: Fix) -> None:
        """Note what the fix of a batch says of the gravity map's error."""
        residual = self._gravity.residual
        if fix.map_error is not None and residual is not None:
            self._assume(ResidualGravity(*residual.given(*fix.map_error)))

    def _assume(self, gravity: ResidualGravity) -> None:
        for builder in self.builders:
            builder.gravity = gravity

    def restore(self, collected: Sequence[Collected]) -> None:
        """Go on from what was collected earlier."""
        self._assume(ResidualGravity.of(self._gravity))
        for builder, one in zip(self.builders, collected, strict=True):
            builder.restore(one)

    def correct(self, time: float, jump: Array) -> None:
        """See `BatchBuilder.correct`."""
        for builder in self.builders:
            builder.correct(time, jump)

    def build(self, prior: Array, near: MapNear) -> Batch:
        """Return the batch of the first field, with those of others that have new readings beside
        it.

        Parameters
        ----------
        prior : (7, 7) array
            The navigator's covariance at the end.
        near : callable
        """
        batch = self.builders[self._lead].build(prior)
        beside = []
        for field, builder in enumerate(self.builders):
            if field == self._lead or not builder.whole:
                continue
            # one that has gone on beyond this end has its turn at the next
            if builder.mark(self.builders[self._lead]) and builder.has_new:
                other = builder.build(prior)
                beside.append(SecondaryBatch(field, other, near(field, other)))
        return replace(batch, secondary=tuple(beside)) if beside else batch
