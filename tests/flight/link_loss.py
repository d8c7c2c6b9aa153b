"""Each link lost in each phase of a flight, for a short time, for long, and with a restart of who is at its other end.

What is looked at: that the loss is noticed and shown, that the mission's policy acts on it, that all is as before once the
link is back, and that a further flight can be begun.
"""

import asyncio
from typing import NamedTuple

import msgspec
from tests.flight.card import Card
from tests.flight.missions import mission

from gloc3.messages.command_interface import Outcome, Preflight, Steer, Verb
from gloc3.messages.preflight import PreflightReport, red
from gloc3_sitl.autopilot.surroundings import SupplyState

LINKS = ("station", "autopilot")
PHASES = ("idle", "taking off", "mission", "paused", "landing")
LOSSES = ("short", "long", "restart")
SHORT_S = {"station": 2.0, "autopilot": 0.25}
"""Shorter than anybody acts upon."""
LONG_S = {"station": 8.0, "autopilot": 6.0}
LINK_LOSS_S = 5.0
GONE_S = 2.5
REPORTED_S = 2.0
"""So long after it is noticed the station shows it, or the platform has told it."""


class Case(NamedTuple):
    """One cell of the matrix."""

    style: str
    link: str
    phase: str
    loss: str

    @property
    def is_running(self) -> bool:
        """Whether the policies of the mission act in this phase."""
        return self.phase in ("taking off", "mission")


class Found(msgspec.Struct, frozen=True):
    """What became of it."""

    noticed_s: float
    """After the loss began; negative where nothing had to be noticed."""
    policy: str
    """What the mission did on it; empty where it went on."""
    end: str
    """The mission's state at the end."""
    flight_s: float


def fly(card: Card, case: Case) -> Found:
    """Flies one cell; fails, with the story, where something is not as it should be."""
    card.begin(mission(on_link_loss="hold", on_pose_lost="continue", hold_s=120), is_started=case.phase != "idle")
    _reach(card, case.phase)
    began_s = card.now_s
    noticed_s = _lose(card, case)
    policy = card.mission.policy
    _recover(card, case)
    _finish(card, case)
    end = card.state("mission")
    _begin_anew(card)
    return Found(noticed_s=noticed_s, policy=policy, end=end, flight_s=card.now_s - began_s)


def fall(card: Card) -> Found:
    """The autopilot boots anew in the air: the vehicle falls, nobody arms it again, and the operator sets all right."""
    card.begin(mission(on_link_loss="hold", on_pose_lost="continue"))
    _reach(card, "mission")
    began_s = card.now_s
    card.flight.simulator.switch(SupplyState.REBOOT)
    noticed_s = card.until(lambda: card.was_told("the autopilot has restarted", began_s), 8.0, "the restart is told")
    card.until(lambda: not card.autopilot.is_armed, 3.0, "it is known to be disarmed")
    card.always(lambda: not card.autopilot.is_armed, 10.0, "nobody arms it")
    assert len([one for one in card.events if "has restarted" in one.text]) == 1, card.story("one restart is one")
    end = card.state("mission")
    card.request(Steer(verb=Verb.ABORT))
    card.request(Steer(verb=Verb.RESUME))
    card.until(lambda: not card.driver.has_pilot_control, 3.0, "the operator has given it back")
    _begin_anew(card)
    return Found(noticed_s=noticed_s, policy="", end=end, flight_s=card.now_s - began_s)


def _reach(card: Card, phase: str) -> None:
    match phase:
        case "taking off":
            card.until(lambda: card.height_m > 0.4, 15.0, "it climbs")
        case "mission" | "paused":
            card.await_state("sweep", "running")
            card.wait(1.0)
            if phase == "paused":
                card.command("pause")
                card.await_state("mission", "paused")
        case "landing":
            card.await_state("recover", "running", 30.0)
            card.until(lambda: card.height_m < 1.3, 15.0, "it descends")


def _lose(card: Card, case: Case) -> float:
    """Loses the link, watches that it is noticed, and gives it back; how long the noticing took."""
    began_s = card.now_s
    is_station = case.link == "station"
    if case.loss == "restart":
        noticed_s = _restart_station(card, case) if is_station else _restart_at_the_cable(card, case)
    else:
        for_s = (SHORT_S if case.loss == "short" else LONG_S)[case.link]
        fault = card.fault("link_loss" if is_station else "cable_loss")
        if case.loss == "short":
            card.wait(for_s)
            noticed_s = -1.0
        else:
            noticed_s = _notice(card, case, began_s)
            card.wait(max(0.0, began_s + for_s - card.now_s))
        fault.end()
    return noticed_s


