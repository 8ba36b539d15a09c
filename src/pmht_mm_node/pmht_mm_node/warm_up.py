"""One batch before the first: so that compiled parts are compiled, or loaded, before the graph
starts to wait for answers."""

import numpy as np

from isogal.fields.measured import measured_field, reading_sigma
from isogal.maps.channels import RouteMap
from isogal.matching.batching import BatchBuilder
from isogal.matching.interfaces import Matcher
from isogal.scenario import Scenario
from isogal.sensors.reduction import Reduction
from isogal.sensors.trajectory import build_trajectory


def warm_up(
    matcher: Matcher, field_map: RouteMap, scenario: Scenario, reduction: Reduction
) -> None:
    """Match a made-up batch at the start of the route; the result is thrown away."""
    trajectory = build_trajectory(scenario)
    settings = scenario.matcher
    builder = BatchBuilder(
        settings, reduction, matcher.context, measured_field(scenario).covariance(scenario)
    )
    for scan in range(1, settings.batch_length + 1):
        k = min(scan * scenario.steps_per_scan, len(trajectory))
        place = trajectory.latitude[k], trajectory.longitude[k]
        reading = field_map.value(*place) + reading_sigma(scenario) * (-1.0) ** scan
        builder.add_scan(
            scan * scenario.gravimeter.interval,
            *place,
            trajectory.velocity[k, :2],
            reading,
            scenario.gravimeter.sigma,
        )
    sigma = np.array([100.0, 100.0, 0.1, 0.1, 1e-5, 1e-5, 1e-4])
    batch = builder.build(np.diag(sigma**2))
    matcher.match(batch, field_map.near(batch.latitude, batch.longitude), None)
