"""Mutated maps, tracks, recordings, scenarios and checkpoints: what is neither read nor refused.

    .venv/bin/python benchmarks/hostile_files.py [--files 100000] [--only bag.mcap] [--seed 7]

Files are read in processes with a limit of memory; one that ends a process, takes longer than
TIMEOUT, needs more memory or raises anything but InputError is kept in --out."""

import json
import resource
import signal
import sys
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from types import FrameType

import closed_loop
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from helpers.hostile import READERS, mutated, valid_files
from isogal.errors import InputError
from isogal.maps.field_map import FieldMap
from isogal.seeds import generator

TIMEOUT = 10
"""s for one file."""
MEMORY = 4 << 30
"""Bytes of address space of a process."""
CHUNK = 200
"""Files read by one call."""


def small_map() -> FieldMap:
    """Return a map that every format can hold."""
    latitude, longitude = -37.0 + 0.05 * np.arange(20), 144.5 + 0.05 * np.arange(24)
    value = 1e-4 * np.sin(latitude[:, None] * 9.0) * np.cos(longitude[None, :] * 7.0)
    return FieldMap(
        np.radians(latitude), np.radians(longitude), value, "m/s²", "disturbance", provenance="x"
    )


def _late(_number: int, _frame: FrameType | None) -> None:
    raise TimeoutError(f"longer than {TIMEOUT} s")


def read_some(
    name: str, valid: bytes, seed: int, first: int, count: int, out: str
) -> dict[str, int]:
    """Read mutated files of one kind; return how often each thing became of them."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.signal(signal.SIGALRM, _late)
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        for k in range(first, first + count):
            data = mutated(valid, generator(seed, k, f"hostile file: {name}"))
            path.write_bytes(data)
            signal.alarm(TIMEOUT)
            try:
                READERS[name](path)
                found["read"] += 1
            except InputError:
                found["refused"] += 1
            except (Exception, MemoryError) as error:
                found[f"{type(error).__name__}: {str(error)[:80]}"] += 1
                (Path(out) / f"{k}-{name}").write_bytes(data)
            finally:
                signal.alarm(0)
    return dict(found)


def main() -> None:
    parser = closed_loop.parser(__doc__, "workers", out=Path("out/hostile"))
    parser.add_argument("--files", type=int, default=100_000, help="of all kinds together")
    parser.add_argument("--only", action="append", choices=list(READERS), help="of these kinds")
    parser.add_argument("--seed", type=int, default=6, help="another one changes them otherwise")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        valid = valid_files(Path(folder), small_map())
    seed, out = options.seed, str(options.out)
    if options.only:
        valid = {name: valid[name] for name in options.only}
    results: dict[str, Counter[str]] = {name: Counter() for name in valid}
    each = -(-options.files // len(valid))
    for name, data in valid.items():
        for first in range(0, each, CHUNK * options.workers):
            with ProcessPoolExecutor(options.workers, get_context("spawn")) as pool:
                starts = range(first, min(first + CHUNK * options.workers, each), CHUNK)
                calls = [
                    pool.submit(read_some, name, data, seed, k, min(CHUNK, each - k), out)
                    for k in starts
                ]
                for k, call in zip(starts, calls, strict=True):
                    try:
                        results[name].update(call.result())
                    except BrokenProcessPool:
                        results[name][f"a process ended, files {k} to {k + CHUNK}"] += 1
        print(name, dict(results[name]), flush=True)
    print(json.dumps(results, indent=2))
    bad = {key for counts in results.values() for key in counts} - {"read", "refused"}
    raise SystemExit(bool(bad))


if __name__ == "__main__":
    main()
