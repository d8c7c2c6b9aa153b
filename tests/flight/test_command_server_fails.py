"""The command interface server itself crashes or hangs in flight: its heartbeat says so, and it comes back."""

from errno import ENOSPC

import pytest
from tests.flight.card import Card
from tests.flight.missions import mission

from gloc3.mavlink.codec import MavlinkMessage
from gloc3.store import MemoryRecords
from gloc3_groundstation.station.fleet import INTERFACE_RESTARTED, RESTARTED
from gloc3_onboard.companion.station_link import ONBOARD_CONTROLLER

HOME_M = 0.3
ACTIVE, CRITICAL = 4, 5
"""Of MAV_STATE."""


def own_heartbeats(flight: Card) -> list[tuple[float, MavlinkMessage]]:
    """Those of the companion; stations' own are passed on to the autopilot, too."""
    sent = [(t_s, message) for t_s, message in flight.to_autopilot if message.name == "HEARTBEAT"]
    return [(t_s, message) for t_s, message in sent if message.type == ONBOARD_CONTROLLER]


def sweep(flight: Card, **policies: str) -> None:
    """On the way, two seconds into the sweep."""
    flight.begin(mission(**policies))
    flight.await_state("sweep.out", "running")
    flight.wait(2.0)


@pytest.mark.parametrize("fault", ["crash", "hang"])
def test_a_server_that_fails_in_flight_comes_back_and_the_mission_goes_on_by_on_restart(
    flight: Card, fault: str
) -> None:
    sweep(flight, on_restart="continue")
    flight.fault(f"{fault}:command_server", for_s=0.4)
    flight.until(lambda: flight.lci("command_server") == "faulty", 1.0, "it is faulty")
    flight.await_component("command_server", "working", 3.0)
    flight.await_state("mission", "done", 40.0)
    texts = [event.text for event in flight.flight.station.fleet.events]
    assert INTERFACE_RESTARTED in texts
    assert RESTARTED not in texts
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)
    assert not flight.driver.has_pilot_control


def test_who_watches_a_server_that_fails_is_never_told_of_no_mission(flight: Card) -> None:
    sweep(flight)
    begin_s = flight.now_s
    digest = flight.mission.digest
    flight.fault("crash:command_server")
    flight.await_component("command_server", "working", 3.0)
    flight.await_policy("hold", 5.0)
    assert {message.digest for message in flight.since(begin_s, "ci/mission")} == {digest}
    assert flight.mission.state == "paused"


def test_a_server_that_fails_in_flight_holds_until_an_operator_acts(flight: Card) -> None:
    sweep(flight)
    flight.fault("crash:command_server")
    flight.until(lambda: flight.lci("command_server") == "faulty", 1.0, "it is faulty")
    flight.await_component("command_server", "working", 3.0)
    flight.await_policy("hold", 5.0)
    flight.until(lambda: flight.speed_m_s < 0.05, 6.0, "it stands")
    flight.command("resume")
    flight.await_state("mission", "done", 40.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)


def test_without_a_server_the_vehicle_holds_by_itself_and_no_heartbeat_lies(flight: Card) -> None:
    sweep(flight)
    flight.fault("hang:command_server")
    flight.wait(2.0)
    begin_s = flight.now_s
    flight.wait(10.0)
    assert flight.speed_m_s < 0.1
    assert flight.height_m == pytest.approx(1.5, abs=0.4)
    assert not [t_s for t_s, _ in own_heartbeats(flight) if t_s > begin_s]
    assert not flight.since(begin_s, "ci/summary")


def test_the_heartbeat_is_critical_while_a_required_component_is_faulty(flight: Card) -> None:
    sweep(flight)
    begin_s = flight.now_s
    flight.fault("crash:limiter", for_s=20.0)
    flight.wait(3.0)
    heartbeats = own_heartbeats(flight)
    assert all(message.system_status == ACTIVE for t_s, message in heartbeats if 4.0 < t_s <= begin_s)
    assert all(message.system_status == CRITICAL for t_s, message in heartbeats if t_s > begin_s + 0.6)
    flight.await_state("mission", "done", 40.0)  # the standby flies


def test_a_disk_that_is_full_ends_no_flight_and_is_told(flight: Card, monkeypatch: pytest.MonkeyPatch) -> None:
    sweep(flight, on_restart="continue")

    def full(*_: object, **__: object) -> None:
        raise OSError(ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(MemoryRecords, "append", full)
        patch.setattr(MemoryRecords, "rewrite", full)
        flight.command("pause")
        flight.wait(2.0)
        flight.command("resume")
        flight.wait(1.0)
    assert flight.lci("command_server") == "working"
    for what in ("progress", "journal of requests"):
        reported = f"the {what} cannot be kept: No space left on device; a restart would know an older state"
        assert flight.was_told(reported), what
    assert flight.was_told("events cannot be kept: No space left on device")
    flight.wait(1.5)
    assert flight.was_told("the state is written to disk again")
    flight.fault("crash:command_server", for_s=0.4)
    flight.await_state("mission", "done", 40.0)
    assert flight.position_m[0] == pytest.approx(8.0, abs=HOME_M)
