"""What a gradiometer's platform and its own drift add to the components that it measures
(docs/mathematics.md, section 2.7)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array, Integers
from isogal.earth.gravity import normal_gradient
from isogal.inertial.rotations import cross_matrix, from_rotation_vector, matrix
from isogal.scenario import Gradiometer
from isogal.seeds import generator
from isogal.sensors.gravimeter_errors import gauss_markov
from isogal.sensors.trajectory import Trajectory

EOTVOS = 1e-9
"""1/s² in 1 E."""
_AXES = {"n": 0, "e": 1, "d": 2}
_TRACE = (0, 1, 2)


def places_in_tensor(components: Sequence[str]) -> tuple[list[int], list[int]]:
    """Return rows and columns (C,) of components in the tensor."""
    return [_AXES[name[0]] for name in components], [_AXES[name[1]] for name in components]


def slow_errors(
    settings: Gradiometer,
    seed: int,
    run: int,
    trajectory: Trajectory,
    index: Integers,
    felt: Array,
) -> Array:
    """Return (scans, C) what a run's tilted platform and the components' offsets, which walk, add
    to what a level and perfect instrument feels, 1/s².

    Parameters
    ----------
    index : (scans,) array
        Of each scan in the trajectory.
    felt : (scans, C) array
        1/s², normal gradient included.
    """
    time, error = trajectory.time[index], np.zeros(felt.shape)
    if settings.platform_tilt > 0.0:
        normal = generator(seed, run, "gradiometer_platform").standard_normal((3, len(index)))
        tilt = gauss_markov(settings.platform_tilt, settings.platform_time, time, normal)
        latitude, height = trajectory.latitude[index], trajectory.height[index]
        tensor = _whole(settings.components, felt, normal_gradient(latitude, height))
        error += tilted(tensor, tilt.T)[..., *places_in_tensor(settings.components)] - felt
    if settings.bias_eotvos > 0.0:
        offset = generator(seed, run, "gradiometer_bias").standard_normal(felt.shape[1])
        error += settings.bias_eotvos * EOTVOS * offset
    if settings.bias_walk_eotvos > 0.0:
        steps = generator(seed, run, "gradiometer_walk").standard_normal(felt.shape)
        steps *= np.sqrt(np.diff(time, prepend=0.0))[:, None]
        error += settings.bias_walk_eotvos * EOTVOS * np.cumsum(steps, axis=0)
    return error


def tilted(tensor: Array, tilt: Array) -> Array:
    """Return the tensor (..., 3, 3) in axes that are turned by rotation vectors (..., 3), rad."""
    # of a vector's components from the level axes to the turned ones
    back = [from_rotation_vector(*one) for one in -tilt.reshape(-1, 3)]
    turn = matrix(np.reshape(back, (*tilt.shape[:-1], 4)))
    return np.asarray(turn @ tensor @ turn.swapaxes(-1, -2))


def tilt_effect(components: Sequence[str], latitude: ArrayLike) -> Array:
    """Return (..., C, 2) by how much components are larger per rad of tilt about north and about
    east, 1/s²: to first order, of the normal gradient alone, of which the field's own is at most a
    few per cent."""
    normal = normal_gradient(latitude)[..., None, :, :]
    cross = cross_matrix(np.eye(3)[:2])
    change = normal @ cross - cross @ normal
    rows, columns = places_in_tensor(components)
    return np.asarray(np.moveaxis(change[..., rows, columns], -2, -1))


def _whole(components: Sequence[str], felt: Array, normal: Array) -> Array:
    """Return (scans, 3, 3) the tensor of which components (scans, C) are known: one more follows
    by the trace, any other is taken as the normal gradient's (scans, 3, 3)."""
    tensor = normal.copy()
    rows, columns = places_in_tensor(components)
    tensor[:, rows, columns] = felt
    tensor[:, columns, rows] = felt
    unknown = [k for k in _TRACE if (k, k) not in zip(rows, columns, strict=True)]
    if len(unknown) == 1:
        k = unknown[0]
        trace = np.trace(normal, axis1=1, axis2=2)
        tensor[:, k, k] += trace - np.trace(tensor, axis1=1, axis2=2)
    return tensor
