"""A run while it goes on: what has been recorded so far, for the live page and the dashboard."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from isogal.evaluation.view.page import Frame
from isogal.evaluation.view.record import ViewedRun
from isogal.maps.channels import RouteMap
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory
from isogal_ros.bags.collect import Collector, Follower
from isogal_ros.bags.viewing import viewed_run
from isogal_ros.graph.console import Console
from isogal_ros.graph.progress import Progress, Report

TITLE = "Run, live"


@dataclass(frozen=True, slots=True)
class Live:
    """How a run is watched."""

    page: bool = False
    """Whether a page is served on this machine while it runs."""
    port: int = 0
    """Of the page; 0 = any that is free."""
    dashboard: bool = False
    """Whether the terminal shows a dashboard."""


class Watch:
    """What is known of a run that goes on. Several threads may ask.

    Parameters
    ----------
    folder : Path
        Of the recording.
    """

    def __init__(
        self, scenario: Scenario, trajectory: Trajectory, field_map: RouteMap, folder: Path
    ) -> None:
        self.collector = Collector(scenario)
        self.trajectory, self.field_map = trajectory, field_map
        self.progress: Progress | None = None
        self._follower = Follower(folder, self.collector)
        self._lock = threading.Lock()
        self._seen = -1
        self._viewed: ViewedRun | None = None

    def look(self) -> tuple[int, ViewedRun | None]:
        """Return how many messages there are and what they say; None before the first scan."""
        with self._lock:
            self._follower.look()
            if self._follower.messages != self._seen:
                self._viewed = viewed_run(self.collector, self.field_map, TITLE)
                self._seen = self._follower.messages
            return self._seen, self._viewed

    def frame(self) -> Frame:
        """Return the page's frame: the map and the panels of the whole route."""
        route = self.trajectory
        return Frame.of(
            TITLE,
            f"Matcher {self.collector.scenario.matcher.name}",
            float(route.time[-1] - route.time[0]) / 3600.0,
            (route.latitude, route.longitude),
            self.field_map,
            live=True,
        )


@contextmanager
def watching(live: Live | None, watch: Watch, to: Console) -> Iterator[Report]:
    """Yield what is told the progress of a run, which is watched as long as the block lasts."""
    if live is None or not (live.page or live.dashboard):
        with to.progress() as report:
            yield report
        return
    with ExitStack() as stack:
        if live.page:
            from isogal_ros.graph.live_page import serve

            address = stack.enter_context(serve(watch, live.port))
            to.say(f"Live page, on this machine only: {address}")
        if live.dashboard:
            from isogal_ros.graph.dashboard import dashboard

            show = stack.enter_context(dashboard(watch))
        else:
            show = stack.enter_context(to.progress())

        def report(progress: Progress) -> None:
            watch.progress = progress
            show(progress)

        yield report
