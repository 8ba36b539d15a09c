"""The reference of the parameters."""

from pathlib import Path

from isogal_ros.graph.parameter_reference import text

PAGE = Path(__file__).resolve().parents[3] / "docs" / "parameters.md"


def test_the_page_is_that_of_the_descriptors() -> None:
    assert PAGE.read_text(encoding="utf-8") == text(), (
        "python -m isogal_ros.graph.parameter_reference > docs/parameters.md"
    )


def test_it_has_own_and_shared_parameters() -> None:
    page = text()
    every, _, rest = page.partition("## Of `ins_sim_node`")
    assert "| `checkpoint` | text |" in every
    assert "| `publish_tf` | bool | `true` |" in rest
    assert "| `route.speed` | double |" in rest
    assert page.count("| `route.speed` |") == 1
