"""One thread of linear algebra in Isogal's programs, and the user's choice elsewhere."""

import importlib.util
import os
import subprocess
import sys

import pytest

from isogal.threads import VARIABLES, one_thread

SHOW = f"\nimport os; print([os.environ.get(name) for name in {VARIABLES!r}])"
NODES = ("ins_sim_node", "gravimeter_node", "pmht_mm_node", "ukf_fusion_node")


def after(code: str, **given: str) -> str:
    """Return the variables at the end of a fresh process."""
    environment = {
        name: value for name, value in os.environ.items() if name not in VARIABLES
    } | given
    done = subprocess.run(
        [sys.executable, "-c", code + SHOW],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1]


def test_command_sets_one_but_for_the_choice_of_the_user() -> None:
    code = (
        "import isogal.cli.main as m, sys; sys.argv = ['isogal', '--version']\ntry:"
        " m.main()\nexcept SystemExit: pass"
    )
    assert after(code) == str(["1"] * 3)
    chosen, free = {"OPENBLAS_NUM_THREADS": "3"}, dict[str, str]()
    one_thread(chosen)
    one_thread(free)
    assert chosen == {"OPENBLAS_NUM_THREADS": "3"}
    assert free == dict.fromkeys(VARIABLES, "1")


@pytest.mark.ros
def test_nodes_set_one_before_numpy() -> None:
    """Each by itself: what the one before has set is taken away."""
    if any(importlib.util.find_spec(name) is None for name in (*NODES, "rclpy")):
        pytest.skip("the node packages are not here")
    code = f"""
import importlib, os, sys
for node in {NODES!r}:
    for name in {VARIABLES!r}:
        os.environ.pop(name, None)
    importlib.import_module(node)
    assert [os.environ.get(name) for name in {VARIABLES!r}] == ["1"] * 3, node
    assert "numpy" not in sys.modules, node
for node in {NODES!r}:
    importlib.import_module(f"{{node}}.node")
"""
    assert after(code) == str(["1"] * 3)
