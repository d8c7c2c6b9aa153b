"""DESIGN §7, supervision: a hung and a crashed component, required and not; quiet standby; reports of slow cycles."""

import pytest
from tests.flight.card import Card
from tests.flight.missions import OUT, mission

from gloc3.component.lci import State
from gloc3.messages.envelope import ComponentStatus
from gloc3.messages.readiness import ComputerState
from gloc3.messages.summaries import Health
from gloc3.messages.vehicle import FlightMode
from gloc3.platform.reader import load_platform
from gloc3_onboard.process.process import DEVICES as PROCESS_DEVICES
from gloc3_sitl.flight.flight import DEVICES


def statuses(flight: Card, component: str, since_s: float) -> list[tuple[float, ComponentStatus]]:
    """When a component told what."""
    received = flight.received[f"components/{component}/status"]
    return [(envelope.t_s, envelope.payload) for envelope in received if envelope.t_s >= since_s]


def sweep(flight: Card, **policies: str) -> None:
    """On the way, two seconds into the sweep."""
    flight.begin(mission(**policies))
    flight.await_state("sweep", "running")
    flight.wait(2.0)


def test_a_quiet_standby_takes_over_from_a_crashed_limiter_within_100_ms(flight: Card) -> None:
    sweep(flight)
    flight.fault("crash:limiter")
    begin_s = flight.now_s
    flight.await_component("limiter_standby", "working", 1.0)
    faulty_s = next(t_s for t_s, status in statuses(flight, "limiter", begin_s) if status.state is State.FAULTY)
    taken_s = next(t_s for t_s, status in statuses(flight, "limiter_standby", begin_s) if status.state is State.WORKING)
    assert taken_s - faulty_s <= 0.1
    gaps = [b.t_s - a.t_s for a, b in zip(flight.received["setpoint"], flight.received["setpoint"][1:], strict=False)]
    flight.await_component("limiter", "quiet")  # it comes up again, as the standby of its standby
    assert flight.driver.expired == 0
    flight.await_state("mission", "done", 30.0)
    assert max(gaps[-100:]) < 0.25


def test_a_quiet_standby_takes_over_from_a_hung_limiter(flight: Card) -> None:
    sweep(flight)
    hang = flight.fault("hang:limiter")
    begin_s = flight.now_s
    flight.await_component("limiter_standby", "working", 2.0)
    hang.end()
    reported = statuses(flight, "limiter", begin_s)
    faulty_s, faulty = next((t_s, status) for t_s, status in reported if status.state is State.FAULTY)
    assert "hung" in faulty.cause
    used = statuses(flight, "limiter_standby", faulty_s)
    assert next(t_s for t_s, status in used if status.state is State.WORKING) - faulty_s <= 0.1
    flight.await_state("mission", "done", 30.0)


def test_a_required_component_that_crashes_once_comes_up_again_and_its_action_is_tried_again(flight: Card) -> None:
    flight.begin(mission("{out: {follow_waypoints: {waypoints_m: [[8, 0, 1.5]], speed_m_s: 1.0}, retries: 1}}"))
    flight.await_state("sweep", "running")
    flight.wait(2.0)
    flight.fault("crash:waypoints")
    flight.await_component("waypoints", "faulty")
    flight.until(lambda: flight.health is Health.FAULTY, 2.0, "the platform is faulty")
    flight.await_component("waypoints", "working")
    flight.await_state("mission", "done", 30.0)
    assert flight.was_told("initialize, start waypoints")
    assert flight.position_m[0] > 7.5


def test_a_required_component_that_keeps_crashing_ends_in_its_failure_policy(flight: Card) -> None:
    sweep(flight, on_failure="hold", on_pose_lost="continue")
    flight.fault("crash:pose", for_s=60.0)
    flight.await_policy("land", 10.0)
    assert flight.was_told("pose is lost")
    flight.await_landed()


def test_a_return_whose_controller_crashes_goes_on_when_it_is_back(flight: Card) -> None:
    sweep(flight, on_low_battery="return")
    flight.wait(2.0)
    flight.fault("battery=0.18")
    flight.await_policy("return", 2.0)
    flight.fault("crash:waypoints", for_s=3.0)
    flight.await_policy("land", 40.0)
    assert flight.was_told("policy return: at home, landing")
    flight.await_landed()


def test_a_limiter_and_its_standby_that_were_both_lost_come_back_and_the_vehicle_lands(flight: Card) -> None:
    sweep(flight, on_failure="land")
    flight.fault("crash:limiter", for_s=8.0)
    flight.wait(4.0)
    flight.fault("crash:limiter_standby", for_s=8.0)
    flight.await_policy("land")
    flight.await_landed(40.0)
    flight.await_component("limiter", "quiet" if flight.lci("limiter_standby") is State.WORKING else "working", 10.0)


def test_without_any_limiter_the_autopilot_lands_by_itself(flight: Card) -> None:
    sweep(flight, on_failure="land")
    flight.fault("crash:limiter", for_s=120.0)
    flight.fault("crash:limiter_standby", for_s=120.0)
    flight.await_policy("land")
    flight.await_landed(30.0)
    assert flight.was_told("the autopilot is asked to land by itself")
    flight.await_policy("")


def test_an_operators_hold_breaks_off_the_landing_that_the_autopilot_flies_by_itself(flight: Card) -> None:
    sweep(flight, on_failure="land")
    flight.fault("crash:landing", for_s=120.0)
    flight.emergency("land")
    flight.await_mode(FlightMode.LAND)
    flight.emergency("hold")
    flight.wait(2.0)
    assert flight.was_told("the autopilot is asked to hold by itself")
    held_m = flight.height_m
    flight.wait(30.0)
    assert flight.height_m == pytest.approx(held_m, abs=0.2)
    assert flight.mission.policy == "hold"


