"""One batch before the first: so that compiled parts are compiled, or loaded, before the graph
starts to wait for answers."""

from collections.abc import Sequence

import numpy as np

from isogal.fields.measured import reading_sigma
from isogal.maps.channels import RouteMap
from isogal.matching.map_matching import MapMatching
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory


def warm_up(scenarios: Sequence[Scenario], maps: Sequence[RouteMap]) -> None:
    """Match a made-up batch of each field at the start of the route; the results are thrown
    away."""
    for scenario, field_map in zip(scenarios, maps, strict=True):
        matching, trajectory = MapMatching(scenario, [field_map]), build_trajectory(scenario)
        (builder,) = matching.batches.builders
        reading = np.zeros((1, 1) if builder.expansion is None else builder.expansion.shape)
        for scan in range(1, scenario.matcher.batch_length + 1):
            k = min(scan * scenario.steps_per_scan, len(trajectory))
            place = trajectory.latitude[k], trajectory.longitude[k], trajectory.height[k]
            noise = reading_sigma(scenario) * (-1.0) ** scan
            reading[:, 0] = field_map.value(*place[:2]) + noise
            time = scan * scenario.gravimeter.interval
            matching.add(0, time, np.array(place), trajectory.velocity[k], reading)
        sigma = np.array([100.0, 100.0, 0.1, 0.1, 1e-5, 1e-5, 1e-4])
        matching.match(np.diag(sigma**2))
