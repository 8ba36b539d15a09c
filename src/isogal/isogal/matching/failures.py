"""A batch that a matcher cannot cope with costs that batch, never the run.

Readings and maps of the world outside hold what was not foreseen: a matrix that is not
positive definite, an array without elements. Whoever matches batches one after the other asks a
matcher through `match_or_decline`: the Monte Carlo engine, the node and `isogal match`."""

from dataclasses import replace
from traceback import walk_tb
from types import TracebackType
from typing import Any

import numpy as np

from isogal.maps.channels import AnyMap
from isogal.matching.interfaces import Batch, Fix, Matcher, declined

FAILED = "the matcher failed: "
"""Begins the reason of a fix that has `failed`: the matcher has raised an exception, or its fix is
not finite."""
UNEXPLAINED = "unexplained"
"""Figure of a batch without a fix whose readings the map does not explain."""
_NUMERICAL = ("numpy", "scipy", "numba")
"""Packages whose own lines say nothing of where a matcher has failed."""


def match_or_decline(
    matcher: Matcher, batch: Batch, field_map: AnyMap, memory: Any
) -> tuple[Fix, Any]:
    """Match a batch; where the matcher raises, decline it with the reason, and with the memory as
    it was before.

    Any exception counts, not those of arithmetic alone: which one a matrix or an empty array leads
    to depends on the line that meets it first. The reason names the exception and that line, so
    that a defect can be found. A fix that is published with numbers that are not finite, or with a
    covariance that is none, counts as raised.

    Parameters
    ----------
    matcher, batch, field_map, memory
        See `interfaces.Matcher.match`.
    """
    try:
        fix, after = matcher.match(batch, field_map, memory)
        _check(fix)
    except Exception as error:
        text = " ".join(str(error).split())
        words = f"{type(error).__name__}: {text}" if text else type(error).__name__
        reason = f"{FAILED}{words}{_place(error.__traceback__)}"
        return replace(declined(batch, reason), failed=True), memory
    return fix, after


def _check(fix: Fix) -> None:
    """Raise ValueError where a published fix is not a position with a covariance."""
    if not fix.published:
        return
    information = fix.information
    numbers = [np.array([fix.time, fix.latitude, fix.longitude]), fix.covariance.ravel()]
    numbers += [] if information is None else [information.vector, information.matrix.ravel()]
    if not np.isfinite(np.concatenate(numbers)).all():
        raise ValueError("its fix is not finite")
    (nn, ne), (_, ee) = fix.covariance
    if not (nn > 0.0 and ee > 0.0 and nn * ee > ne**2):
        raise ValueError("the covariance of its fix is not positive definite")


def _place(trace: TracebackType | None) -> str:
    """Return where an exception comes from: the last line outside of packages of numbers."""
    where = ""
    for frame, line in walk_tb(trace):
        module = str(frame.f_globals.get("__name__", ""))
        if module != __name__ and module.partition(".")[0] not in _NUMERICAL:
            where = f" ({module}, line {line})"
    return where
