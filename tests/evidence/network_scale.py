"""How a network grows with vehicles and stations: flat, over one router, over a tree; a model, and where it breaks."""

import os
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from scipy.optimize import nnls
from tests.common.network.scale import FLAT, FOUND_WITHIN_S, LAYOUTS, WATCHED, Measured, Scene, measure, routers_of
from tests.evidence.page import Bar, Figure, Progress

from gloc3.cli.counting import counted
from gloc3.messages.topics import MESSAGE_BYTES

VEHICLES: Final = (1, 5, 20, 50, 200)
STATIONS: Final = (1, 3, 10)
MIDDLE_VEHICLES: Final = 20
MIDDLE_STATIONS: Final = 3
FLAT_VEHICLES: Final = 50
"""With more, each connected to each of three stations, two cores are too few: no bar is set then."""
FULL: Final = 0.7
"""So full the computer may be for the model and the bar of the latency: beyond it, the wait for a core is measured."""
SECONDS: Final = 10.0
PREDICTED: Final = (1_000, 10_000)
ERROR: Final = 0.3
"""Largest error of the model for the bytes of a station, relative to what is measured at the largest number."""
LATE_S: Final = 0.1
FOUND_S: Final = 5.0

Size = Callable[[Scene], float]


def _scenes() -> list[Scene]:
    sizes = [(number, MIDDLE_STATIONS) for number in VEHICLES]
    sizes += [(MIDDLE_VEHICLES, number) for number in STATIONS if number != MIDDLE_STATIONS]
    return [
        Scene(layout=layout, vehicles=vehicles, stations=stations, seconds=SECONDS)
        for layout in LAYOUTS
        for vehicles, stations in sizes
    ]


def _measure(scene: Scene) -> Measured:
    with tempfile.TemporaryDirectory() as folder:
        return measure(Path(folder), scene)


def fit(found: Sequence[Measured], value: Callable[[Measured], float], *of: Size) -> list[float]:
    """The constant and the factors of sizes that fit best, none below 0."""
    sizes = np.array([[1.0, *(size(one.scene) for size in of)] for one in found])
    factors, _ = nnls(sizes, np.array([value(one) for one in found]))
    return [float(factor) for factor in factors]


def scale(progress: Progress) -> list[Figure]:
    """What is measured, the model, and its predictions."""
    found = [
        msgspec.convert(progress.part(f"{one.layout} {one.vehicles} {one.stations}", partial(_measure, one)), Measured)
        for one in _scenes()
    ]
    figures = [_row(one) for one in found]
    held = [one for one in found if one.scene.layout != FLAT or one.scene.vehicles <= FLAT_VEHICLES]
    cores = os.cpu_count() or 1
    roomy = [one for one in held if _cores(one) <= FULL * cores]
    for layout in LAYOUTS:
        figures += _model(layout, [one for one in roomy if one.scene.layout == layout])
    latest, longest_s = max(roomy, key=lambda one: one.latency_p99_s), max(_found_s(one) for one in held)
    late_s = latest.latency_p99_s
    return [
        *figures,
        Figure(
            f"latency p99, the worst where at most {FULL:.0%} of {cores} cores are in use",
            f"{late_s * 1e3:.0f} ms, while a bare loop was late by {latest.bare_p99_s * 1e3:.0f} ms",
            f"≤ {LATE_S * 1e3:.0f} ms",
            late_s <= LATE_S,
        ),
        Figure(
            "time to find all vehicles, the longest",
            f"{longest_s:.1f} s",
            f"≤ {FOUND_S:.0f} s",
            longest_s <= FOUND_S,
        ),
    ]


def _found_s(one: Measured) -> float:
    return float("inf") if one.found_s is None else one.found_s


def _cores(one: Measured) -> float:
    """In use by all processes of a network."""
    routers = len(routers_of(one.scene)) * one.router_cpu
    return one.vehicle_cpu * one.scene.vehicles + one.station_cpu * one.scene.stations + routers


