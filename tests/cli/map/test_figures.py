"""Pictures of maps."""

from dataclasses import replace

import numpy as np

from isogal.cli.map.figures import map_figure
from isogal.evaluation.figures.style import png


def test_holes_constant_values_and_strips_can_be_drawn(small_map):
    holed = np.where(small_map.values > 4e-4, np.nan, small_map.values)
    for odd in (
        replace(small_map, values=holed),
        replace(small_map, values=np.full_like(holed, 1e-4)),
        replace(small_map, latitude=small_map.latitude[:6], values=small_map.values[:6]),
        replace(small_map, values=holed.astype(np.float32)),
    ):
        assert png(map_figure(odd)).startswith(b"\x89PNG")
