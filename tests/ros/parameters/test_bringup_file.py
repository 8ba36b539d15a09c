"""The parameter file of the bringup package."""

from pathlib import Path

import yaml

from isogal.scenario import Scenario
from isogal_ros.parameters import bringup_file
from isogal_ros.parameters.from_model import parameter_specs
from isogal_ros.parameters.values import nested

ROOT = Path(__file__).resolve().parents[3]


def test_it_is_up_to_date() -> None:
    file = ROOT / "src" / "isogal_bringup" / "params" / "isogal.yaml"
    assert file.read_text() == bringup_file.text(), (
        "run: python -m isogal_ros.parameters.bringup_file > " + str(file.relative_to(ROOT))
    )


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
