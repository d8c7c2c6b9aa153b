"""PX4's arm authorization: who is asked, what the answers do, and how long one waits."""

import pytest

from gloc3.mavlink.codec import MavlinkMessage
from gloc3_sitl.autopilot.modes import Result

from .bench import ARM, Bench

REQUEST = 3001


class Authorizer(Bench):
    """The vehicle, and somebody on its link who is asked for leave."""

    def __init__(self, *, two_steps: bool = False) -> None:
        super().__init__("px4", parameters={"COM_ARM_AUTH_REQ": 1, "COM_ARM_AUTH_ID": 1, "COM_ARM_AUTH_MET": two_steps})
        self.get_ready()
        self.received.clear()

    def wants_to_arm(self) -> None:
        self.send("COMMAND_LONG", target_system=1, target_component=1, command=ARM, param1=1.0)

    def requested(self) -> list[MavlinkMessage]:
        return [
            received for received in self.received if received.name == "COMMAND_LONG" and received.command == REQUEST
        ]

    def answer(self, result: Result, reason: int = 0, extra: int = 0) -> None:
        fields = {"result": result, "progress": reason, "result_param2": extra}
        self.send("COMMAND_ACK", command=REQUEST, target_system=1, target_component=1, **fields)

    def results(self) -> list[Result]:
        """How the attempts to arm have ended."""
        return [
            Result(received.result)
            for received in self.received
            if received.name == "COMMAND_ACK" and received.command == ARM
        ]


def test_it_arms_when_leave_is_given_and_says_nothing_before() -> None:
    bench = Authorizer()
    bench.wants_to_arm()
    (request,) = bench.requested()
    assert (request.target_system, request.target_component) == (1, 0)
    bench.run(0.3)
    assert (bench.is_armed, bench.results()) == (False, [])
    bench.answer(Result.IN_PROGRESS)
    bench.run(0.3)
    bench.answer(Result.ACCEPTED, extra=5)
    bench.run(0.1)
    assert (bench.is_armed, bench.results()) == (True, [Result.ACCEPTED])


def test_leave_holds_as_long_as_was_said() -> None:
    bench = Authorizer()
    bench.wants_to_arm()
    bench.answer(Result.ACCEPTED, extra=5)
    bench.run(0.1)
    assert bench.command(ARM, 0.0) is Result.ACCEPTED
    bench.run(3.0)
    assert bench.command(ARM, 1.0) is Result.ACCEPTED, "still"
    assert bench.command(ARM, 0.0) is Result.ACCEPTED
    bench.run(2.0)
    requested = len(bench.requested())
    bench.wants_to_arm()
    bench.run(0.1)
    assert len(bench.requested()) == requested + 1
    assert not bench.is_armed


@pytest.mark.parametrize(
    ("result", "reason", "text"),
    [
        (Result.DENIED, 0, "Arming: authorization refused"),
        (Result.DENIED, 1, ""),
        (Result.DENIED, 5, "Arming: authorization refused: the weather is bad"),
        (Result.TEMPORARILY_REJECTED, 0, "Arming: authorization refused for now"),
    ],
)
def test_without_leave_it_does_not_arm_and_says_why_unless_the_authorizer_does(
    result: Result, reason: int, text: str
) -> None:
    bench = Authorizer()
    bench.sim.texts.clear()
    bench.wants_to_arm()
    bench.answer(result, reason)
    bench.run(0.2)
    assert (bench.is_armed, bench.results()) == (False, [Result.TEMPORARILY_REJECTED])
    assert bench.texts == ([text] if text else [])


def test_nobody_waits_longer_than_the_parameter_says_and_force_asks_nobody() -> None:
    bench = Authorizer()
    bench.set_parameter("COM_ARM_AUTH_TO", 2.0)
    bench.wants_to_arm()
    bench.run(1.9)
    assert bench.results() == []
    bench.run(0.2)
    assert bench.results() == [Result.TEMPORARILY_REJECTED]
    assert bench.texts[-1] == "Arming: no answer from the authorizer"
    bench.answer(Result.ACCEPTED, extra=60)
    bench.run(1.0)
    assert not bench.is_armed, "too late"
    assert bench.command(ARM, 1.0, 21196.0) is Result.ACCEPTED


def test_in_two_steps_the_first_attempt_asks_and_the_second_arms() -> None:
    bench = Authorizer(two_steps=True)
    assert bench.command(ARM, 1.0) is Result.TEMPORARILY_REJECTED
    bench.answer(Result.ACCEPTED, extra=10)
    bench.run(1.0)
    assert not bench.is_armed
    assert bench.command(ARM, 1.0) is Result.ACCEPTED


def test_a_transmitter_has_to_wait_for_leave_too() -> None:
    bench = Authorizer()
    bench.pilot.switch_on()
    bench.pilot.arm()
    bench.run(0.2)
    assert len(bench.requested()) == 1
    assert not bench.is_armed
    bench.answer(Result.ACCEPTED, extra=5)
    bench.run(0.1)
    assert bench.is_armed
