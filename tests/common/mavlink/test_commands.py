"""Commands: retried until answered, run once, and every end has a name."""

import math
from collections.abc import Callable

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import ATTEMPTS, CommandCall, MavCommandClient
from gloc3.mavlink.services.command_server import CancelServer, CommandCancel, MavCommandRequest, MavCommandServer
from gloc3.mavlink.transport.memory import Conditions

from .pair import STATION, VEHICLE, Pair

ARM, TAKE_OFF, REPOSITION, LAND, START, REQUEST_MESSAGE = 400, 22, 192, 21, 300, 512


class Vehicle:
    """Answers commands as it is told, and keeps them."""

    def __init__(self, pair: Pair, answer: Callable[[MavCommandRequest], CommandResult | None]) -> None:
        self.server = MavCommandServer(VEHICLE, {ARM, TAKE_OFF, REPOSITION}, is_autopilot=True)
        self.ran: list[MavCommandRequest] = []

        def after(now_s: float) -> None:
            for request in self.server.events():
                self.ran.append(request)
                result = answer(request)
                if result is not None:
                    self.server.answer(request, result, now_s=now_s)

        pair.vehicle.after = after


def accept(request: MavCommandRequest) -> CommandResult:
    return CommandResult.ACCEPTED


def wired(
    answer: Callable[[MavCommandRequest], CommandResult | None] = accept,
    seed: int = 1,
    conditions: Conditions | None = None,
) -> tuple[Pair, MavCommandClient, Vehicle]:
    pair = Pair(seed, conditions or Conditions(latency_s=0.02))
    vehicle, client = Vehicle(pair, answer), MavCommandClient(STATION)
    pair.add([vehicle.server], [client])
    return pair, client, vehicle


def finish(pair: Pair, call: CommandCall, for_s: float = 30.0) -> CommandResult | None:
    pair.run(for_s, lambda: call.result is not None)
    return call.result


def test_a_command_is_run_and_answered() -> None:
    pair, client, vehicle = wired()
    call = client.send_long(VEHICLE, ARM, (1.0, math.nan), now_s=0.0)
    assert finish(pair, call) is CommandResult.ACCEPTED
    assert client.events() == [call]
    (request,) = vehicle.ran
    assert (request.command, request.sender, request.params[0], request.is_int) == (ARM, STATION, 1.0, False)
    assert math.isnan(request.params[1])
    assert "COMPONENT_ARM_DISARM to 1/1: accepted" in repr(call)


def test_what_must_not_run_twice_is_sent_once_and_waited_for() -> None:
    pair, client, vehicle = wired(conditions=Conditions(latency_s=0.9))
    call = client.send_long(VEHICLE, ARM, (1.0,), now_s=0.0, is_repeatable=False)
    assert finish(pair, call) is CommandResult.ACCEPTED
    assert (call.attempts, len(vehicle.ran), vehicle.server.repeated) == (ATTEMPTS, 1, 0)
    pair, client, vehicle = wired(conditions=Conditions(latency_s=0.02, loss=1.0))
    call = client.send_long(VEHICLE, ARM, (1.0,), now_s=0.0, is_repeatable=False)
    assert finish(pair, call) is CommandResult.NO_ANSWER
    assert pair.now_s == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("seed", range(20))
def test_over_a_bad_link_a_command_is_run_exactly_once(seed: int) -> None:
    pair, client, vehicle = wired(seed=seed, conditions=Conditions(latency_s=0.05, loss=0.2, duplicate=0.1))
    for number in range(5):
        call = client.send_long(VEHICLE, ARM, (float(number % 2),), now_s=pair.now_s)
        assert finish(pair, call) is CommandResult.ACCEPTED
        pair.run(1.0)
    assert [request.params[0] for request in vehicle.ran] == [0.0, 1.0, 0.0, 1.0, 0.0]