def _notice(card: Card, case: Case, began_s: float) -> float:
    """Waits until the platform and the station have noticed."""
    if case.link == "station":
        card.until(lambda: _is_shown_silent(card), LONG_S["station"], "the station shows that nothing is heard")
        if case.phase != "idle":
            card.until(lambda: card.was_told("link lost", began_s), LONG_S["station"], "the platform tells it")
        if case.is_running:
            card.until(lambda: card.mission.policy == "hold", 1.0, "it holds")
        return card.now_s - began_s
    card.until(lambda: not card.autopilot.is_connected, GONE_S + 1.0, "the autopilot has gone")
    elapsed_s = card.now_s - began_s
    card.until(lambda: not card.last("ci/vehicle").is_autopilot_connected, REPORTED_S, "the stations are told")
    return elapsed_s


def _is_shown_silent(card: Card) -> bool:
    station = card.flight.station
    known = station.fleet.get(card.flight.name)
    return known is not None and known.is_quiet_link(station.now_s())


def _restart_station(card: Card, case: Case) -> float:
    """The station's process dies, and comes again under the same id."""
    flight, began_s = card.flight, card.now_s
    card.run(flight.ground.close())
    card.wait(LONG_S["station"])
    if case.is_running:
        assert card.mission.policy == "hold", card.story("it holds without a station")
    card.run(_new_station(card))
    return LINK_LOSS_S if card.was_told("link lost", began_s) else -1.0


async def _new_station(card: Card) -> None:
    flight = card.flight
    flight.start_station(4711)  # a new process
    await asyncio.sleep(3.0)


def _restart_at_the_cable(card: Card, case: Case) -> float:
    """On the ground the autopilot boots anew; in the air, where that would be a crash, the companion's process does."""
    began_s = card.now_s
    if case.phase != "idle":
        card.fault("restart")
        card.wait(4.0)
        return -1.0
    card.flight.simulator.switch(SupplyState.REBOOT)
    card.until(lambda: card.was_told("the autopilot has restarted", began_s), 8.0, "the restart is told")
    return card.now_s - began_s


def _recover(card: Card, case: Case) -> None:
    """Once the link is back all is as it was."""
    card.until(lambda: card.autopilot.is_connected, 30.0, "the autopilot answers")
    card.until(lambda: card.last("ci/vehicle").is_autopilot_connected, 3.0, "the stations see it")
    card.wait(1.0)  # so long a person takes to see it
    card.until(lambda: card.mission.policy in ("", "hold", "land"), 3.0, "the policy is known")
    if not card.last("ci/control").holder:
        card.run(_take_control(card))
    card.until(lambda: card.last("ci/control").holder == "255", 5.0, "the station has control")
    assert not card.driver.has_pilot_control, card.story("nobody took the vehicle over")


async def _take_control(card: Card) -> None:
    await card.flight.station.client.request_control(card.flight.name)


def _finish(card: Card, case: Case) -> None:
    """The operator goes on where he must, and the mission comes to its end on the ground."""
    if case.phase == "idle":
        return
    if card.state("mission") == "paused":
        card.command("resume")
    card.until(lambda: card.state("mission") in ("done", "failed"), 90.0, "the mission ends")
    card.await_landed()


def _begin_anew(card: Card) -> None:
    """Nothing is left over: the list is as before the first start, and a further flight begins."""
    card.until(lambda: card.autopilot.is_armable, 60.0, "it would arm")
    card.until(lambda: card.last("pose").is_valid, 20.0, "there is a position")
    card.wait(2.0)
    card.run(card._upload())
    report = msgspec.convert(card.request(Preflight()).result, PreflightReport)
    assert not red(report.checks), card.story("; ".join(map(str, red(report.checks))))
    assert card.mission.policy == ""
    assert card.request(Steer(verb=Verb.START)).outcome is Outcome.ACCEPTED, card.story("a further start")
    card.until(lambda: card.autopilot.is_armed and card.height_m > 0.3, 15.0, "it flies again")
