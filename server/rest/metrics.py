"""REST for Prometheus: the status as figures, taken when it asks.

Uses its siblings `cockpit`, `health` (whose checks are figures too) and `views`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from fastapi import APIRouter, Request, Response
from prometheus_client import CollectorRegistry, ProcessCollector
from prometheus_client.exposition import choose_encoder
from prometheus_client.metrics_core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    InfoMetricFamily,
    Metric,
    StateSetMetricFamily,
)
from prometheus_client.registry import Collector

from server.cockpit import PREFIX, Cockpit
from server.rest.health import checks_of
from server.views import Status

FILTER_STATES = ("starting", "idle", "busy", "restarting", "failed")
EXAMPLE: dict[str, Any] = {
    "content": {"text/plain": {"example": "# TYPE crunch_battery_volts gauge\ncrunch_battery_volts 28.1\n"}}
}

Gauge = tuple[str, str, float | None]  # name, explanation, value
Counter = tuple[str, str, float]


def metrics_routes(cockpit: Cockpit) -> APIRouter:
    """One route for Prometheus."""
    router = APIRouter(prefix=PREFIX)
    registry = CollectorRegistry()
    registry.register(StatusCollector(cockpit))
    ProcessCollector(registry=registry)

    @router.get("/metrics", tags=["watching"], response_class=Response, responses={200: EXAMPLE})
    async def metrics(request: Request) -> Response:
        """Figures of robot, link, map, filter, viewers and process, in Prometheus's text format or OpenMetrics."""
        encode, media_type = choose_encoder(request.headers.get("accept", ""))
        return Response(encode(registry), headers={"Content-Type": media_type, "Cache-Control": "no-cache"})

    return router


class StatusCollector(Collector):
    """The status as metrics, taken when Prometheus asks; what the robot has not told yet is left out."""

    def __init__(self, cockpit: Cockpit):
        self.cockpit = cockpit

    def describe(self) -> list[Metric]:
        """Nothing beforehand: registering must not ask for a status."""
        return []

    def collect(self) -> Iterator[Metric]:
        """One family per figure."""
        status = self.cockpit.status()
        yield InfoMetricFamily("crunch", "What runs.", {"version": status.version, "robot": status.robot.name})
        for name, text, value in gauges_of(status):
            if value is not None:
                yield GaugeMetricFamily(f"crunch_{name}", text, float(value))
        for name, text, value in counters_of(status):
            yield CounterMetricFamily(f"crunch_{name}", text, value)
        states = {state: state == status.filter.state for state in FILTER_STATES}
        yield StateSetMetricFamily("crunch_filter_state", "What the path filter's process does.", states)
        checks = GaugeMetricFamily("crunch_check", "1 while a check of /health holds.", labels=["name"])
        for check in checks_of(status):
            checks.add_metric([check.name], float(check.ok))
        yield checks


def gauges_of(status: Status) -> list[Gauge]:
    """What goes up and down."""
    robot, link, floor, worker = status.robot, status.link, status.map, status.filter
    driver, loop = status.driver, status.loop
    return [
        ("battery_volts", "Voltage of the battery.", robot.battery_volts),
        ("battery_amperes", "Current out of the battery.", robot.battery_amperes),
        ("charger_volts", "Voltage of the charger.", robot.charger_volts),
        ("tilt_radians", "Lean of the body.", robot.tilt_rad),
        ("link_connected", "1 while a line to the robot is open.", link.connected),
        ("link_silence_seconds", "Since the last good frame.", link.silence_s),
        ("link_lost_ratio", "Share of frames lost in the last seconds.", link.lost_percent / 100.0),
        ("map_vertices", "Vertices of the best path.", floor.vertices),
        (
            "map_settled_vertices",
            "Vertices on which all particles of the island that is told agree.",
            floor.fixed_depth,
        ),
        ("map_path_metres", "Length of the best path.", floor.path_length_m),
        ("filter_particles", "Particles now.", worker.particles),
        ("filter_effective_particles", "Particles that carry weight.", worker.effective_particles),
        ("filter_waiting_vertices", "Vertices not yet in the estimate.", worker.waiting),
        ("filter_load_ratio", "Share of time that the filter computes.", worker.load),
        ("loop_late_p50_seconds", "How late the event loop is, median of the last 20 s.", 1e-3 * loop.late_p50_ms),
        ("loop_late_p99_seconds", "The same, 99th percentile.", 1e-3 * loop.late_p99_ms),
        ("viewers", "Open pages and streams.", driver.viewers),
        ("driver_leased", "1 while somebody drives.", driver.leased),
        ("stopped", "1 while a stop holds.", driver.stopped_by is not None),
    ]


def counters_of(status: Status) -> list[Counter]:
    """What only grows during a session; Prometheus puts `_total` behind the names."""
    frames = status.link.counters
    return [
        ("distance_metres", "Way driven.", status.robot.distance_m),
        ("link_frames", "Good frames from the robot.", frames.get("frames", 0.0)),
        ("link_lost_frames", "Frames that the sequence numbers miss.", frames.get("lost", 0.0)),
        ("link_rejected_frames", "Frames with a wrong checksum or length.", frames.get("rejected", 0.0)),
        ("link_reconnects", "Lost lines that were opened again.", status.link.reconnects),
        ("filter_resamplings", "Resamplings of the particles.", status.filter.resamplings),
        ("filter_restarts", "Filter processes that were replaced.", status.filter.restarts),
    ]
