"""What `colcon test` runs of this package; all others are in the folder tests beside src."""

from pathlib import Path

PARAMS = Path(__file__).parents[1] / "params" / "isogal.yaml"


def test_the_parameter_file_is_that_of_the_nodes() -> None:
    from isogal_ros.graph.parameter_reference import text

    assert PARAMS.read_text(encoding="utf-8") == text(of_file=True)
