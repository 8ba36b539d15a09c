"""Auxiliary states of the horizontal gravity that no compensation takes off."""

from isogal.fields.known_gravity import KnownGravity
from isogal.fusion.auxiliary import AuxiliaryState


def states(gravity: KnownGravity) -> tuple[AuxiliaryState, ...]:
    """Return the residual to north and to east, first-order Gauss-Markov processes along the track
    (Jekeli 2001, section 6.6; docs/mathematics.md, section 3.9); none where nothing is left.

    Their 1-sigma and length hold until the matcher has learnt how wrong the map is
    (`isogal.fusion.state.FilterState.residual_gravity`)."""
    if gravity.residual_sigma == 0.0:
        return ()
    return tuple(
        AuxiliaryState(
            name, "gravity", axis, gravity.residual_sigma, length=gravity.residual_length
        )
        for axis, name in enumerate(("gravity_north", "gravity_east"))
    )
