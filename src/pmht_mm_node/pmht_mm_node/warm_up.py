"""One batch before the first: so that compiled parts are compiled, or loaded, before the graph
starts to wait for answers."""

from collections.abc import Sequence

import numpy as np

from isogal.fields.measured import measured_field, reading_sigma
from isogal.maps.channels import RouteMap
from isogal.matching.batching import BatchBuilder
from isogal.matching.expansion import Channels
from isogal.matching.failures import match_or_decline
from isogal.matching.registry import load_matcher
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory


def warm_up(scenarios: Sequence[Scenario], maps: Sequence[RouteMap]) -> None:
    """Match a made-up batch of each field at the start of the route; the results are thrown
    away."""
    for scenario, field_map in zip(scenarios, maps, strict=True):
        _match(scenario, field_map)


def _match(scenario: Scenario, field_map: RouteMap) -> None:
    trajectory = build_trajectory(scenario)
    settings, field = scenario.matcher, measured_field(scenario)
    matcher = load_matcher(settings, field.channels is not None)
    covariance = field.covariance(scenario)
    expansion = None if covariance is None else Channels(covariance)
    builder = BatchBuilder(
        settings, field.reduction(scenario), matcher.context, expansion=expansion
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
    match_or_decline(matcher, batch, field_map.near(batch.latitude, batch.longitude), None)
