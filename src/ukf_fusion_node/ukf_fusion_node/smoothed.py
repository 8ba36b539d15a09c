"""nav/smoothed: the states of the past, as all data up to `fusion.lag` later have them."""

import numpy as np

from isogal.fusion.inertial_navigator import InertialNavigator
from isogal_ros import topics
from isogal_ros.messages.frames import map_frame
from isogal_ros.messages.odometry import empty_odometry, fill_odom
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import GraphNode

SHARE = 0.1
"""Of the lag, from one pass back over it to the next: each step of the navigator then costs as
much as the filter of eleven."""


class Smoothed:
    """Publishes each state once, between one and 1 + `SHARE` lags after its stamp."""

    def __init__(self, node: GraphNode) -> None:
        self.lag = node.scenario.fusion.lag
        """s; 0 = nothing is published."""
        self._frame, self._reached = map_frame(node.scenario), -np.inf
        self._message = empty_odometry(topics.SMOOTHED)
        self._publisher = node.advertise(topics.SMOOTHED) if self.lag > 0.0 else None

    def publish(self, navigator: InertialNavigator | None) -> None:
        """Publish the states that are a lag old, if it is time to look back."""
        if self._publisher is None or navigator is None:
            return
        until = navigator.time - self.lag
        if until < self._reached + SHARE * self.lag:
            return
        stamps, rates = navigator.samples(self._reached, until)
        self._reached = until
        if not len(stamps):
            return
        states = navigator.smoothed(stamps)
        for stamp, rate, state in zip(stamps.tolist(), rates, states, strict=True):
            nav, turn = np.concatenate(state.estimate), state.turn_rate(rate)
            ns = from_seconds(stamp)
            fill_odom(self._message, ns, self._frame, nav, turn, state.covariance)
            self._publisher.publish(self._message)

    def begin_anew(self) -> None:
        """Publish what comes after a reset, whatever its stamps are."""
        self._reached = -np.inf
