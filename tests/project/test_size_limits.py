"""Limits that keep every function small enough to read at once."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("src", "tests", "benchmarks", "examples")

NODE_LINES = 150
"""Of the class of a node."""
FUNCTION_LINES = 60
KERNEL_LINES = 80
COMMAND_LINES = 20
"""Of the body of a command, which has a parameter for each of its options."""
PARAMETERS = 8

EXCEPTIONS: frozenset[str] = frozenset({"tests/helpers/batches.py:make_batch"})
"""``path:function`` or path, relative to the repository."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def sources() -> list[Path]:
    return [
        path
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
        if "build" not in path.relative_to(ROOT).parts
    ]


@cache
def functions() -> list[tuple[str, Function]]:
    """All but the exceptions. Expressions, which hold no function and are most, are left out."""
    found = []
    for path in sources():
        waiting: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
        for node in waiting:
            waiting += (
                child
                for child in ast.iter_child_nodes(node)
                if isinstance(child, ast.stmt | ast.ExceptHandler | ast.match_case)
            )
            if isinstance(node, Function):
                found.append((f"{path.relative_to(ROOT)}:{node.name}", node))
    return [(name, node) for name, node in found if name not in EXCEPTIONS]


def is_decorated(function: Function, name: str) -> bool:
    return any(name in ast.unparse(decorator) for decorator in function.decorator_list)


def is_kernel(function: Function) -> bool:
    return is_decorated(function, "kernel")


def is_command(function: Function) -> bool:
    return is_decorated(function, "with_groups") or "typer." in ast.unparse(function.args)


def parameters(function: Function) -> int:
    arguments = function.args
    named = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    return sum(argument.arg not in ("self", "cls") for argument in named)


def length(node: ast.stmt, first: int | None = None) -> int:
    assert node.end_lineno is not None
    return node.end_lineno - (first or node.lineno) + 1


def lines_and_limit(function: Function) -> tuple[int, int]:
    """How many lines a function has, and how many it may have; of a command those of its body,
    without the docstring."""
    if is_command(function):
        body = function.body[1:] if ast.get_docstring(function) is not None else function.body
        return length(function, body[0].lineno) if body else 0, COMMAND_LINES
    return length(function), KERNEL_LINES if is_kernel(function) else FUNCTION_LINES


def none(found: list[str]) -> None:
    """Fail with all of them, where pytest would leave some out."""
    assert not found, "\n".join(["over the limit:", *found])


def test_nodes_are_thin() -> None:
    nodes = {
        f"{path}:{found.name}": length(found)
        for path in sources()
        if path.name == "node.py"
        for found in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(found, ast.ClassDef)
    }
    assert len(nodes) >= 4
    none([f"{name}: {count}" for name, count in nodes.items() if count >= NODE_LINES])


def test_no_function_is_too_long() -> None:
    # the lowest limit: shorter ones need no look
    long = [(name, it) for name, it in functions() if length(it) > COMMAND_LINES]
    found = {name: lines_and_limit(function) for name, function in long}
    none([f"{name}: {count}" for name, (count, limit) in found.items() if count > limit])


def test_no_function_has_too_many_parameters() -> None:
    too_many = [
        f"{name}: {parameters(function)}"
        for name, function in functions()
        if parameters(function) > PARAMETERS
        and not is_kernel(function)
        and not is_command(function)
    ]
    none(too_many)
