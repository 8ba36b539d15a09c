"""Maps that are computed from others are computed once for all tests of a worker."""

from collections.abc import Iterator

import pytest

from isogal.fields import scenario_map
from isogal.fields.derived_maps import derived_maps
from isogal.maps.channels import ChannelMap
from isogal.scenario import Scenario

_computed: dict[tuple[str, float], ChannelMap] = {}


def maps_computed_once() -> Iterator[None]:
    """Have them computed (in a process of their own, which takes a second) once for each
    scenario."""

    def once(scenario: Scenario, margin: float) -> ChannelMap:
        key = scenario.model_dump_json(exclude={"matcher", "seed"}), margin
        if key not in _computed:
            _computed[key] = derived_maps(scenario, margin)
        return _computed[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scenario_map, "derived_maps", once)
        yield


maps_once = pytest.fixture(maps_computed_once, scope="session", autouse=True)
"""For a folder's conftest."""