def test_a_position_comes_as_degrees_whichever_way_it_was_sent() -> None:
    pair, client, vehicle = wired()
    call = client.send_int(VEHICLE, REPOSITION, (1, 1), frame=6, position=(395_000_000, -26_500_000, 12.5), now_s=0.0)
    assert finish(pair, call) is CommandResult.ACCEPTED
    call = client.send_int(VEHICLE, REPOSITION, frame=1, position=(25_000, 0x7FFF_FFFF, -3.0), now_s=pair.now_s)
    assert finish(pair, call) is CommandResult.ACCEPTED
    first, second = vehicle.ran
    assert first.params[4:] == (39.5, -2.65, 12.5)
    assert (second.params[4], math.isnan(second.params[5]), second.params[6], second.frame) == (2.5, True, -3.0, 1)


def test_nobody_there_is_told_in_good_time() -> None:
    pair, client, _ = wired(conditions=Conditions(loss=1.0))
    call = client.send_long(VEHICLE, ARM, now_s=0.0)
    assert finish(pair, call) is CommandResult.NO_ANSWER
    assert call.attempts == ATTEMPTS
    assert pair.now_s < 5.0


def test_progress_prolongs_the_waiting_and_nothing_is_sent_again() -> None:
    pair, client, vehicle = wired(lambda request: CommandResult.IN_PROGRESS)
    call = client.send_long(VEHICLE, TAKE_OFF, now_s=0.0)
    for percent in (20, 40, 60, 80):
        pair.run(3.0)
        vehicle.server.answer(vehicle.ran[0], CommandResult.IN_PROGRESS, progress=percent, now_s=pair.now_s)
    pair.run(1.0)
    assert (call.result, call.progress, call.attempts) == (None, 80, 1)
    vehicle.server.answer(vehicle.ran[0], CommandResult.FAILED, result_param2=7, now_s=pair.now_s)
    assert finish(pair, call) is CommandResult.FAILED
    assert call.result_param2 == 7
    assert len(vehicle.ran) == 1


def test_progress_that_stops_is_no_answer() -> None:
    pair, client, _ = wired(lambda request: CommandResult.IN_PROGRESS)
    call = client.send_long(VEHICLE, TAKE_OFF, now_s=0.0)
    assert finish(pair, call) is CommandResult.NO_ANSWER
    assert pair.now_s == pytest.approx(5.04)


def test_one_command_of_a_kind_at_a_time() -> None:
    pair, client, vehicle = wired(lambda request: None)
    client.send_long(VEHICLE, TAKE_OFF, now_s=0.0)
    with pytest.raises(Refused, match="MAV_CMD_NAV_TAKEOFF to 1/1 is still under way"):
        client.send_long(VEHICLE, TAKE_OFF, now_s=0.0)
    pair.run(0.1)
    other = message("COMMAND_LONG", target_system=1, target_component=1, command=TAKE_OFF)
    vehicle.server.receive(other, Address(254, 190), 0.2)
    (answer,) = vehicle.server.outgoing()
    assert (answer.result, answer.target_system) == (CommandResult.TEMPORARILY_REJECTED, 254)
    again = message("COMMAND_LONG", target_system=1, target_component=1, command=TAKE_OFF, confirmation=1)
    vehicle.server.receive(again, STATION, 0.3)
    (answer,) = vehicle.server.outgoing()
    assert answer.result == CommandResult.IN_PROGRESS
    changed = message("COMMAND_LONG", target_system=1, target_component=1, command=TAKE_OFF, param7=99.0)
    vehicle.server.receive(changed, STATION, 0.4)
    (answer,) = vehicle.server.outgoing()
    assert answer.result == CommandResult.TEMPORARILY_REJECTED
    assert len(vehicle.ran) == 1


def test_the_same_command_given_again_later_runs_again() -> None:
    pair, client, vehicle = wired()
    for _ in range(2):
        finish(pair, client.send_long(VEHICLE, ARM, (1.0,), now_s=pair.now_s))
        pair.run(1.0)
    assert len(vehicle.ran) == 2


