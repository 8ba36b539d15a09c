"""Work that is spread over all cores of the machine."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def spread(
    function: Callable[[Item], Result], items: Iterable[Item]
) -> Iterator[tuple[Item, Result]]:
    """Call a function with each of some items, in threads (linear algebra leaves Python's lock);
    give each item with its result, in any order. The first exception ends it."""
    with ThreadPoolExecutor(_cores()) as pool:
        started = {pool.submit(function, item): item for item in items}
        try:
            for future in as_completed(started):
                yield started.pop(future), future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _cores() -> int:
    """Return how many cores this process may use."""
    return (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
