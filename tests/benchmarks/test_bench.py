"""`make bench`: the table beside the figures that were kept."""

import importlib.util
import json
from pathlib import Path

PLACE = Path(__file__).resolve().parents[2] / "benchmarks"


def load():
    spec = importlib.util.spec_from_file_location("bench", PLACE / "bench.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_loss_is_seen() -> None:
    bench = load()
    kept = json.loads((PLACE / "figures.json").read_text(encoding="utf-8"))
    assert set(kept) == {*bench.CASES, "start"}
    assert bench.compared(kept, kept)[1]
    worse = json.loads(json.dumps(kept))
    worse["pmht-paper"]["rms_m"] *= 1.06
    lines, good = bench.compared(worse, kept)
    assert not good
    assert [line.split()[-1] for line in lines].count("OUT") == 1
    faster = json.loads(json.dumps(kept))
    faster["pmht-paper"]["cpu"] *= 0.5
    assert bench.compared(faster, kept)[1]
    assert bench.compared(kept, {})[1]  # nothing kept yet
