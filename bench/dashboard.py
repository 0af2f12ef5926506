"""The page and its stream, measured: latency, load by the number of viewers, traffic, a thin link, a large map."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from bench.benchmark import Bench, Column, Crew, Row, figures, middle, runs

MILLISECONDS = Column("median / p99 / worst (ms)", figures("ms", 0, 0.5, 0.99, 1.0))


def part(name: str) -> Callable[[Crew], Iterator[Row]]:
    """The rows of a part of `bench.browser`, which is imported when it runs: it needs a browser."""

    def rows(_: Crew) -> Iterator[Row]:
        from bench import browser

        with browser.chromium() as chromium, tempfile.TemporaryDirectory() as folder:
            yield from getattr(browser, name)(chromium, Path(folder))

    return rows


BENCHES = (
    Bench(
        "page-latency",
        "the page: key pressed to the command on the wire, reading on the wire to the screen",
        part("latency"),
        (Column("times", runs), MILLISECONDS),
        minutes=2,
        heading="from ... to",
    ),
    Bench(
        "page-load",
        "the page: the event loop's share of a core and its delays with 1, 10 and 50 viewers beside a browser",
        part("load"),
        (
            Column("of a core (%)", middle("core", 0)),
            Column("delay, median (ms)", middle("late_p50_ms", 1)),
            Column("p99", middle("late_p99_ms", 1)),
            Column("worst", middle("late_worst_ms", 0)),
            Column("poses/s, the least viewer's", middle("rate", 1)),
            Column("the browser's", middle("browser", 1)),
        ),
        minutes=2,
        heading="viewers",
    ),
    Bench(
        "page-traffic",
        "the page: what a viewer of a two-minute drive is sent, by topic",
        part("traffic"),
        (Column("frames/s", middle("frames", 1)), Column("kB/s", middle("kilobytes", 1))),
        minutes=3,
        heading="topic",
    ),
    Bench(
        "page-thin",
        "the page: age of the pose over a link of 30 kB/s",
        part("thin"),
        (Column("times", runs), MILLISECONDS),
        minutes=2,
        heading="drive",
    ),
    Bench(
        "page-smooth",
        "the page: pictures per second of the map of a 250 m drive while it is dragged and zoomed",
        part("smooth"),
        (Column("pictures/s", middle("rate", 0)),),
        minutes=2,
        heading="map",
    ),
)
