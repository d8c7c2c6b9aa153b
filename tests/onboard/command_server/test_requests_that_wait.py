"""What becomes of a request that waits onboard, for the pre-flight checks or for the check of its mission."""

from concurrent.futures import Executor, Future
from typing import Any

import pytest
from tests.onboard.command_server.test_request_handler import HOP, Desk

from gloc3.component.lci import State
from gloc3.messages.command_interface import (
    Control,
    ControlVerb,
    Emergency,
    EmergencyVerb,
    LoadMission,
    Outcome,
    RequestAction,
    Steer,
    Verb,
)
from gloc3.messages.envelope import ComponentStatus, Envelope, Kind, Source
from gloc3.messages.readiness import AutopilotSetup
from gloc3.messages.vehicle import AutopilotState, LandedState
from gloc3.mission.executing.executor import MissionExecutor
from gloc3.mission.model.states import ActionState


class Later(Executor):
    """Does what it was given when it is told."""

    def __init__(self) -> None:
        self._given: list[tuple[Future[Any], Any, tuple[Any, ...]]] = []

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self._given.append((future, fn, args))
        return future

    def work(self) -> None:
        for future, fn, args in self._given:
            future.set_result(fn(*args))
        self._given.clear()


class Waiting(Desk):
    """A handler whose starts wait until the autopilot's setup has been read."""

    def __init__(self) -> None:
        super().__init__()
        self.reported(Control(verb=ControlVerb.REQUEST))
        self.reported(LoadMission(name="hop", text=HOP))
        self.observing.setup = AutopilotSetup()

    def read(self) -> None:
        """The setup has been read."""
        assert self.observing.setup is not None
        self.observing.setup = AutopilotSetup(number=self.observing.setup.number + 10)

    def mission_state(self) -> ActionState:
        assert self.executor.mission is not None
        return self.executor.mission.state


@pytest.mark.parametrize("verb", [EmergencyVerb.HOLD, EmergencyVerb.LAND])
def test_a_start_that_waits_is_not_carried_out_after_anybody_s_emergency(verb: EmergencyVerb) -> None:
    desk = Waiting()
    assert desk.request(Steer(verb=Verb.START)) is None
    assert desk.reported(Emergency(verb=verb), sender="254", sequence=0).outcome is Outcome.ACCEPTED
    desk.read()
    (reply,) = desk.handler.expire(0.05)
    assert (reply.sender, reply.outcome) == ("255", Outcome.REFUSED)
    assert "superseded by an emergency" in reply.reason
    assert desk.mission_state() is ActionState.WAITING
    assert desk.request(Steer(verb=Verb.START)) is None, "sent again, it is wanted"
    desk.read()
    (reply,) = desk.handler.expire(0.05)
    assert reply.outcome is Outcome.ACCEPTED


def test_an_action_that_is_being_checked_does_not_end_the_hold_of_another_operator() -> None:
    desk = Desk()
    worker = desk.worker = Later()
    desk.executor = MissionExecutor(desk.platform)
    desk.handler = desk.begin()
    desk.reported(Control(verb=ControlVerb.REQUEST))
    state = AutopilotState(is_connected=True, is_armed=True, landed=LandedState.IN_AIR, is_armable=True)
    source = Source("p", "autopilot", 1)
    desk.snapshot.update_autopilot(Envelope("p/autopilot", source, 1, 0.0, "", "AutopilotState", state))
    desk.executor.vehicle(True, 0.0)
    assert desk.request(RequestAction(capability="go_to", arguments={"position_m": [5, 5, 3]})) is None
    desk.reported(Emergency(verb=EmergencyVerb.HOLD), sender="254", sequence=0)
    worker.work()
    (reply,) = desk.handler.expire(0.5)
    assert reply.outcome is Outcome.REFUSED
    assert desk.executor.policy == "hold"


def test_a_start_that_waits_starts_no_mission_that_was_loaded_after_it() -> None:
    desk = Waiting()
    assert desk.request(Steer(verb=Verb.START)) is None
    other = HOP.replace("mission: hop", "mission: higher").replace("height_m: 1.5", "height_m: 5")
    assert desk.reported(LoadMission(name="higher", text=other)).outcome is Outcome.ACCEPTED
    desk.read()
    (reply,) = desk.handler.expire(0.05)
    assert reply.outcome is Outcome.REFUSED
    assert "another mission was loaded" in reply.reason
    assert desk.mission_state() is ActionState.WAITING


def test_a_mission_that_was_paused_on_the_ground_is_resumed_by_the_checks_of_a_start() -> None:
    desk = Desk()
    desk.reported(Control(verb=ControlVerb.REQUEST))
    desk.reported(LoadMission(name="hop", text=HOP))
    desk.reported(Steer(verb=Verb.START))
    desk.reported(Steer(verb=Verb.PAUSE))
    desk.book.receive(
        ComponentStatus(name="limiter", kind=Kind.CONTROLLER, state=State.FAULTY, cause="RuntimeError: broken"), 0.0
    )
    reply = desk.reported(Steer(verb=Verb.RESUME))
    assert reply.outcome is Outcome.REFUSED
    assert "limiter (faulty" in reply.reason
    assert desk.executor.mission is not None
    assert desk.executor.mission.state is ActionState.PAUSED
    override = Steer(verb=Verb.RESUME, override="it is repaired", author="ana")
    assert desk.reported(override).outcome is Outcome.ACCEPTED
    assert any("starts despite red checks: 'it is repaired'" in text for text in desk.said)
