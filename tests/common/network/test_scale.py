"""The page network-scale in small: a tree of real routers, two vehicles, a station; and the fit of its model."""

from collections import Counter
from pathlib import Path

import pytest
from tests.common.network.scale import FLAT, TREE, WATCHED, Measured, Scene, measure, recorded
from tests.evidence.network_scale import fit

pytestmark = [pytest.mark.sockets, pytest.mark.thorough, pytest.mark.timeout(120)]


def test_a_station_in_a_tree_gets_what_it_watches_and_little_of_the_others(tmp_path: Path) -> None:
    found = {}
    for layout in (TREE, WATCHED):
        (tmp_path / layout).mkdir()
        found[layout] = measure(tmp_path / layout, Scene(layout=layout, vehicles=6, stations=1, seconds=3.0))
    for one in found.values():
        assert one.found_s is not None
        assert one.found_s < 30.0
        assert 0.0 < one.latency_p50_s <= one.latency_p99_s < 2.0
        assert one.bare_p99_s > 0.0
        assert one.vehicle_bytes_s > 300.0
        assert one.router_cpu >= 0.0
    assert found[TREE].station_bytes_s > 6 * 500.0
    assert found[WATCHED].station_bytes_s < 0.5 * found[TREE].station_bytes_s


def test_bytes_are_counted_once_where_a_vehicle_listens(tmp_path: Path) -> None:
    found = measure(tmp_path, Scene(layout=FLAT, vehicles=2, stations=1, seconds=3.0))
    assert found.vehicle_bytes_s * 2 == pytest.approx(found.station_bytes_s, rel=0.3)


def test_what_a_vehicle_sends_is_recorded_in_flight() -> None:
    messages = recorded()
    lasts_s = messages[-1].at_s
    assert lasts_s > 10.0
    rates_hz = {topic: number / lasts_s for topic, number in Counter(one.topic for one in messages).items()}
    assert {"ci/summary", "ci/vehicle", "ci/motion", "ci/mission", "ci/control", "ci/table"} <= rates_hz.keys()
    assert rates_hz["ci/summary"] == pytest.approx(2.0, rel=0.1)


def test_the_model_is_the_line_that_fits_best_and_costs_nothing_below_zero() -> None:
    def of(vehicles: int, value: float) -> Measured:
        scene = Scene(layout=TREE, vehicles=vehicles, stations=1)
        return Measured(
            scene=scene,
            station_bytes_s=value,
            vehicle_bytes_s=0.0,
            station_cpu=0.0,
            vehicle_cpu=0.0,
            router_cpu=0.0,
            latency_p50_s=0.0,
            latency_p99_s=0.0,
            bare_p99_s=0.0,
            found_s=0.0,
        )

    def fitted(*points: tuple[int, float]) -> list[float]:
        return fit([of(*point) for point in points], lambda one: one.station_bytes_s, lambda scene: scene.vehicles)

    assert fitted((1, 12.0), (2, 14.0), (10, 30.0)) == pytest.approx([10.0, 2.0])
    assert fitted((1, 0.0), (10, 18.0)) == pytest.approx([0.0, 180.0 / 101.0])