class Line:
    """A server that accepts all, and messages to it at times of one's choice."""

    def __init__(self) -> None:
        self.server = MavCommandServer(VEHICLE)
        self.ran: list[tuple[float, int]] = []

    def send(self, at_s: float, command: int, confirmation: int = 0, sender: Address = STATION) -> None:
        """Sends a COMMAND_LONG; it is answered with ACCEPTED in any case."""
        fields = {"target_system": 1, "target_component": 1, "command": command, "confirmation": confirmation}
        self.server.receive(message("COMMAND_LONG", **fields), sender, at_s)
        for request in self.server.events():
            self.ran.append((at_s, request.command))
            self.server.answer(request, CommandResult.ACCEPTED, now_s=at_s)
        assert [ack.result for ack in self.server.outgoing()] == [CommandResult.ACCEPTED]


def test_a_command_given_again_runs_again_although_its_first_frame_is_lost() -> None:
    line = Line()
    line.send(0.0, LAND)
    line.send(5.5, LAND, confirmation=1)
    line.send(6.0, START)
    line.send(8.5, LAND, confirmation=1)
    assert line.ran == [(0.0, LAND), (5.5, LAND), (6.0, START), (8.5, LAND)]
    line = Line()
    line.send(0.0, LAND)
    line.send(2.0, LAND, confirmation=1)
    line.send(3.0, LAND, confirmation=1)
    assert line.ran == [(0.0, LAND), (3.0, LAND)], "a client never repeats with the same confirmation"


def test_a_command_that_is_given_again_and_again_is_not_put_off_by_its_own_duplicates() -> None:
    """As MAVSDK's offboard is, until the vehicle has seen setpoints."""
    line = Line()
    for number in range(7):
        line.send(0.2 * number, LAND)
    assert [t_s for t_s, _ in line.ran] == pytest.approx([0.0, 0.4, 0.8, 1.2])


def test_repeats_run_nothing_while_their_sender_waits_for_the_answer() -> None:
    line = Line()
    for confirmation in range(4):
        line.send(3.0 * confirmation, LAND, confirmation)
    line.send(9.1, LAND, 3)
    line.send(9.2, LAND, 2)
    assert line.ran == [(0.0, LAND)]
    line = Line()
    line.send(0.0, LAND)
    line.send(0.3, START)
    line.send(0.5, LAND, confirmation=1)
    assert line.ran == [(0.0, LAND), (0.3, START)], "both are under way"
    line = Line()
    line.send(0.0, LAND)
    line.send(0.5, START, sender=Address(254, 190))
    line.send(1.0, REQUEST_MESSAGE)
    line.send(2.0, LAND, confirmation=1)
    assert line.ran == [(0.0, LAND), (0.5, START), (1.0, REQUEST_MESSAGE)], "neither is a later command of its sender"


def test_a_goto_given_again_after_another_command_is_not_taken_for_a_repeat() -> None:
    pair, client, vehicle = wired()
    goto = {"frame": 6, "position": (1, 2, 3.0)}
    finish(pair, client.send_int(VEHICLE, REPOSITION, now_s=pair.now_s, **goto))  # type: ignore[arg-type]
    finish(pair, client.send_long(VEHICLE, ARM, now_s=pair.now_s))
    finish(pair, client.send_int(VEHICLE, REPOSITION, now_s=pair.now_s, **goto))  # type: ignore[arg-type]
    assert [request.command for request in vehicle.ran] == [REPOSITION, ARM, REPOSITION]


def test_a_repeated_goto_runs_once_although_another_station_or_a_query_has_come_between() -> None:
    server = MavCommandServer(VEHICLE)
    goto = message("COMMAND_INT", target_system=1, target_component=1, command=REPOSITION, x=1, y=2, z=3.0)
    query = message("COMMAND_LONG", target_system=1, target_component=1, command=REQUEST_MESSAGE)
    arm = message("COMMAND_LONG", target_system=1, target_component=1, command=ARM)
    ran: list[int] = []
    for command, sender in ((goto, STATION), (query, STATION), (arm, Address(254, 190)), (goto, STATION)):
        server.receive(command, sender, 0.0)
        for request in server.events():
            ran.append(request.command)
            server.answer(request, CommandResult.ACCEPTED, now_s=0.0)
    assert ran == [REPOSITION, REQUEST_MESSAGE, ARM]


