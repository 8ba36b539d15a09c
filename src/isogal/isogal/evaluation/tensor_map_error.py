"""What the bound takes for map errors of the gravity gradient tensor that come from one potential
(docs/mathematics.md, section 11.1)."""

from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Integers
from isogal.maps.error_model import displacements, tensor_covariance
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory

_BEFORE = 4
"""Scans before on which the map's errors at a scan are conditioned. The information of a straight
track is then right within 5 %."""


class MapSteps(NamedTuple):
    """The map's errors of C channels at S scans by those at the p scans before, the last one first
    (Vecchia 1988, J. R. Stat. Soc. B 50:297); S = 0: they are independent Gauss-Markov
    processes."""

    gain: Array
    """(S, C, p C)."""
    root: Array
    """(S, C, C) square root of the covariance of what is new."""

    @property
    def joint(self) -> bool:
        """Whether there are any."""
        return len(self.gain) > 0

    @classmethod
    def none(cls) -> "MapSteps":
        """Return those of independent errors."""
        return cls(np.zeros((0, 0, 0)), np.zeros((0, 0, 0)))

    @property
    def states(self) -> int:
        """p C."""
        return self.gain.shape[2]


def map_steps(
    scenario: Scenario, trajectory: Trajectory, scans: Integers, turn: Array
) -> MapSteps:
    """Return them for a scenario's gradiometer, for channels that are its components turned by
    (C, C), whose columns they are."""
    components = scenario.gradiometer.of_one_potential
    sigma, length = scenario.map_error.sigma, scenario.map_error.correlation_length
    if components is None or sigma == 0.0:
        return MapSteps.none()
    count, most = len(components), min(_BEFORE, len(scans) - 1)
    channel = np.tile(np.arange(count), most + 1)
    gain = np.zeros((len(scans), count, most * count))
    root = np.zeros((len(scans), count, count))
    whole = np.kron(np.eye(most + 1), turn)
    for k in range(len(scans)):
        here = scans[k - min(k, most) : k + 1][::-1]
        size = len(here) * count
        rows = np.repeat(here, count)
        apart = displacements(trajectory.latitude[rows], trajectory.longitude[rows])
        part = whole[:size, :size]
        covariance = tensor_covariance(components, channel[:size], apart, length)
        covariance = sigma**2 * (part.T @ covariance @ part)
        now, before = covariance[:count, :count], covariance[count:, count:]
        cross = covariance[:count, count:]
        jitter = 1e-9 * sigma**2 * np.eye(len(before))
        gain[k, :, : size - count] = np.linalg.solve(before + jitter, cross.T).T
        left = now - gain[k, :, : size - count] @ cross.T
        values, vectors = np.linalg.eigh(0.5 * (left + left.T))
        root[k] = vectors * np.sqrt(np.maximum(values, 0.0))
    return MapSteps(gain, root)
