"""What the sensor publishes of a reading: all reductions of its instrument."""

import math
from typing import Any

from isogal.fields.measured import measured_field, of_instrument
from isogal.sensors.reduction import State, reduction_variance
from isogal_ros import topics
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.nav_sample import NavSample


class Outputs:
    """Publishers and messages; the graph waits for the reduction that is matched only."""

    def __init__(self, node: GraphNode) -> None:
        matched = measured_field(node.scenario)
        self._reductions = []
        for field in of_instrument(matched.instrument):
            adapter = adapter_of(node.scenario, field.name)
            publisher = node.advertise(
                adapter.reduced, (topics.PMHT_MM, topics.INS_SIM) if field is matched else ()
            )
            self._reductions.append(
                (field.reduction(node.scenario), adapter, publisher, adapter.new_reduced())
            )

    def publish(self, ns: int, felt: Any, variance: Any, nav: NavSample | None) -> None:
        """Publish the reductions of a raw reading and its variance; NaN where the reading or the
        navigator's state is missing, so that the scan is known to be empty."""
        for reduction, adapter, publisher, message in self._reductions:
            value, total, place = math.nan * felt, variance, None
            if nav is not None:
                latitude, longitude, height = nav.position
                place = latitude, longitude
                estimate = State(*place, height, nav.velocity[0], nav.velocity[1], nav.attitude)
                dated = reduction.dated(to_seconds(ns))
                value = dated.reduce(felt, estimate)[()]
                by_navigator = reduction_variance(
                    reduction, estimate, nav.covariance[:4, :4], nav.height_variance
                )
                total = variance + float(by_navigator)
            adapter.fill_reduced(message, ns, value, total, place)
            publisher.publish(message)