def test_a_required_component_that_hangs_is_replaced_by_a_new_one(flight: Card) -> None:
    sweep(flight, on_failure="hold")
    hang = flight.fault("hang:waypoints")
    flight.await_component("waypoints", "faulty")
    assert "hung" in flight.last("components/waypoints/status").cause
    hang.end()
    flight.await_policy("hold")
    flight.await_component("waypoints", "working")
    flight.command("resume")
    flight.await_state("mission", "done", 30.0)


def test_a_component_that_is_not_required_may_crash_without_harm(flight: Card) -> None:
    sweep(flight)
    begin_s = flight.now_s
    flight.fault("crash:height", for_s=60.0)
    flight.await_state("mission", "done", 30.0)
    assert all(summary.health is Health.WORKING for summary in flight.since(begin_s, "ci/summary"))
    assert flight.lci("height") is State.FAULTY


def test_a_component_that_is_not_required_may_hang_without_harm(flight: Card) -> None:
    sweep(flight)
    flight.fault("hang:height")
    flight.await_component("height", "faulty")
    flight.await_state("mission", "done", 30.0)
    assert "hung" in flight.last("components/height/status").cause


def test_slow_cycles_are_counted_and_reported_and_the_vehicle_flies_on(flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep", "running")
    flight.fault("slow:waypoints=0.07")
    flight.wait(3.0)
    status = flight.last("components/waypoints/status")
    assert status.cycle_mean_s > 0.06
    assert status.overruns > 10
    assert status.state is State.WORKING
    index = [row.name for row in flight.last("ci/table").rows].index("waypoints")
    line = flight.last("ci/summary").lines[index]
    assert line.overruns > 10
    assert line.load_percent > 100
    flight.await_state("mission", "done", 30.0)


@pytest.mark.parametrize("fault", ["crash", "hang"])
def test_a_driver_that_fails_in_flight_leaves_the_hold_and_the_mission_goes_on_when_it_is_back(
    flight: Card, fault: str
) -> None:
    sweep(flight)
    flight.fault(f"{fault}:autopilot_driver", for_s=0.3)
    flight.await_component("autopilot_driver", "faulty", 1.0)
    flight.await_mode(FlightMode.HOLD, 2.0)
    flight.await_component("autopilot_driver", "working", 3.0)
    flight.until(lambda: flight.state("mission") in ("done", "failed"), 30.0, "the mission has ended")
    flight.await_landed()
    assert not flight.was_told("the pilot has control")


def test_a_pilot_who_takes_over_while_the_driver_is_away_keeps_control(flight: Card) -> None:
    sweep(flight)
    flight.fault("hang:autopilot_driver", for_s=1.0)
    flight.wait(0.5)
    flight.fault("pilot:position")
    flight.await_component("autopilot_driver", "working", 5.0)
    flight.await_policy("pilot", 3.0)
    flight.always(lambda: flight.autopilot.mode is FlightMode.MANUAL, 4.0, "the pilot flies")


def test_while_the_driver_keeps_failing_the_autopilot_holds_and_when_it_is_back_the_policy_is_carried_out(
    flight: Card,
) -> None:
    sweep(flight, on_failure="land")
    flight.fault("crash:autopilot_driver", for_s=8.0)
    flight.await_mode(FlightMode.HOLD, 2.0)
    flight.wait(5.0)
    flight.always(lambda: flight.speed_m_s < 0.1, 1.0, "it stands")
    assert flight.height_m == pytest.approx(1.5, abs=0.4)
    flight.await_landed(40.0)


@pytest.mark.parametrize("style", ["px4"], indirect=True)
def test_no_component_shows_another_rate_than_its_own_on_the_ground_and_in_flight(flight: Card) -> None:
    photos = "photos: {record_images: {camera: ground, every_s: 1}, until: out}"
    flight.begin(mission("{out: {" + OUT + "}, " + photos + "}"))
    flight.await_state("sweep", "running")
    flight.wait(3.0)
    table, summary = flight.last("ci/table"), flight.last("ci/summary")
    shown = {
        row.name: (row.nominal_rate_hz, line.rate_percent) for row, line in zip(table.rows, summary.lines, strict=True)
    }
    assert shown["pose"] == shown["limiter"] == (20.0, 100)
    triggered = [row.name for row in table.rows if row.is_triggered]
    assert triggered == ["pose", "limiter", "limiter_standby", "ground_recorder"]
    least = {name: 0 if name in triggered else 85 for name in shown}
    assert {name: percent for name, (_, percent) in shown.items() if not least[name] <= percent <= 110} == {}


@pytest.mark.parametrize("style", ["px4"], indirect=True)
def test_every_device_that_a_row_may_name_is_there_and_every_one_that_is_there_may_be_named(flight: Card) -> None:
    flight.begin(mission(), is_started=False)
    onboard = flight.flight.process.onboard
    assert onboard is not None
    assert sorted(onboard.devices) == sorted(name for name in DEVICES if "*" not in name)
    load_platform("pelican_rtk", is_loading_classes=True, devices=PROCESS_DEVICES)


def test_a_log_that_stops_in_flight_is_an_alert_that_names_it(flight: Card) -> None:
    sweep(flight)
    stopped = ComputerState(log_problem="log.mcap: No space left on device; log.tlog: No space left on device")
    flight.flight.exchange.publish(flight.envelope("computer", stopped))
    flight.wait(3.0)
    assert flight.was_told("logging has stopped: log.mcap: No space left on device; log.tlog")
    assert flight.was_told("logging goes on")