def test_an_abandoned_command_is_not_sent_again_and_makes_room_for_the_next_of_its_kind() -> None:
    client = MavCommandClient(STATION)
    first = client.send_long(VEHICLE, ARM, (1.0,), now_s=0.0)
    client.outgoing()
    client.abandon(first)
    client.abandon(first)
    client.tick(10.0)
    assert (client.outgoing(), client.events(), client.next_tick_s()) == ([], [], None)
    second = client.send_long(VEHICLE, ARM, (0.0,), now_s=10.0)
    client.abandon(first)
    client.receive(message("COMMAND_ACK", command=ARM), VEHICLE, 10.1)
    assert client.events() == [second]
    assert first.result is None


def test_what_is_not_supported_is_said_by_who_was_meant() -> None:
    pair, client, _ = wired()
    assert finish(pair, client.send_long(VEHICLE, 31_010, now_s=0.0)) is CommandResult.UNSUPPORTED
    companion = MavCommandServer(Address(1, 191), {ARM})
    for component, expected in ((0, 0), (191, 1), (1, 0)):
        companion.receive(message("COMMAND_LONG", command=5, target_system=1, target_component=component), STATION, 0.0)
        assert len(companion.outgoing()) == expected


def test_answers_from_elsewhere_and_unknown_results_do_no_harm() -> None:
    client = MavCommandClient(STATION)
    call = client.send_long(VEHICLE, ARM, now_s=0.0)
    client.receive(message("COMMAND_ACK", command=ARM), Address(2, 1), 0.1)
    client.receive(message("COMMAND_ACK", command=TAKE_OFF), VEHICLE, 0.1)
    client.receive(message("COMMAND_ACK", command=ARM, target_system=254), VEHICLE, 0.1)
    assert call.result is None
    client.receive(message("COMMAND_ACK", command=ARM, result=77), VEHICLE, 0.1)
    assert call.result is CommandResult.OTHER
    assert all(result.words for result in CommandResult)


def test_memory_for_answers_is_bounded() -> None:
    server = MavCommandServer(VEHICLE)
    for number in range(2000):
        sender = Address(1 + number % 200, number // 200)
        server.receive(message("COMMAND_LONG", command=number % 3, target_system=1), sender, 0.0)
        for request in server.events():
            server.answer(request, CommandResult.ACCEPTED, now_s=0.0)
    assert len(server._known) <= 128


def test_whom_a_server_does_not_serve_gets_no_answer_at_all() -> None:
    server = MavCommandServer(VEHICLE, serves=lambda request: request.target == VEHICLE and request.sender == STATION)
    for target, sender in (((1, 0), STATION), ((1, 1), Address(254, 190)), ((1, 1), STATION)):
        fields = {"target_system": target[0], "target_component": target[1], "command": 31000}
        server.receive(message("COMMAND_LONG", **fields), sender, 0.0)
    assert [event.sender for event in server.events()] == [STATION]


def test_a_cancel_is_taken_from_anybody_for_us_alone_and_told_with_the_commands_own_acknowledgement() -> None:
    server = CancelServer(VEHICLE)
    for target in ((1, 0), (0, 0), (2, 1), (1, 1)):
        reported = message("COMMAND_CANCEL", target_system=target[0], target_component=target[1], command=TAKE_OFF)
        server.receive(reported, STATION, 0.0)
    (cancel,) = server.events()
    assert cancel == CommandCancel(TAKE_OFF, STATION)
    server.cancelled(cancel)
    (answer,) = server.outgoing()
    assert (answer.command, answer.result, answer.target_system) == (TAKE_OFF, CommandResult.CANCELLED, STATION.system)
