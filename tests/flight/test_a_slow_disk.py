"""Cards take their time, and now and then a second: the flight does not wait for them, and nobody is told too early."""

import asyncio
from functools import partial
from itertools import pairwise
from typing import Any

import msgspec
import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.messages.command_interface import EmergencyVerb
from gloc3.mission.model.states import ActionState
from gloc3.store import MemoryRecords
from gloc3_onboard.command_server.site import Site

pytestmark = ONE_STYLE
LONGEST_S = 1.0
"""After that stations are told all the same."""
LIMIT_S = 0.3
"""Setpoints come far sooner than the 0.5 s after which an autopilot goes its own ways."""
SETPOINT = "SET_POSITION_TARGET_LOCAL_NED"


class SlowDisk(MemoryRecords):
    """A disk that has what is written a while later."""

    def __init__(self, late_s: float) -> None:
        super().__init__()
        self.late_s = late_s
        self.kept: list[tuple[float, bytes]] = []
        """When the disk had which record."""

    def _write(self, records: list[bytes]) -> None:
        done_s = asyncio.get_running_loop().time() + self.late_s
        self.kept += [(done_s, record) for record in records]

    def append(self, record: bytes, *, outlives_power_cut: bool = True) -> None:
        super().append(record)
        if outlives_power_cut:
            self._write([record])

    def rewrite(self, records: list[bytes], *, outlives_power_cut: bool = True) -> None:
        super().rewrite(records)
        self._write(records)

    def mark(self) -> int:
        return len(self.kept)

    def wait(self, mark: int, most_s: float) -> bool:
        return mark == 0 or asyncio.get_running_loop().time() >= self.kept[mark - 1][0]


@pytest.fixture
def disks(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> list[SlowDisk]:
    """Those of the flight: of its journal, its progress and its events."""
    found: list[SlowDisk] = []

    def disk(late_s: float, _state: object) -> SlowDisk:
        found.append(SlowDisk(late_s))
        return found[-1]

    monkeypatch.setattr("gloc3_sitl.flight.onboard_process.FlightRecords", partial(disk, request.param))
    return found


def started(flight: Card, disks: list[SlowDisk]) -> dict[str, float]:
    """When the disk had it first that an action is under way."""
    found: dict[str, float] = {}
    for t_s, record in disks[1].kept:
        memory = MemoryRecords()
        memory.append(record)
        snapshot, _ = Site(flight.flight.platform, MemoryRecords(), memory, MemoryRecords()).load()
        for program in snapshot.programs if snapshot is not None else []:
            for name, item in program.items.items():
                if item.state is ActionState.RUNNING:
                    found.setdefault(name, t_s)
    return found


def reported(flight: Card, topic: str) -> list[tuple[float, Any]]:
    return [(envelope.t_s, envelope.payload) for envelope in flight.received[topic]]


@pytest.mark.parametrize("disks", [0.4], indirect=True)
def test_no_action_is_reported_started_before_that_is_on_disk(disks: list[SlowDisk], flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep.out", "running")
    kept_s = started(flight, disks)
    for name in ("depart", "depart.climb", "sweep", "sweep.out"):
        first_s = next(t_s for t_s, summary in reported(flight, "ci/mission") if summary.tasks.get(name) == "running")
        assert kept_s[name] <= first_s < kept_s[name] + LONGEST_S
        first_s = next(t_s for t_s, event in reported(flight, "ci/event") if event.text == f"{name} running")
        assert kept_s[name] <= first_s < kept_s[name] + LONGEST_S


@pytest.mark.parametrize("disks", [0.4], indirect=True)
def test_no_command_is_carried_out_before_its_begin_is_on_disk(disks: list[SlowDisk], flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep.out", "running")
    flight.wait(2.0)
    known = len(disks[0].kept)
    flight.command("pause")
    (kept_s, begin), (_, end) = disks[0].kept[known : known + 2]
    assert [msgspec.msgpack.decode(record)[3] is None for record in (begin, end)] == [True, False]
    paused_s = next(event.t_s for event in flight.events if event.text.startswith("mission paused"))
    assert kept_s <= paused_s < kept_s + LIMIT_S


@pytest.mark.parametrize("disks", [0.0, 0.4, float("inf")], indirect=True)
def test_the_vehicle_flies_on_while_the_disk_is_busy(disks: list[SlowDisk], flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep.out", "running")
    flight.wait(2.0)
    since_s = flight.now_s
    flight.command("pause")
    flight.command("resume")
    flight.await_state("mission", "done", 60.0)
    sent = [t_s for t_s, message in flight.to_autopilot if message.name == SETPOINT and t_s > since_s]
    assert max(b - a for a, b in pairwise(sent)) < LIMIT_S
    is_stuck = disks[0].late_s > LONGEST_S
    assert flight.was_told("the disk takes more than a second for each write") is is_stuck


@pytest.mark.parametrize("disks", [float("inf")], indirect=True)
def test_an_emergency_waits_for_no_disk(disks: list[SlowDisk], flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep.out", "running")
    flight.wait(2.0)
    begin_s = flight.now_s
    flight.emergency(EmergencyVerb.HOLD)
    flight.until(lambda: flight.speed_m_s < 0.1, 3.0, "it stands")
    assert flight.now_s - begin_s < 3.5
    held_s = next(t_s for t_s, grant in reported(flight, "motion/grant") if t_s > begin_s and grant.component == "hold")
    assert held_s - begin_s < 0.4
