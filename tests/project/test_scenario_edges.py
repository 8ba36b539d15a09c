"""Who may know a whole scenario: what it says of the truth must not reach what navigates."""

import ast
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2] / "src" / "isogal" / "isogal"
EDGES = {"cli", "montecarlo", "paper", "scenario"}
"""They read scenarios, and hand on what is assumed, what is true, or a section of either."""


def imported(path: Path) -> set[str]:
    """Names that a file imports, also those for types only."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def test_only_edges_take_a_scenario():
    inside = [
        path
        for path in sorted(SOURCE.rglob("*.py"))
        if path.relative_to(SOURCE).parts[0] not in EDGES
    ]
    assert len(inside) > 100
    assert [str(path.relative_to(SOURCE)) for path in inside if "Scenario" in imported(path)] == []
