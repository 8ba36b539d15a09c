"""Applying a fix: the one order in which what a matcher says reaches a navigator.

A fix is anything with the attributes of `isogal.matching.interfaces.Fix` that are named here; what
it is applied to may be a run of the filter or the buffered filter at a stamp."""

from typing import Protocol, TypeVar

from isogal.arrays import Array

Result_co = TypeVar("Result_co", covariant=True)


class Likelihood(Protocol):
    """What measurements say about the navigator's error x, up to a constant: log p = vector' x -
    x' matrix x / 2."""

    @property
    def vector(self) -> Array:
        """(n,), n = 4 or 7 of the states of a batch (`isogal.inertial.error_state`)."""
        ...

    @property
    def matrix(self) -> Array:
        """(n, n)."""
        ...


class Fix(Protocol):
    """What there is to apply."""

    @property
    def map_error(self) -> tuple[float, float] | None:
        """1-sigma (m/s²) and correlation length (m) of the gravity map's error, fix or no fix;
        None = nothing is known."""
        ...

    @property
    def widening(self) -> Array | None:
        """(7, 7) covariance to be added to the navigator's, fix or no fix; None = nothing."""
        ...

    @property
    def published(self) -> bool:
        """Whether there is a fix."""
        ...

    @property
    def information(self) -> Likelihood | None:
        """All that the fix says; None = position and covariance say all."""
        ...

    @property
    def latitude(self) -> float:
        """rad."""
        ...

    @property
    def longitude(self) -> float:
        """rad."""
        ...

    @property
    def covariance(self) -> Array:
        """(2, 2) m², north-east."""
        ...


class FixTarget(Protocol[Result_co]):
    """What a fix can be applied to; an update returns what became of it."""

    def assume_map_error(self, sigma: float, length: float) -> object:
        """Take the gravity map for wrong by a 1-sigma (m/s²) over a correlation length (m)."""
        ...

    def widen(self, covariance: Array) -> object:
        """Add (7, 7) to the covariance of a batch's states."""
        ...

    def update_information(self, vector: Array, matrix: Array) -> Result_co:
        """Take a likelihood in information form."""
        ...

    def update_position(self, latitude: float, longitude: float, covariance: Array) -> Result_co:
        """Take a position (rad) with its covariance (2, 2), m²."""
        ...


def apply_fix(fix: Fix, target: FixTarget[Result_co]) -> Result_co | None:
    """Apply a fix: first what it says of gravity, which counts from its stamp on, and what makes
    the navigator less certain, because the measurements were matched with that as prior; then the
    information if there is any, else the position. Return what the update returned; None where
    there was none."""
    if fix.map_error is not None:
        target.assume_map_error(*fix.map_error)
    if fix.widening is not None:
        target.widen(fix.widening)
    if not fix.published:
        return None
    if fix.information is not None:
        return target.update_information(fix.information.vector, fix.information.matrix)
    return target.update_position(fix.latitude, fix.longitude, fix.covariance)
