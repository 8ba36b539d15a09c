"""What the bound of a navigator takes of an altimeter with several beams: a channel for each,
which is turned so that the map's errors of the channels are independent (docs/mathematics.md,
section 11.1)."""

from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Integers
from isogal.evaluation.gravimeter_states import effective_noise_variance
from isogal.fields.beams import Footprints
from isogal.maps.field_map import FieldMap
from isogal.maps.tiled_map import TiledMap
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory


class BeamChannels(NamedTuple):
    """B turned channels at S scans."""

    sensitivity: Array
    """(S, B, 4) d(reading)/d(navigator's error)."""
    noise: Array
    """(B,) variances."""
    map_variance: Array
    """(B,) of the map's error in each, in units of that of one beam."""
    common: Array
    """(B,) how much of what all beams have in common is in each: tide, height."""


def beam_channels(
    scenario: Scenario, trajectory: Trajectory, field_map: FieldMap | TiledMap, scans: Integers
) -> BeamChannels:
    """Return the channels of a scenario's altimeter.

    The map's errors under the beams are taken to be correlated as they are where the clearance is
    its mean, and from scan to scan as under one beam; the scale of the ranges is taken to be
    known. Both make the bound smaller."""
    foot = Footprints(scenario, trajectory, field_map, scans)
    _, north, east = field_map.value_and_gradient(*foot.places(foot.range))
    across = foot.body * foot.range.mean(axis=0)[:, None]
    apart = np.hypot(*(across[:, None, :2] - across[None, :, :2]).transpose(2, 0, 1))
    correlation = np.exp(-apart / scenario.map_error.correlation_length)
    values, turn = np.linalg.eigh(correlation)
    sensitivity = np.zeros((*foot.range.shape, 4))
    sensitivity[..., 0] = -np.einsum("bc,sb->sc", turn, north)
    sensitivity[..., 1] = -np.einsum("bc,sb->sc", turn, east)
    noise = effective_noise_variance(scenario.gravimeter, field_map.quantisation)
    return BeamChannels(
        sensitivity,
        np.full(len(values), noise),
        np.maximum(values, 0.0),
        turn.sum(axis=0),
    )
