"""Results do not depend on the workers, and what is finished is kept when a worker dies or the
user interrupts."""

import multiprocessing
import os
import signal
import subprocess
import sys
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing.context import ForkServerProcess

import psutil
import pytest

from helpers.commands import wait_for
from helpers.studies import Watcher, small_scenario
from isogal.errors import InputError
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.results import canonical_json
from isogal.evaluation.summary import summarise
from isogal.montecarlo import workers
from isogal.montecarlo.cases import Job
from isogal.montecarlo.store import Store
from isogal.montecarlo.study import Backend, compute_cases
from isogal.montecarlo.workers import WorkerError, check_code
from isogal.sensors.trajectory import build_trajectory


def results_json(case, store):
    """Return results.json without its time part."""
    runs = store.load(case)
    scenario = case.scenario
    bound = posterior_cramer_rao(scenario.true, build_trajectory(scenario), case.field_map)
    summary = summarise(runs, scenario, bound.rms_at(runs.time))
    del summary["time"]
    return canonical_json(summary)


@pytest.fixture(scope="module")
def one_worker(tmp_path_factory, small_case):
    store = Store(tmp_path_factory.mktemp("one"))
    compute_cases([small_case], store, Backend(workers=1), Watcher())
    return store


def workers_alive():
    alive = multiprocessing.active_children()
    return [child for child in alive if isinstance(child, ForkServerProcess)]


def test_two_workers_give_the_same(tmp_path, small_case, one_worker, watcher):
    store = Store(tmp_path)
    compute_cases([small_case], store, Backend(workers=2), watcher)
    assert [job.run for job in watcher.todo] == [0, 1, 2, 3]
    assert sorted(job.run for job in watcher.done) == [0, 1, 2, 3]
    assert results_json(small_case, store) == results_json(small_case, one_worker)
    assert not workers_alive()


@pytest.fixture(scope="module")
def cluster():
    from distributed import LocalCluster

    silent = {"dashboard_address": None, "worker_dashboard_address": None}
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=True, **silent) as running:
        yield running


def test_dask_cluster_gives_the_same(tmp_path, small_case, one_worker, watcher, cluster):
    store = Store(tmp_path)
    compute_cases([small_case], store, Backend(scheduler=cluster.scheduler_address), watcher)
    assert len(watcher.done) == 4
    assert results_json(small_case, store) == results_json(small_case, one_worker)


def test_dask_worker_with_other_source_is_refused(cluster):
    with cluster.get_client() as client, pytest.raises(InputError, match="run another Isogal"):
        check_code(client, cluster.scheduler_address, "another")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "no-port"])
def test_no_scheduler_there(tmp_path, small_case, watcher, monkeypatch, address):
    monkeypatch.setattr(workers, "TIMEOUT", 0.5)
    with pytest.raises(InputError, match=f"--scheduler {address}: no Dask scheduler answers"):
        compute_cases([small_case], Store(tmp_path), Backend(scheduler=address), watcher)


class Killing:
    """One worker process, which is killed so many times as soon as it has something to do."""

    def __init__(self, times):
        self.times = times

    @contextmanager
    def start(self, jobs):
        with Backend(workers=1).start(jobs) as submit:

            def deadly(job):
                future = submit(job)
                if self.times > 0:
                    self.times -= 1
                    for child in workers_alive():
                        os.kill(child.pid, signal.SIGKILL)
                return future

            yield deadly


def test_run_of_a_dead_worker_is_done_again(tmp_path, small_case, one_worker, watcher):
    store = Store(tmp_path)
    compute_cases([small_case], store, Killing(times=1), watcher)
    assert results_json(small_case, store) == results_json(small_case, one_worker)


def test_a_worker_ends_with_the_program_that_it_works_for():
    code = """
import os, signal
from concurrent.futures import ProcessPoolExecutor
from isogal import forkserver
from isogal.montecarlo import workers
pool = ProcessPoolExecutor(1, forkserver.CONTEXT, workers._take, ({},))
print(pool.submit(os.getpid).result(), flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, timeout=60, check=False
    )
    worker = int(done.stdout)
    try:
        wait_for(lambda: not psutil.pid_exists(worker), "the end of the worker")
    finally:
        with suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)


def test_workers_that_keep_dying_end_in_one_line(tmp_path, small_case, watcher):
    with pytest.raises(
        WorkerError, match="small, run 0 and after it: workers were killed 3 times"
    ):
        compute_cases([replace(small_case, runs=1)], Store(tmp_path), Killing(100), watcher)
    assert not workers_alive()


def test_scenario_that_cannot_be_used_is_bad_input(tmp_path, small_case, watcher):
    beyond = replace(small_case, scenario=small_scenario(route={"duration": 9000.0}))
    with pytest.raises(InputError, match="does not cover the route"):
        compute_cases([beyond], Store(tmp_path), Backend(workers=1), watcher)


def test_what_goes_wrong_in_a_worker_is_one_line_here(small_case):
    no_such_run = Job(small_case, -1)
    with pytest.raises(WorkerError, match="small, run -1: ValueError: "):
        list(workers.computed([no_such_run], Backend(workers=1).start))
