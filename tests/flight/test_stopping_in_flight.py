"""The onboard process is told to stop in flight: the vehicle is left in a mode of its autopilot's own."""

from tests.flight.card import Card

from gloc3.component.lci import State
from gloc3.messages.vehicle import FlightMode
from gloc3.mission.model.states import ActionState

PROGRESS_S = 4.0


def stop(flight: Card) -> list[str]:
    reported: list[str] = []
    onboard = flight.flight.process.onboard
    assert onboard is not None
    flight.run(onboard.stop(reported.append))
    return reported


def test_hold_is_confirmed_before_the_driver_leaves(flight: Card) -> None:
    flight.begin("inspection")
    flight.await_state("sweep", "running", 30.0)
    flight.wait(PROGRESS_S)
    assert flight.autopilot.mode is FlightMode.GUIDED
    begin_s = flight.now_s
    assert stop(flight) == []
    assert flight.now_s - begin_s < 3.0
    onboard = flight.flight.process.onboard
    assert onboard is not None
    assert all(onboard.state(name) is None for name in onboard.hosts)
    left_s = next(
        envelope.t_s
        for envelope in flight.received["components/autopilot_driver/status"]
        if envelope.payload.state is None
    )
    held = [e for e in flight.received["autopilot"] if e.payload.mode is FlightMode.HOLD and begin_s <= e.t_s <= left_s]
    assert held, flight.story("the driver left before hold was confirmed")
    assert flight.state("mission") == ActionState.RUNNING, "the progress that a restart finds is that of a flight"
    flight.wait(3.0)
    assert flight.height_m > 1.0
    assert flight.speed_m_s < 0.3


def test_a_driver_whose_hold_is_never_confirmed_is_left_after_a_while_with_a_word_to_the_operator(
    flight: Card,
) -> None:
    flight.begin("inspection")
    flight.await_state("sweep", "running", 30.0)
    flight.wait(PROGRESS_S)
    flight.fault("cable_loss")
    reported = stop(flight)
    assert [text for text in reported if text.startswith("autopilot_driver has not left: ")], reported
    onboard = flight.flight.process.onboard
    assert onboard is not None
    assert [name for name in onboard.hosts if onboard.state(name) is not None] == ["autopilot_driver"]
    assert onboard.state("autopilot_driver") is State.WORKING


def test_on_the_ground_everything_leaves_at_once(flight: Card) -> None:
    flight.begin("hop", is_started=False)
    begin_s = flight.now_s
    assert stop(flight) == []
    assert flight.now_s - begin_s < 0.5
