"""Arrays of numbers with a stamp as Float64MultiArray messages; the covariance of the navigator's
errors. Why this type: `isogal_ros.topics`."""

import math

import numpy as np
from std_msgs.msg import Float64MultiArray

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES, HORIZONTAL_STATES
from isogal.passage import Passage
from isogal_ros.messages.checks import BadMessageError, require_covariance
from isogal_ros.messages.prepared import Prepared, Reader, write
from isogal_ros.messages.stamps import SECOND, from_seconds, to_seconds


def peek_numbers_ns(serialised: bytes) -> int:
    """Return the stamp at the head of a serialised Float64MultiArray that
    `fill_nav_covariance` wrote, without decoding the rest.

    Raises
    ------
    BadMessageError
        It is cut off, has a layout, or its stamp is not finite.
    """
    content = Reader(serialised)
    # lengths of dim, data_offset, and of the data, which begins at a multiple of eight bytes
    layout, _, _, seconds, rest = content.take("3I4x2d")
    if layout or not (abs(seconds) < 1e10 and 0 <= rest < SECOND):
        raise BadMessageError("begins with a layout, or with no stamp")
    return int(seconds) * SECOND + int(rest)


def fill_nav_covariance(
    message: Float64MultiArray | Prepared,
    ns: int,
    covariance: Array,
    passage: Passage | None = None,
) -> None:
    """Write the covariance of the navigator's errors, behind its stamp (s, then ns): the message
    has no header.

    Parameters
    ----------
    ns : int
        Stamp.
    covariance : (7, 7) array
        Of a batch's states (`isogal.inertial.error_state`).
    passage : Passage, optional
        What has become of the error since the last fix; its stamp and its arrays follow the
        covariance.
    """
    since = () if passage is None else divmod(from_seconds(passage.begin), SECOND)
    arrays = () if passage is None else passage.arrays
    write(message, ns, divmod(ns, SECOND), covariance, since, *arrays)


def read_nav_covariance(
    message: Float64MultiArray,
) -> tuple[Array, Passage | None]:
    """Return the covariance of a batch's states (`isogal.inertial.error_state`): (7, 7), or (4, 4)
    without the attitude; and what has become of the error since the last fix, if it says so.

    Raises
    ------
    BadMessageError
        The number of numbers is another, or they are not finite, or a variance is negative.
    """
    values = np.array(message.data)
    passage, n = None, BATCH_STATES
    more = values[2 + n * n :]
    if len(more) > 2:
        values, (seconds, rest), more = values[: 2 + n * n], more[:2], more[2:]
        if not (np.isfinite(more).all() and abs(seconds) < 1e10 and 0 <= rest < SECOND):
            raise BadMessageError("what has been told since the last fix is not finite")
        passage = _read_passage(int(seconds) * SECOND + int(rest), more)
    size = math.isqrt(max(len(values) - 2, 0))
    if size not in (HORIZONTAL_STATES, BATCH_STATES) or len(values) != size * size + 2:
        raise BadMessageError(
            f"must hold a stamp and a 7 x 7 or 4 x 4 covariance, holds {len(values)} numbers"
        )
    covariance = values[2:].reshape(size, size)
    require_covariance(covariance)
    return covariance, passage


def _read_passage(ns: int, values: Array) -> Passage:
    """Return what numbers say of the time since a stamp (ns)."""
    try:
        passage = Passage.of_numbers(to_seconds(ns), values)
    except ValueError as error:
        raise BadMessageError(str(error)) from None
    for covariance in (passage.before, passage.smoothed, passage.after):
        require_covariance(covariance)
    return passage
