"""Workers of a Dask cluster, found by the address of its scheduler."""

import os
from collections.abc import Generator, Mapping, Sequence
from typing import Any

from isogal.errors import InputError
from isogal.evaluation.records import Runs
from isogal.maps.several import RunMap
from isogal.montecarlo.chunks import Chunk, compute, source_digest
from isogal.montecarlo.workers import Report, WorkerError, throttled

TIMEOUT = 10.0
"""s to wait for the scheduler."""


def remote(chunk: Chunk, field_map: RunMap, topic: str) -> Runs:
    """Compute a chunk on a Dask worker, which reports its progress under a topic."""
    from distributed import get_worker

    worker = get_worker()
    return compute(
        chunk,
        field_map,
        throttled(
            lambda seconds: worker.log_event(topic, {"chunk": _name(chunk), "seconds": seconds})
        ),
    )


def cluster_results(
    chunks: Sequence[Chunk], maps: Mapping[str, RunMap], address: str, report: Report
) -> Generator[tuple[Chunk, Runs], None, None]:
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
        No scheduler answers there, its workers run other source code, or the scenario of a chunk
        cannot be used.
    WorkerError
        A chunk failed, or its workers died too often.
    """
    from distributed import as_completed

    client = _connected(address)
    topic = f"isogal-{os.getpid()}"
    named = {_name(chunk): chunk for chunk in chunks}
    futures: dict[Any, Chunk] = {}

    def take(event: tuple[Any, Any]) -> None:
        message = event[1]
        if isinstance(message, dict) and message.get("chunk") in named:
            report(named[message["chunk"]], float(message["seconds"]))

    try:
        _check_code(client, address)
        client.subscribe_topic(topic, take)
        spread = {
            key: client.scatter(field_map, broadcast=True, hash=False)
            for key, field_map in maps.items()
        }
        for priority, chunk in enumerate(chunks):
            future = client.submit(
                remote, chunk, spread[chunk.map_key], topic, pure=False, priority=-priority
            )
            futures[future] = chunk
        for future in as_completed(futures, loop=client.loop):
            chunk = futures.pop(future)
            yield chunk, _result(future, chunk)
    finally:
        if futures:
            client.cancel(list(futures))
        client.close()


def _connected(address: str) -> Any:
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


def _result(future: Any, chunk: Chunk) -> Runs:
    from distributed import KilledWorker

    try:
        runs: Runs = future.result()
    except InputError:
        raise
    except KilledWorker as error:
        raise WorkerError(
            f"{chunk.case}, {chunk.text()}: its workers died too often ({error})"
        ) from None
    except Exception as error:
        raise WorkerError(
            f"{chunk.case}, {chunk.text()}: {type(error).__name__}: {error}"
        ) from error
    finally:
        future.release()
    return runs


def _check_code(client: Any, address: str) -> None:
    try:
        digests = client.run(source_digest)
    except Exception as error:
        raise InputError(
            f"--scheduler {address}: its workers cannot import isogal ({type(error).__name__}:"
            f" {error})"
        ) from None
    if not digests:
        raise InputError(f"--scheduler {address}: has no workers")
    other = sorted(worker for worker, digest in digests.items() if digest != _my_digest())
    if other:
        raise InputError(
            f"--scheduler {address}: {len(other)} of {len(digests)} workers run another Isogal"
            f" than this one, for example {other[0]}"
        )


def _my_digest() -> str:
    return source_digest()


def _name(chunk: Chunk) -> str:
    return f"{chunk.key}/{chunk.runs[0]}"
