"""How a network grows with vehicles and stations: flat, over one router, over a tree; a model, and where it breaks."""

import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from tests.common.network.scale import FLAT, LAYOUTS, ROUTER, TREE, WATCHED, Measured, Scene, measure
from tests.evidence.page import Bar, Figure, Progress

VEHICLES: Final = (1, 5, 20, 50)
STATIONS: Final = (1, 3, 10)
MIDDLE_VEHICLES: Final = 20
MIDDLE_STATIONS: Final = 3
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


def fit(found: Sequence[Measured], value: Callable[[Measured], float], of: Size) -> tuple[float, float]:
    """The constant and the factor that fit best, neither below 0."""
    sizes = np.array([[1.0, of(one.scene)] for one in found])
    values = np.array([value(one) for one in found])
    (constant, factor), *_ = np.linalg.lstsq(sizes, values, rcond=None)
    if constant < 0.0:
        return 0.0, float(sizes[:, 1] @ values / (sizes[:, 1] @ sizes[:, 1]))
    return float(constant), max(float(factor), 0.0)


def scale(progress: Progress) -> list[Figure]:
    """What is measured, the model, and its predictions."""
    found = [
        msgspec.convert(progress.part(f"{one.layout} {one.vehicles} {one.stations}", partial(_measure, one)), Measured)
        for one in _scenes()
    ]
    figures = [_row(one) for one in found]
    for layout in LAYOUTS:
        figures += _model(layout, [one for one in found if one.scene.layout == layout])
    late_s, longest_s = max(one.latency_p99_s for one in found), max(one.found_s for one in found)
    return [
        *figures,
        Figure("latency p99, the worst of all", f"{late_s * 1e3:.0f} ms", f"≤ {LATE_S * 1e3:.0f} ms", late_s <= LATE_S),
        Figure(
            "time to find all vehicles, the longest", f"{longest_s:.1f} s", f"≤ {FOUND_S:.0f} s", longest_s <= FOUND_S
        ),
    ]


def _row(one: Measured) -> Figure:
    scene = one.scene
    router = f", router {one.router_cpu:.1%}" if one.router_cpu else ""
    return Figure(
        f"{scene.layout}: {scene.vehicles} vehicles, {scene.stations} stations",
        f"a station receives {one.station_bytes_s / 1e3:.1f} kB/s, a vehicle sends {one.vehicle_bytes_s / 1e3:.1f} kB/s; of a "
        f"core: station {one.station_cpu:.1%}, vehicle {one.vehicle_cpu:.2%}{router}; latency p99 "
        f"{one.latency_p99_s * 1e3:.0f} ms; all found after {one.found_s:.1f} s",
    )


def _model(layout: str, found: Sequence[Measured]) -> list[Figure]:
    """Linear in the number of vehicles, and at the busiest router in vehicles times stations."""
    by_vehicles, by_links = (
        (lambda scene: float(scene.vehicles)),
        (lambda scene: float(scene.vehicles * scene.stations)),
    )
    size_b = fit(found, lambda one: one.station_bytes_s, by_vehicles)
    cpu = fit(found, lambda one: one.station_cpu, by_vehicles)
    router = fit(found, lambda one: one.router_cpu, by_links)
    largest = max(found, key=lambda one: one.scene.vehicles)
    error = abs(size_b[0] + size_b[1] * largest.scene.vehicles - largest.station_bytes_s) / largest.station_bytes_s
    figures = [
        Figure(
            f"{layout}: model of a station",
            f"{size_b[0] / 1e3:.2f} + {size_b[1] / 1e3:.3f} kB/s a vehicle; {cpu[0]:.2%} + {cpu[1]:.3%} of a core a vehicle; "
            f"off by {error:.0%} at {largest.scene.vehicles} vehicles",
            f"off by ≤ {ERROR:.0%}",
            error <= ERROR,
        )
    ]
    for number in PREDICTED:
        stations = max(STATIONS)
        busiest = (
            "" if layout == FLAT else f", the busiest router {router[0] + router[1] * number * stations:.1f} cores"
        )
        figures.append(
            Figure(
                f"{layout}: predicted for {number:,} vehicles and {stations} stations",
                f"a station receives {(size_b[0] + size_b[1] * number) / 1e6:.1f} MB/s with {cpu[0] + cpu[1] * number:.1f} "
                f"cores{busiest}",
            )
        )
    breaks = (1.0 - cpu[0]) / cpu[1] if cpu[1] else float("inf")
    text = (
        f"a station's loop has one core: full at {breaks:,.0f} vehicles" if breaks < 1e9 else "not by a station's core"
    )
    if layout in (ROUTER, TREE, WATCHED) and router[1]:
        text += f"; a router's first core is full at {(1.0 - router[0]) / router[1]:,.0f} vehicles times stations"
    if layout == FLAT:
        text += "; each vehicle has a connection to each station"
    return [*figures, Figure(f"{layout}: where it breaks", text)]


BARS: Final = (
    Bar(
        "network-scale",
        "A station's cost grows with the vehicles that it watches, not with the fleet",
        "Vehicles are sessions with their own certificates, several in a process, which send what an onboard process with 21 "
        "components sends to stations, at its rates; routers are `gloc3 network router`, stations join as ours do. Bytes are "
        "counted by the kernel for each TCP connection, processor time for each process, latency from publishing to the "
        "station's loop, on one computer. In a tree vehicles and stations are at different branches, so that messages pass "
        "three routers. In the last layout each station watches one vehicle, and gets summaries of regions of the others. The "
        "model is linear; its predictions are no measurements.",
        scale,
    ),
)
