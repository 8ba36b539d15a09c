"""The benchmark of the graph."""

import graph
import pytest


def test_a_run_that_is_over_at_once_is_one_line():
    usage = graph.Usage(dict)
    usage.look(1.0)
    with pytest.raises(SystemExit, match="give a longer --duration"):
        usage.per_step  # noqa: B018 - raises