def _row(one: Measured) -> Figure:
    scene = one.scene
    router = f", router {one.router_cpu:.1%}" if one.router_cpu else ""
    found = f"all found after {one.found_s:.1f} s" if one.found_s else f"not all found within {FOUND_WITHIN_S:.0f} s"
    return Figure(
        f"{scene.layout}: {counted(scene.vehicles, 'vehicle')}, {counted(scene.stations, 'station')}",
        f"a station receives {one.station_bytes_s / 1e3:.1f} kB/s, a vehicle sends {one.vehicle_bytes_s / 1e3:.1f} kB/s; of a "
        f"core: station {one.station_cpu:.1%}, vehicle {one.vehicle_cpu:.2%}{router}; in all at most {_cores(one):.1f} cores; latency p50 "
        f"{one.latency_p50_s * 1e3:.0f} ms, p99 {one.latency_p99_s * 1e3:.0f} ms (a bare loop is late by "
        f"{one.bare_p99_s * 1e3:.0f} ms); {found}",
    )


def _model(layout: str, found: Sequence[Measured]) -> list[Figure]:
    """Linear in the number of vehicles, and at the busiest router in vehicles, and in vehicles times stations."""
    by_vehicles, by_links = (
        (lambda scene: float(scene.vehicles)),
        (lambda scene: float(scene.vehicles * scene.stations)),
    )
    size_b = fit(found, lambda one: one.station_bytes_s, by_vehicles)
    cpu = fit(found, lambda one: one.station_cpu, by_vehicles)
    router = fit(found, lambda one: one.router_cpu, by_vehicles, by_links)
    largest = max(found, key=lambda one: one.scene.vehicles)
    error = abs(size_b[0] + size_b[1] * largest.scene.vehicles - largest.station_bytes_s) / largest.station_bytes_s
    text = (
        f"{size_b[0] / 1e3:.2f} + {size_b[1] / 1e3:.3f} kB/s a vehicle; {cpu[0]:.2%} + {cpu[1]:.3%} of a core a vehicle; "
        f"off by {error:.0%} at {largest.scene.vehicles} vehicles"
    )
    figures = [Figure(f"{layout}: model of a station", text, f"off by ≤ {ERROR:.0%}", error <= ERROR)]
    stations, has_router = max(STATIONS), layout != FLAT
    a_vehicle = router[1] + router[2] * stations
    if has_router:
        text = f"{router[0]:.2%} + {router[1]:.3%} of a core a vehicle + {router[2]:.4%} a vehicle and station"
        figures.append(Figure(f"{layout}: model of the busiest router", text))
    for number in PREDICTED:
        busiest = f", the busiest router with {router[0] + a_vehicle * number:.1f}" if has_router else ""
        text = f"a station receives {(size_b[0] + size_b[1] * number) / 1e6:.2f} MB/s with {cpu[0] + cpu[1] * number:.1f} cores"
        figures.append(Figure(f"{layout}: predicted for {number:,} vehicles and {stations} stations", text + busiest))
    limits = [_full("a station's loop has one core, which", cpu[0], cpu[1])]
    if has_router:
        limits.append(_full(f"with {stations} stations the busiest router's first core", router[0], a_vehicle))
    if layout == FLAT:
        limits.append("each vehicle has a connection to each station")
    if layout == WATCHED:
        most = MESSAGE_BYTES / size_b[1] if size_b[1] else float("inf")
        limits.append(f"the summary of one region is too long for a message at {most:,.0f} vehicles")
    return [*figures, Figure(f"{layout}: where it breaks", "; ".join(limits))]


def _full(what: str, constant: float, factor: float) -> str:
    return f"{what} is full at {(1.0 - constant) / factor:,.0f} vehicles" if factor > 1e-7 else f"{what} is never full"


BARS: Final = (
    Bar(
        "network-scale",
        "A station's cost grows with the vehicles that it watches, not with the fleet",
        "Up to 50 vehicles are each a process with its own certificate; 200 are sessions, ten in a process. They send again "
        "what a vehicle in flight has sent to its stations. Routers are `gloc3 network router`, stations join as ours do. "
        "Bytes are counted by the kernel for each TCP connection, processor time for each process, latency from publishing "
        "to the station's loop, on one computer. How late the 99th percentile of a loop that does nothing was meanwhile is "
        "beside it: that is the computer's part. The model is fitted, and the latency has a bar, where at most "
        f"{FULL:.0%} of the cores are in use. With more than {FLAT_VEHICLES} vehicles a network without routers, in which "
        "each is connected to each station, has no bar at all. In a tree vehicles and stations are at different branches, so that messages pass "
        "three routers. In the last layout each station watches one vehicle, and gets summaries of regions of the others. The "
        "model is linear; its predictions are no measurements.",
        scale,
    ),
)
