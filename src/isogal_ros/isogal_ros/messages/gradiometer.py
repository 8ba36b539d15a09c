"""Components of the gravity gradient tensor as messages.

No standard message holds a tensor. A PointCloud2 has a stamp and describes its own content: a
reading is one point with a field for each component (T_nn, T_ne, T_nd, T_ee, T_ed, T_dd; 1/s²) and
the field `covariance` of C x C numbers, row by row in the order of those fields. Numbers are found
by name, so that components may be left out and none is put where another quantity is meant.
Readings are in the order of the scenario's components, whatever the order in a message."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from sensor_msgs.msg import PointCloud2

from isogal.arrays import Array
from isogal.maps.quantities import QUANTITIES
from isogal.scenario import Assumed
from isogal_ros import topics
from isogal_ros.messages.adapter import Adapter, Place, Reading
from isogal_ros.messages.checks import BadMessageError, require_covariance, require_frame
from isogal_ros.messages.frames import framed
from isogal_ros.messages.point import fill_point, numbers, read_point
from isogal_ros.topics import Topic

GRADIOMETER = "gradiometer_link"
"""Frame of a level platform that points north: x north, y east, z down, as the components are
named."""
PREFIX, COVARIANCE = "T_", "covariance"
_LARGEST = 2.0 * QUANTITIES["gradient"].highest
"""1/s²: the normal gradient's 3.1e-6 and what the Earth's crust adds."""


def gradient(assumed: Assumed) -> Adapter:
    """Return the adapter of the field gradient: of gravity's, and of the disturbing
    potential's."""
    names = [PREFIX + name for name in assumed.gradiometer.components]

    def read_raw(message: PointCloud2) -> tuple[Array, Array | None]:
        value, covariance = read_gradient(message, names)
        return value, covariance if covariance.any() else None

    return Adapter(
        topics.FULL_GRADIENT,
        partial(_write, topics.FULL_GRADIENT, names),
        read_raw,
        topics.GRADIENT,
        partial(_write, topics.GRADIENT, names),
        lambda message: read_gradient(message, names),
    )


def _write(
    topic: Topic, names: Sequence[str], ns: int, value: Reading, variance: Reading, place: Place
) -> PointCloud2:
    """Return a message of components (C,), 1/s², and their covariance (C, C)."""
    content = dict(zip(names, np.broadcast_to(value, len(names)), strict=True))
    return fill_point(framed(topic, GRADIOMETER), ns, {**content, COVARIANCE: variance})


def read_gradient(message: PointCloud2, names: Sequence[str]) -> tuple[Array, Array]:
    """Return the components of some names (C,), NaN = no reading of that component, and their
    covariance (C, C)."""
    require_frame(message, GRADIOMETER)
    content = read_point(message, lambda name: name.startswith(PREFIX) or name == COVARIANCE)
    value = np.array([numbers(content, name, finite=False) for name in names])
    # the covariance has a row for each component in the message, in its order
    order = [name for name in content if name != COVARIANCE]
    rows = [order.index(name) for name in names]
    whole = numbers(content, COVARIANCE, len(order), len(order), finite=False)
    covariance = whole[np.ix_(rows, rows)]
    if np.isinf(value).any() or np.nanmax(np.abs(value), initial=0.0) > _LARGEST:
        raise BadMessageError(
            f"a component above {_LARGEST:g} 1/s² is not the Earth's; the unit is 1/s²"
        )
    require_covariance(covariance)
    return value, covariance
