"""Results do not depend on the workers, and what is finished is kept when a worker dies or the
user interrupts."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING
from unittest.mock import Mock

import numpy as np
import pytest

from helpers.studies import Watcher, small_scenario
from isogal.errors import InputError
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.results import canonical_json
from isogal.evaluation.summary import summarise
from isogal.maps.field_map import FieldMap
from isogal.montecarlo import chunks, workers
from isogal.montecarlo.chunks import Case, Chunk, WorkerError, runs_of
from isogal.montecarlo.cluster import check_code
from isogal.montecarlo.store import Store
from isogal.montecarlo.study import Backend, compute_cases
from isogal.sensors.trajectory import build_trajectory

if TYPE_CHECKING:
    from distributed import LocalCluster


def results_json(case: Case, store: Store) -> str:
    """Return results.json without its time part."""
    runs = store.load(case)
    bound = posterior_cramer_rao(case.scenario, build_trajectory(case.scenario), case.field_map)
    summary = summarise(runs, case.scenario, bound.rms_at(runs.time))
    del summary["time"]
    return canonical_json(summary)


@pytest.fixture(scope="module")
def one_worker(tmp_path_factory: pytest.TempPathFactory, small_case: Case) -> Store:
    store = Store(tmp_path_factory.mktemp("one"))
    compute_cases([small_case], store, Backend(workers=1), Watcher())
    return store


def workers_alive() -> list[BaseProcess]:
    return [child for child in multiprocessing.active_children() if child.name == "isogal-worker"]


def test_two_workers_and_other_chunks_give_the_same(
    tmp_path: Path,
    small_case: Case,
    one_worker: Store,
    watcher: Watcher,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(chunks, "MEMORY", 1)
    store = Store(tmp_path)
    compute_cases([small_case], store, Backend(workers=2), watcher)
    assert [chunk.runs for chunk in watcher.todo] == [(0,), (1,), (2,), (3,)]
    assert sorted(chunk.runs for chunk in watcher.done) == [(0,), (1,), (2,), (3,)]
    assert results_json(small_case, store) == results_json(small_case, one_worker)
    assert not workers_alive()


@pytest.fixture(scope="module")
def cluster() -> "Iterator[LocalCluster]":
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address=None,
        worker_dashboard_address=None,
    ) as running:
        yield running


def test_dask_cluster_gives_the_same(
    tmp_path: Path, small_case: Case, one_worker: Store, watcher: Watcher, cluster: "LocalCluster"
) -> None:
    store = Store(tmp_path)
    compute_cases([small_case], store, Backend(scheduler=cluster.scheduler_address), watcher)
    assert len(watcher.done) == 4
    assert results_json(small_case, store) == results_json(small_case, one_worker)


def test_dask_worker_with_other_source_is_refused(cluster: "LocalCluster") -> None:
    with cluster.get_client() as client, pytest.raises(InputError, match="run another Isogal"):
        check_code(client, cluster.scheduler_address, "another")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "no-port"])
def test_no_scheduler_there(
    tmp_path: Path,
    small_case: Case,
    watcher: Watcher,
    monkeypatch: pytest.MonkeyPatch,
    address: str,
) -> None:
    from isogal.montecarlo import cluster as module

    monkeypatch.setattr(module, "TIMEOUT", 0.5)
    with pytest.raises(InputError, match=f"--scheduler {address}: no Dask scheduler answers"):
        compute_cases([small_case], Store(tmp_path), Backend(scheduler=address), watcher)


def test_only_what_is_new_is_computed(
    tmp_path: Path, small_case: Case, one_worker: Store, watcher: Watcher
) -> None:
    compute_cases([small_case], one_worker, Backend(workers=1), watcher)
    assert (watcher.todo, watcher.kept) == ([], 4)
    store, first, second = Store(tmp_path), Watcher(), Watcher()
    compute_cases([replace(small_case, runs=1)], store, Backend(workers=1), first)
    compute_cases([small_case], store, Backend(workers=1), second)
    assert [run for chunk in first.todo for run in chunk.runs] == [0]
    assert [run for chunk in second.todo for run in chunk.runs] == [1, 2, 3]
    assert second.kept == 1
    assert results_json(small_case, store) == results_json(small_case, one_worker)


class Killer(Watcher):
    """Kills the workers when they report progress, so many times."""

    def __init__(self, times: int) -> None:
        super().__init__()
        self.times = times

    def reached(self, chunk: Chunk, seconds: float) -> None:
        if seconds > 0.0 and self.times > 0:
            self.times -= 1
            for child in workers_alive():
                os.kill(child.pid, signal.SIGKILL)


def test_chunk_of_a_dead_worker_is_done_again(
    tmp_path: Path, small_case: Case, one_worker: Store
) -> None:
    killer = Killer(times=1)
    store = Store(tmp_path)
    compute_cases([small_case], store, Backend(workers=1), killer)
    assert killer.times == 0
    assert results_json(small_case, store) == results_json(small_case, one_worker)


def test_workers_that_keep_dying_end_in_one_line(tmp_path: Path, small_case: Case) -> None:
    with pytest.raises(
        WorkerError, match=r"small, run 0: the worker was killed by signal 9 \(SIGKILL\), 3 times"
    ):
        compute_cases(
            [replace(small_case, runs=1)], Store(tmp_path), Backend(workers=1), Killer(times=100)
        )
    assert not workers_alive()


def test_scenario_that_cannot_be_used_is_bad_input(
    tmp_path: Path, small_case: Case, watcher: Watcher
) -> None:
    beyond = replace(small_case, scenario=small_scenario(route={"duration": 9000.0}))
    with pytest.raises(InputError, match="does not cover the route"):
        compute_cases([beyond], Store(tmp_path), Backend(workers=1), watcher)


@pytest.mark.parametrize(
    ("raised", "ends", "said"),
    [
        (ZeroDivisionError, WorkerError, "small, runs 0 to 3: ZeroDivisionError: of a chunk"),
        (InputError, InputError, "of a chunk"),
    ],
)
def test_what_a_worker_raises_is_raised_here(
    small_case: Case, monkeypatch: pytest.MonkeyPatch, raised, ends, said
) -> None:
    """The work of a worker's process, in a thread."""
    simulate = Mock(side_effect=raised("of a chunk"))
    monkeypatch.setattr(chunks, "simulate", simulate)
    chunk = Chunk(small_case, (0, 1, 2, 3))
    ours, theirs = multiprocessing.Pipe()
    maps = {chunk.task.map_key: small_case.field_map}
    thread = threading.Thread(target=workers.serve, args=(theirs, maps))
    thread.start()
    ours.send(chunk.task)
    answer = ours.recv()
    ours.close()
    thread.join(10.0)
    assert not thread.is_alive()
    with pytest.raises(ends) as caught:
        runs_of(answer, chunk)
    assert str(caught.value) == said
    traced = "".join(getattr(caught.value, "__notes__", []))
    assert ("in compute" in traced) == (ends is WorkerError)


def test_unaided_runs_take_no_fix(tmp_path: Path, field_map: FieldMap, watcher: Watcher) -> None:
    case = Case("alone", small_scenario(), 2, field_map, aided=False)
    store = Store(tmp_path)
    compute_cases([case], store, Backend(workers=1), watcher)
    runs = store.load(case)
    assert not runs.published.any()
    # without fixes the filter is the unaided navigator, but for its use of the vertical
    # accelerometer
    assert np.abs(runs.error - runs.unaided_error).max() < 0.5
    np.testing.assert_allclose(
        runs.covariance[0], runs.covariance[1], atol=1e-3 * runs.covariance.max()
    )


def test_backend_is_one_or_the_other() -> None:
    with pytest.raises(InputError, match="give one of them"):
        Backend(workers=2, scheduler="tcp://host:1")
    with pytest.raises(InputError, match="at least 1"):
        Backend(workers=0)
