"""Faults of links, water, motors, disk, date, and commands of operators: what they do to a flight, and how they end."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from gloc3.clock import run_virtual
from gloc3.errors import Refused
from gloc3_sitl.faults.faults import schedule_faults
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan
from gloc3_sitl.vehicles.simulator import Simulator

Look = Callable[[Flight], Any]


def look(faults: tuple[str, ...], at_s: tuple[float, ...], see: Look, **plan: Any) -> list[Any]:
    """What is to be seen in a flight on the ground at some times."""

    async def fly() -> list[Any]:
        async with Flight(FlightPlan(**{"mission": "hop", **plan})) as flight:
            schedule_faults(flight, faults)
            seen = []
            for t_s in at_s:
                await asyncio.sleep(t_s - flight.loop.time())
                seen.append(see(flight))
            return seen

    main: Coroutine[Any, Any, list[Any]] = fly()
    return run_virtual(main)


def radio(flight: Flight) -> tuple[float, float, float]:
    conditions = flight.links.radio.a.conditions
    return conditions.loss, round(conditions.latency_s, 3), conditions.duplicate


def test_faults_of_one_link_overlap_and_each_ends_by_itself() -> None:
    faults = ("link_slow=2@0.1..0.3", "link_loss=0.5@0.2..0.5", "link_twice@0.4..0.6")
    assert look(faults, (0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65), radio) == [
        (0.0, 0.03, 0.0),
        (0.0, 2.0, 0.0),
        (0.5, 2.0, 0.0),
        (0.5, 0.03, 0.0),
        (0.5, 0.03, 1.0),
        (0.0, 0.03, 1.0),
        (0.0, 0.03, 0.0),
    ]


def test_the_worst_of_two_losses_counts() -> None:
    assert look(("cable_loss@0.1..0.3", "cable_loss=0.2@0.2..0.4"), (0.25, 0.35, 0.45), lambda flight: flight.links.cable.b.conditions.loss) == [
        1.0,
        0.2,
        0.0,
    ]  # fmt: skip


def test_the_water_flows_and_stops() -> None:
    def current(flight: Flight) -> Any:
        assert isinstance(flight.simulator, Simulator)
        return [round(one, 3) for one in flight.simulator.body.current_ned_m_s]  # type: ignore[attr-defined]

    found = look(("current=0.5/90@0.1..0.3",), (0.05, 0.2, 0.4), current, mission="survey", platform="boat")
    assert found == [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.0]]
    with pytest.raises(Refused, match="the pelican is not in the water"):
        look(("current=0.5",), (0.1,), current)


def test_a_motor_gives_less_and_one_that_is_not_there_is_refused() -> None:
    def outputs(flight: Flight) -> Any:
        assert isinstance(flight.simulator, Simulator)
        return flight.simulator._weakened((1.0, 1.0, 1.0, 1.0))

    assert look(("motor:2=0.5@0.1..0.3",), (0.2, 0.4), outputs) == [(1.0, 0.5, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0)]
    with pytest.raises(Refused, match="no motor '9'; the pelican has 1 to 4"):
        look(("motor:9",), (0.1,), outputs)


def test_a_full_disk_keeps_nothing_and_a_date_is_set() -> None:
    assert look(("disk_full@0.1..0.3",), (0.2, 0.4), lambda flight: flight.process.disk.is_full) == [True, False]
    dates = look(("clock_jump=3600@0.1",), (0.05, 0.2), lambda flight: flight.clock.utc_s() - flight.clock.now_s())
    assert dates[1] - dates[0] == pytest.approx(3600.0)


def test_a_leak_makes_each_cycle_longer_than_the_one_before() -> None:
    found = look(
        ("leak:pose=0.01@0.1..0.4",), (0.2, 0.3, 0.5), lambda flight: flight.fault_injector.cost_s("pose", 0.0)
    )
    assert 0.0 < found[0] < found[1]
    assert found[2] == 0.0


def test_a_command_of_the_operator_is_checked_against_the_mission() -> None:
    with pytest.raises(Refused, match="unknown command 'stop'"):
        look(("operator:stop",), (0.1,), lambda flight: None)
    with pytest.raises(Refused, match=r"the mission has no 'hop\.op'; did you mean 'hop\.up'"):
        look(("operator:skip=hop.op",), (0.1,), lambda flight: None)
