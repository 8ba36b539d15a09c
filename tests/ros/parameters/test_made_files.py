"""Files made of the parameters: that of the bringup package, and the reference."""

from pathlib import Path

import pytest
import yaml

from isogal.scenario import Scenario
from isogal_ros.graph import parameter_reference
from isogal_ros.parameters import bringup_file
from isogal_ros.parameters.from_model import parameter_specs
from isogal_ros.parameters.values import nested

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize(
    ("made", "file"),
    [
        (bringup_file, "src/isogal_bringup/params/isogal.yaml"),
        (parameter_reference, "docs/parameters.md"),
    ],
)
def test_it_is_up_to_date(made, file) -> None:
    assert (ROOT / file).read_text(encoding="utf-8") == made.text(), (
        f"python -m {made.__name__} > {file}"
    )


def test_the_reference_has_own_and_shared_parameters() -> None:
    page = parameter_reference.text()
    every, _, rest = page.partition("## Of `ins_sim_node`")
    assert "| `checkpoint` | text |" in every
    assert "| `publish_tf` | bool | `true` |" in rest
    assert page.count("| `route.speed` | double |") == rest.count("| `route.speed` |") == 1


def test_it_says_the_defaults() -> None:
    values = yaml.safe_load(bringup_file.text())["/**"]["ros__parameters"]
    specs = {spec.name: spec for spec in parameter_specs(Scenario)}

    def flat(document, prefix=""):
        for key, value in document.items():
            if isinstance(value, dict):
                yield from flat(value, f"{prefix}{key}.")
            else:
                yield prefix + key, value

    assert {name: specs[name].default for name in specs} == dict(flat(values))
    fields = {name: specs[name].to_field(value) for name, value in flat(values)}
    assert Scenario.model_validate(nested(fields)) == Scenario()
