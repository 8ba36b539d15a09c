"""Maps that the matchers' tests share."""

import pytest

from helpers.batches import field_map_of, wavy
from isogal.maps.field_map import FieldMap


@pytest.fixture(scope="session")
def rough_map() -> FieldMap:
    return field_map_of(wavy)
