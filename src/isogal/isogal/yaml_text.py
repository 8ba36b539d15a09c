"""YAML from outside: read as data, or refused in one line."""

from typing import Any

import yaml

from isogal.errors import InputError

LARGEST = 10_000_000
"""Characters and entries of a document whose references are written out: a few lines may stand for
more than a memory holds."""


def parse_yaml(text: str, where: str) -> Any:
    """Return what a YAML document says.

    Raises
    ------
    InputError
        One line that begins with `where`: it is no YAML, says what cannot be (such as a date
        2020-99-99), has a key twice in one mapping, is nested too deeply, refers to itself, or
        stands for more than `LARGEST`.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" (line {mark.line + 1})" if mark else ""
        why = getattr(error, "problem", None) or getattr(error, "reason", None) or "damaged"
        raise InputError(f"{where}: not valid YAML{line}: {_one_line(why)}") from None
    except RecursionError:
        raise InputError(f"{where}: not valid YAML: nested too deeply") from None
    except (ValueError, LookupError, AttributeError, TypeError, OverflowError) as error:
        # what PyYAML's constructors of numbers and dates raise of texts that are none
        raise InputError(f"{where}: not valid YAML: {_one_line(error)}") from None


def _one_line(text: object) -> str:
    return " ".join(str(text).split())[:200]


def _check_keys(node: yaml.MappingNode) -> None:
    """Raise ComposerError for a key that is there twice (YAML 1.1, section 3.2.1.3)."""
    known = set[tuple[str, str]]()
    for key, _ in node.value:
        if isinstance(key, yaml.ScalarNode) and key.tag != "tag:yaml.org,2002:merge":
            if (key.tag, key.value) in known:
                problem = f"key '{key.value}' is there twice"
                raise yaml.composer.ComposerError(None, None, problem, key.start_mark)
            known.add((key.tag, key.value))


class _Loader(yaml.SafeLoader):
    """Counts what references stand for before anything is made of them, and refuses a key that is
    there twice, of which PyYAML silently takes the last."""

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._sizes: dict[yaml.Node, int] = {}

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a node, or find the one that is referred to."""
        refers = self.check_event(yaml.AliasEvent)
        mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
        node = super().compose_node(parent, index)
        if node is None:
            return None
        if refers and node not in self._sizes:
            raise yaml.composer.ComposerError(None, None, "refers to itself", mark)
        if not refers:
            self._sizes[node] = self._size(node)
        if not refers and isinstance(node, yaml.MappingNode):
            _check_keys(node)
        if self._sizes[node] > LARGEST:
            problem = f"stands for more than {LARGEST} characters"
            raise yaml.composer.ComposerError(None, None, problem, mark)
        return node

    def _size(self, node: yaml.Node) -> int:
        if isinstance(node, yaml.ScalarNode):
            return 1 + len(node.value)
        parts = node.value
        if isinstance(node, yaml.MappingNode):
            parts = [part for pair in parts for part in pair]
        return 1 + sum(self._sizes[part] for part in parts)
