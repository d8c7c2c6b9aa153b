"""The page network-scale in small: a tree of real routers, two vehicles, a station; and the fit of its model."""

from pathlib import Path

import pytest
from tests.common.network.scale import TREE, WATCHED, Measured, Scene, measure
from tests.evidence.network_scale import fit

pytestmark = [pytest.mark.sockets, pytest.mark.thorough, pytest.mark.timeout(120)]


def test_a_station_in_a_tree_gets_what_it_watches_and_little_of_the_others(tmp_path: Path) -> None:
    found = {}
    for layout in (TREE, WATCHED):
        (tmp_path / layout).mkdir()
        found[layout] = measure(tmp_path / layout, Scene(layout=layout, vehicles=6, stations=1, seconds=3.0))
    for one in found.values():
        assert one.found_s < 30.0
        assert one.latency_p99_s < 2.0
        assert one.vehicle_bytes_s > 300.0
        assert one.router_cpu >= 0.0
    assert found[TREE].station_bytes_s > 6 * 500.0
    assert found[WATCHED].station_bytes_s < 0.5 * found[TREE].station_bytes_s


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
            latency_p99_s=0.0,
            found_s=0.0,
        )

    def fitted(*points: tuple[int, float]) -> list[float]:
        return fit([of(*point) for point in points], lambda one: one.station_bytes_s, lambda scene: scene.vehicles)

    assert fitted((1, 12.0), (2, 14.0), (10, 30.0)) == pytest.approx([10.0, 2.0])
    assert fitted((1, 0.0), (10, 18.0)) == pytest.approx([0.0, 180.0 / 101.0])
