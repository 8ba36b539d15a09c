#!/usr/bin/env python3
"""Exit with 0 when every node named reports on /diagnostics and none of them an error; say what is
wrong otherwise."""

import argparse
import sys
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import QoSProfile, ReliabilityPolicy

NODES = ("ins_sim_node", "gravimeter_node", "pmht_mm_node", "ukf_fusion_node")


def main() -> int:
    """Listen until every node has reported or the time is up."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "nodes",
        metavar="NODE",
        nargs="*",
        default=NODES,
        help="default: the four nodes of the graph",
    )
    parser.add_argument(
        "--timeout", type=float, default=10.0, help="s; every node reports at least once a second"
    )
    options = parser.parse_args()
    wanted = set(options.nodes)
    silent = set(wanted)
    errors: dict[str, str] = {}

    def hear(array: DiagnosticArray) -> None:
        for status in array.status:
            name = status.name.rsplit("/", maxsplit=1)[-1]
            silent.discard(name)
            errors.pop(name, None)
            if name in wanted and status.level >= DiagnosticStatus.ERROR:
                errors[name] = status.message

    rclpy.init()
    node = rclpy.create_node("isogal_healthcheck")
    # Best effort: a check must never hold up the nodes, whose publishers wait for reliable
    # readers.
    node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        hear,
        QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT),
    )
    end = time.monotonic() + options.timeout
    while silent and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.2)
    node.destroy_node()
    rclpy.try_shutdown()
    for name in sorted(silent):
        print(f"{name}: silent for {options.timeout:g} s")
    for name, message in sorted(errors.items()):
        print(f"{name}: {message}")
    return 1 if silent or errors else 0


if __name__ == "__main__":
    sys.exit(main())
