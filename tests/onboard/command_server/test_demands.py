"""Velocities that stations ask for by hand: the holder of control alone, in order, and none that was held up on its way."""

from typing import Any

from tests.onboard.messages import at

from gloc3.messages.command_interface import Control, ControlVerb, StationRole
from gloc3.messages.envelope import Severity
from gloc3.messages.teleoperation import EXPIRES_S, VelocityDemand
from gloc3.network.rights import Rights
from gloc3_onboard.command_server.authority import DEMANDS_AGAIN_S as AGAIN_S
from gloc3_onboard.command_server.authority import ControlAuthority, Demands


class Desk:
    """Station 255 holds control; its clock is 1000 s behind the vehicle's."""

    def __init__(self) -> None:
        self.reported: list[str] = []
        authority = ControlAuthority()
        authority.handle("255", Control(verb=ControlVerb.REQUEST), 5.0, 0.0)
        self.demands = Demands(authority, self._report, Rights("pelican"))

    def _report(self, severity: Severity, text: str, /, *, cause: str = "") -> None:
        assert severity is Severity.WARNING
        self.reported.append(text)

    def take(self, *sequences: int, sent_s: float = 0.0, now_s: float = 1000.0, **fields: Any) -> list[int]:
        """The sequences that count of demands that come together."""
        values = {"sender": "255", "session": 7, **fields}
        demands = [at(sent_s, VelocityDemand(sequence=one, **values)) for one in sequences]
        return [one.sequence for one in self.demands.newest(demands, now_s)]


def test_of_those_that_come_together_the_newest_counts_and_none_counts_twice() -> None:
    desk = Desk()
    assert desk.take(0, 1, 2) == [2]
    assert desk.take(2) == []
    assert desk.take(1) == []
    assert desk.take(4, 3) == [4]
    assert desk.take(0, session=8) == [0]
    assert desk.reported == []


def test_nobody_but_an_operator_who_holds_control_is_obeyed_and_that_is_told_now_and_then() -> None:
    desk = Desk()
    assert desk.take(0, sender="254") == []
    assert desk.take(1, sender="254") == []
    assert desk.take(0, role=StationRole.OBSERVER) == []
    assert desk.reported == [
        "velocities of station 254 are ignored: station 255 holds control; request control first",
        "velocities of station 255 are ignored: it is an observer",
    ]
    assert desk.take(2, sender="254", now_s=1000.0 + AGAIN_S) == []
    assert len(desk.reported) == 3
    assert desk.take(0) == [0], "what others sent does not count for it"


def test_what_the_link_held_up_is_not_carried_out_whatever_the_clocks_say() -> None:
    desk = Desk()
    assert desk.take(0, sent_s=0.0, now_s=1000.05) == [0]
    assert desk.take(1, sent_s=0.1, now_s=1000.1 + EXPIRES_S) == [1]
    held_up = [desk.take(n, sent_s=0.1 * n, now_s=1003.0) for n in range(2, 20)]
    assert held_up == [[]] * 18
    assert desk.reported == [
        "velocities of station 255 are ignored: they are 2.7 s late; press the keys again if the link stays slow"
    ]
    assert desk.take(30, sent_s=3.0, now_s=1003.1) == [30]


def test_what_comes_late_of_a_session_that_is_over_counts_no_more() -> None:
    desk = Desk()
    assert desk.take(0, 1, 2) == [2]
    assert desk.take(0, session=8) == [0]
    assert desk.take(3, 4, now_s=1009.0) == [], "by a slower way"
    assert desk.take(1, session=8) == [1]
    assert desk.take(0, session=9, sent_s=float("nan")) == []


def test_clocks_that_run_apart_make_nothing_late() -> None:
    desk = Desk()
    for n in range(20_000):
        sent_s = 0.1 * n
        assert desk.take(n, sent_s=sent_s, now_s=1000.0 + sent_s * 1.0005) == [n]
