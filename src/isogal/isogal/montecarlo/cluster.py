"""Workers of a Dask cluster, found by the address of its scheduler."""

import os
from collections.abc import Generator, Mapping, Sequence
from typing import TYPE_CHECKING

from isogal.errors import InputError
from isogal.maps.several import RunMap
from isogal.montecarlo.chunks import (
    Answer,
    Chunk,
    Task,
    WorkerError,
    attempt,
    source_digest,
    throttled,
)
from isogal.montecarlo.workers import Report

if TYPE_CHECKING:
    from distributed import Client, Future

TIMEOUT = 10.0
"""s to wait for the scheduler."""


def remote(task: Task, field_map: RunMap, topic: str, number: int) -> Answer:
    """Compute a task on a Dask worker.

    Parameters
    ----------
    task : Task
    field_map : RunMap
        That of its key.
    topic : str
        Under which the worker reports its progress.
    number : int
        Of the chunk, in these reports.
    """
    from distributed import get_worker

    worker = get_worker()
    return attempt(
        task,
        field_map,
        throttled(lambda seconds: worker.log_event(topic, {"chunk": number, "seconds": seconds})),
    )


def cluster_results(
    chunks: Sequence[Chunk], maps: Mapping[str, RunMap], address: str, report: Report
) -> Generator[tuple[Chunk, Answer], None, None]:
    """Compute chunks by the workers of a Dask cluster; yields them as they are finished.

    If a worker dies, Dask gives its chunk to another one,
    `distributed.scheduler.allowed-failures` times.

    Parameters
    ----------
    chunks, maps, report
        As `local_results` takes them.
    address : str
        Of the scheduler, for example ``tcp://host:8786``.

    Raises
    ------
    InputError
        No scheduler answers there, or its workers run other source code.
    """
    from distributed import as_completed

    client = _connected(address)
    topic = f"isogal-{os.getpid()}"
    futures: dict[Future, Chunk] = {}

    def take(event: tuple[float, dict[str, float]]) -> None:
        _, said = event
        report(chunks[int(said["chunk"])], said["seconds"])

    try:
        check_code(client, address, source_digest())
        client.subscribe_topic(topic, take)
        spread = {
            key: client.scatter(field_map, broadcast=True, hash=False)
            for key, field_map in maps.items()
        }
        for number, chunk in enumerate(chunks):
            task = chunk.task
            arguments = task, spread[task.map_key], topic, number
            futures[client.submit(remote, *arguments, pure=False, priority=-number)] = chunk
        for future in as_completed(futures, loop=client.loop):
            yield futures.pop(future), _answer(future)
    finally:
        if futures:
            client.cancel(list(futures))
        client.close()


def _connected(address: str) -> "Client":
    from distributed import Client
    from distributed.comm.addressing import parse_address, parse_host_port

    try:
        scheme, place = parse_address(address)
        if scheme in ("tcp", "tls"):
            parse_host_port(place)  # else a client is half made, and its end takes 20 s
        return Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers there ({error})"
        ) from None


def _answer(future: "Future") -> Answer:
    from distributed import KilledWorker

    try:
        answer: Answer = future.result()
    except KilledWorker as error:
        return WorkerError(f"its workers died too often ({error})")
    except Exception as error:  # the cluster's own
        return WorkerError(f"{type(error).__name__}: {error}")
    finally:
        future.release()
    return answer


def check_code(client: "Client", address: str, mine: str) -> None:
    """Raise InputError unless all workers run the source code with this digest."""
    try:
        digests = client.run(source_digest)
    except Exception as error:
        raise InputError(
            f"--scheduler {address}: its workers cannot import isogal ({type(error).__name__}:"
            f" {error})"
        ) from None
    if not digests:
        raise InputError(f"--scheduler {address}: has no workers")
    other = sorted(worker for worker, digest in digests.items() if digest != mine)
    if other:
        raise InputError(
            f"--scheduler {address}: {len(other)} of {len(digests)} workers run another Isogal"
            f" than this one, for example {other[0]}"
        )
