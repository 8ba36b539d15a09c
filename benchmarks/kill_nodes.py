"""What it costs that nodes are killed (SIGKILL) and started again.

    .venv/bin/python benchmarks/kill_nodes.py [--times 20] [--duration 2400] [--set KEY=VALUE ...]

Runs the scenario as processes with respawn, each time another run of the seed; kills one node, or
the recorder, at a moment that is drawn. Says how often the run arrived, how often its bag could be
read, and the error over the last third beside that of the same runs undisturbed. What has been run
is kept in --out and not run again."""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from isogal.scenario import Scenario, load_scenario
from isogal_ros.faults.catalogue import PROCESS_FAULTS
from isogal_ros.faults.trials import Feed, run_process_trial
from isogal_ros.nodes.signals import Interrupt

LIMIT = 1.3
"""Of the error undisturbed."""


def outcomes(scenario: Scenario, out: Path, times: int) -> list[dict[str, Any]]:
    """Run what has not been run yet, and return all."""
    path = out / "outcomes.json"
    done = json.loads(path.read_text()) if path.exists() else {}
    kills = [fault for fault in PROCESS_FAULTS if fault.effect == "killed"]
    kills = [fault for fault in kills if len(fault.targets) == 1]
    for run in range(times):
        missing = [fault for fault in kills if f"{fault.name}, {run}" not in done]
        if not missing:
            continue
        feed = Feed(scenario, run)
        for fault in missing:
            key = f"{fault.name}, {run}"
            found = run_process_trial(feed, fault, out / "running", Interrupt())
            assert found is not None  # nobody stops it
            done[key] = found
            path.write_text(json.dumps(done, indent=1))
            print(f"{fault.name}, run {run}: {done[key]}", flush=True)
    return list(done.values())


def rms(rows: list[dict[str, Any]], name: str) -> float:
    """Return the RMS of an error over the last third."""
    return float(np.sqrt(np.mean([row[name] ** 2 for row in rows])))


def table(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return one line for each node."""
    lines = []
    for name in dict.fromkeys(row["fault"] for row in rows):
        own = [row for row in rows if row["fault"] == name]
        arrived = [row for row in own if row["crash"] is None and row["error_after"]]
        errors = [rms(arrived, f"error_{what}") for what in ("after", "without")]
        ratio = errors[0] / errors[1] if arrived else np.nan
        lines.append(
            {
                "fault": name,
                "times": len(own),
                "resumed_and_readable": len(arrived),
                "error_ratio": ratio,
                "largest_ratio": max(
                    (row["error_after"] / row["error_without"] for row in arrived),
                    default=np.nan,
                ),
                "lost": max(row["lost"] for row in own),
                "silent_s": max((row["restart"] or 0.0 for row in own), default=0.0),
            }
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--times", type=int, default=20, help="kills of each node")
    parser.add_argument("--duration", type=float, default=2400.0, help="s to simulate")
    parser.add_argument("--out", type=Path, default=Path("out/kill_nodes"))
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    options = parser.parse_args()
    scenario = load_scenario(None, [*options.set, f"route.duration={options.duration}"])
    options.out.mkdir(parents=True, exist_ok=True)
    lines = table(outcomes(scenario, options.out, options.times))
    print(json.dumps(lines, indent=2))
    failed = [
        line["fault"]
        for line in lines
        if line["resumed_and_readable"] < line["times"] or not line["error_ratio"] <= LIMIT
    ]
    print(f"failed: {', '.join(failed) or 'none'}")
    raise SystemExit(bool(failed))


if __name__ == "__main__":
    main()
