"""Other programs' stations at the onboard computer: commands, missions and control, by MAVLink's protocols alone."""

from random import Random

from tests.flight.card import ONE_STYLE, Card
from tests.flight.tool import COMPANION, GEO_HOP, HOP, Tool, item

from gloc3.mavlink.codec import Encoder, Frame, Parser, message
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.mission_client import Transfer
from gloc3.mavlink.services.parameter_client import ParameterResult
from gloc3.mavlink.services.plan import PlanResult, PlanType
from gloc3.mavlink.transport.memory import Conditions, MemoryEnd, MemoryLink
from gloc3.messages.command_interface import CiRequest, Control, ControlVerb, LoadMission, Outcome, Steer, Verb

pytestmark = [ONE_STYLE]

REQUEST_CONTROL, START, PAUSE_CONTINUE, USER, ARM = 32100, 300, 193, 31010, 400


def begun(flight: Card, *, is_free: bool = True) -> Tool:
    """A station of others beside one of ours, which has given up control."""
    flight.begin(GEO_HOP, is_started=False)
    if is_free:
        assert flight.request(Control(verb=ControlVerb.RELEASE)).outcome is Outcome.ACCEPTED
        flight.wait(1.1)
    return Tool(flight)


def upload(tool: Tool, items: tuple[object, ...], kind: PlanType = PlanType.MISSION) -> Transfer:
    return tool.missions.upload(COMPANION, items, kind=kind, now_s=tool.now_s)  # type: ignore[arg-type]


def reasons(flight: Card) -> list[str]:
    return [event.payload.text for event in flight.received.get("components/companion/event", [])]


def test_an_uploaded_plan_is_a_mission_that_flies_pauses_and_ends(flight: Card) -> None:
    tool = begun(flight)
    assert tool.wait_for(upload(tool, HOP)) is PlanResult.ACCEPTED
    flight.until(lambda: flight.mission.name == "plan of station 250", 1.0, "the mission is shown")
    assert [key for key in flight.mission.tasks if "." in key] == ["fly.take_off", "fly.way", "fly.land"]
    assert tool.wait_for(download := tool.missions.download(COMPANION, now_s=tool.now_s)) is PlanResult.ACCEPTED
    assert [(one.command, one.x, one.y, one.z) for one in download.items] == [(o.command, o.x, o.y, o.z) for o in HOP]

    second = Tool(flight, system=249)
    assert second.command(START) is CommandResult.NOT_IN_CONTROL
    assert not flight.autopilot.is_armed
    assert tool.command(START) is CommandResult.ACCEPTED
    flight.await_state("fly.way", "running", 30.0)

    before = flight.flight.process.vehicle.companion.plans.refused
    assert second.wait_for(upload(second, HOP[:2])) is PlanResult.DENIED
    assert second.wait_for(second.missions.clear(COMPANION, now_s=tool.now_s)) is PlanResult.DENIED
    assert tool.wait_for(upload(tool, HOP[:2])) is PlanResult.DENIED, "its own station neither, while it runs"
    assert flight.flight.process.vehicle.companion.plans.refused == before + 3
    assert any("station 250 holds control" in text for text in reasons(flight))
    assert any("is running; abort it first" in text for text in reasons(flight))

    assert tool.command(PAUSE_CONTINUE, 0.0) is CommandResult.ACCEPTED
    flight.await_state("mission", "paused")
    assert second.command(PAUSE_CONTINUE, 1.0) is CommandResult.NOT_IN_CONTROL
    flight.wait(8.0)
    assert flight.mission.policy == "", "the station is heard: no link loss"
    resume = tool.commands.send_int(COMPANION, PAUSE_CONTINUE, (1.0,), frame=0, now_s=tool.now_s)
    assert tool.wait_for(resume) is CommandResult.ACCEPTED
    flight.await_state("mission", "done", 60.0)
    flight.until(lambda: not flight.autopilot.is_armed, 5.0, "disarmed")
    assert flight.mission.name == "plan of station 250"


def test_a_start_that_is_repeated_is_carried_out_once_and_what_it_began_can_be_cancelled(flight: Card) -> None:
    tool = begun(flight)
    assert tool.wait_for(upload(tool, HOP)) is PlanResult.ACCEPTED
    sent = {"command": START, "param1": 0.0}
    for confirmation in range(4):
        tool.send("COMMAND_LONG", **sent, confirmation=confirmation)
        flight.wait(0.3)
    requested = [one.payload for one in flight.received["ci/request"] if isinstance(one.payload.body, Steer)]
    assert [one.body.verb for one in requested] == [Verb.START]
    assert all(
        one.result in (CommandResult.ACCEPTED, CommandResult.IN_PROGRESS) for one in tool.reported("COMMAND_ACK")
    )
    flight.await_state("fly.take_off", "running")
    Tool(flight, system=249).send("COMMAND_CANCEL", command=START)
    flight.wait(1.0)
    assert flight.state("mission") == "running", "another one's is not his to cancel"
    tool.send("COMMAND_CANCEL", command=START)
    flight.await_state("mission", "aborted")
    flight.wait(0.1)
    assert tool.reported("COMMAND_ACK")[-1].result == CommandResult.CANCELLED


def test_what_is_no_command_of_an_onboard_computer_is_refused_with_a_reason(flight: Card) -> None:
    tool = begun(flight)
    for command, params, expected in (
        (ARM, (1.0,), CommandResult.UNSUPPORTED),
        (185, (1.0,), CommandResult.UNSUPPORTED),
        (31000, (), CommandResult.UNSUPPORTED),
        (START, (2.0, 3.0), CommandResult.DENIED),
        (PAUSE_CONTINUE, (3.0,), CommandResult.DENIED),
        (PAUSE_CONTINUE, (0.0,), CommandResult.DENIED),
        (USER, (7.0,), CommandResult.DENIED),
        (21, (0.0, 0.0, 0.0, 0.0, 47.0, 8.0), CommandResult.DENIED),
        (511, (512.0, 1000.0), CommandResult.DENIED),
        (511, (30.0, 1e5), CommandResult.DENIED),
        (512, (77777.0,), CommandResult.UNSUPPORTED),
    ):
        flight.wait(1.0)  # so few that each reason is told
        count = len(reasons(flight))
        assert tool.command(command, *params) is expected, (command, params)
        assert len(reasons(flight)) == count + 1, (command, params)
        assert "station 250" in reasons(flight)[-1]
    assert flight.flight.process.vehicle.companion.commands.refused == 11


def test_a_command_for_everybody_or_for_the_autopilot_is_not_ours(flight: Card) -> None:
    tool = begun(flight)
    for target in ((1, 0), (0, 0), (1, 1), (2, 191)):
        fields = {"target_system": target[0], "target_component": target[1]}
        tool.send_to("COMMAND_LONG", command=START, **fields)
        tool.send_to("COMMAND_LONG", command=512, param1=148, **fields)
    flight.wait(2.0)
    assert not tool.reported("COMMAND_ACK")
    assert not tool.reported("AUTOPILOT_VERSION")
    assert not [one for one in flight.received["ci/request"] if isinstance(one.payload.body, Steer)]


def test_messages_are_told_on_request_and_at_the_rate_that_is_asked_for(flight: Card) -> None:
    tool = begun(flight)
    for number, name in ((148, "AUTOPILOT_VERSION"), (397, "COMPONENT_METADATA"), (42, "MISSION_CURRENT")):
        assert tool.command(512, number) is CommandResult.ACCEPTED
        flight.wait(0.1)
        assert len(tool.reported(name)) == 1
    assert tool.reported("MISSION_CURRENT")[0].total == 5, "the mission that our own station has loaded"
    flight.wait(10.0)
    assert 2 <= len(tool.reported("ONBOARD_COMPUTER_STATUS")) <= 3
    tool.received.clear()
    assert tool.command(511, 512.0, 2e5) is CommandResult.ACCEPTED
    flight.wait(4.0)
    assert 19 <= len(tool.reported("CONTROL_STATUS")) <= 22
    assert tool.command(511, 512.0, -1.0) is CommandResult.ACCEPTED
    tool.received.clear()
    flight.wait(3.0)
    assert not tool.reported("CONTROL_STATUS")


def test_a_mission_of_our_own_station_is_given_to_others_with_its_fence(flight: Card) -> None:
    fenced = GEO_HOP.replace("frame: geo", "frame: geo\ngeofence: {circle: {center: [39.5528, 2.6285], radius_m: 80}}")
    flight.begin(fenced, is_started=False)
    tool = Tool(flight)
    flight.wait(0.5)
    assert tool.wait_for(mission := tool.missions.download(COMPANION, now_s=tool.now_s)) is PlanResult.ACCEPTED
    assert [one.command for one in mission.items] == [22, 178, 16, 16, 21]
    fence = tool.missions.download(COMPANION, kind=PlanType.FENCE, now_s=tool.now_s)
    assert tool.wait_for(fence) is PlanResult.ACCEPTED
    assert [(one.command, one.param1) for one in fence.items] == [(5003, 80.0)]


def test_a_fence_belongs_to_the_uploaded_mission_and_rally_points_to_none(flight: Card) -> None:
    tool = begun(flight)
    circle = item(5003, frame=0, param1=60.0, height_m=0.0)
    assert tool.wait_for(upload(tool, HOP)) is PlanResult.ACCEPTED
    assert tool.wait_for(upload(tool, (circle,), PlanType.FENCE)) is PlanResult.ACCEPTED
    assert tool.wait_for(upload(tool, (), PlanType.RALLY)) is PlanResult.ACCEPTED
    assert tool.wait_for(upload(tool, (item(5100),), PlanType.RALLY)) is PlanResult.UNSUPPORTED
    flight.until(lambda: bool(flight.last("motion/geofence").areas), 2.0, "the fence is in force")
    assert flight.last("motion/geofence").areas[0].radius_m == 60.0
    small = item(5003, frame=0, param1=2.0, height_m=0.0)
    assert tool.wait_for(upload(tool, (small,), PlanType.FENCE)) is PlanResult.INVALID, "the waypoints are outside"
    assert flight.last("motion/geofence").areas[0].radius_m == 60.0, "the one before stays"
    assert tool.wait_for(upload(tool, (), PlanType.FENCE)) is PlanResult.ACCEPTED
    assert tool.wait_for(tool.missions.clear(COMPANION, now_s=tool.now_s)) is PlanResult.ACCEPTED
    flight.until(lambda: flight.mission.digest == "", 1.0, "no mission is loaded")


def fenced(tool: Tool) -> str:
    """Uploads a mission and a fence; the digest of what is loaded then."""
    circle = item(5003, frame=0, param1=60.0, height_m=0.0)
    assert tool.wait_for(upload(tool, HOP)) is PlanResult.ACCEPTED
    assert tool.wait_for(upload(tool, (circle,), PlanType.FENCE)) is PlanResult.ACCEPTED
    tool.card.until(lambda: bool(tool.card.last("motion/geofence").areas), 2.0, "the fence is in force")
    tool.card.wait(1.0)
    return tool.card.mission.digest


def requests_since(flight: Card, count: int) -> list[str]:
    """What was requested of the command interface server after the first `count` requests, but queries."""
    bodies = (one.payload.body for one in flight.received["ci/request"][count:])
    return [type(body).__name__ for body in bodies if isinstance(body, LoadMission | Steer)]


def test_clearing_all_plans_clears_the_mission_and_its_fence(flight: Card) -> None:
    tool = begun(flight)
    assert fenced(tool)
    before = len(flight.received["ci/request"])
    assert tool.wait_for(tool.missions.clear(COMPANION, now_s=tool.now_s)) is PlanResult.ACCEPTED
    flight.wait(3.0)
    assert flight.mission.digest == "", "no mission is loaded"
    assert requests_since(flight, before) == ["Steer"], "nor was one loaded meanwhile"
    for kind in (PlanType.MISSION, PlanType.FENCE):
        assert tool.wait_for(read := tool.missions.download(COMPANION, kind=kind, now_s=tool.now_s)) is not None
        assert not read.items
    assert tool.command(START) is CommandResult.DENIED


def test_mission_and_fence_that_are_cleared_or_sent_at_once_are_decided_one_after_the_other(flight: Card) -> None:
    tool = begun(flight)
    fenced(tool)
    before = len(flight.received["ci/request"])
    for kind in (PlanType.MISSION, PlanType.FENCE):
        tool.send("MISSION_CLEAR_ALL", mission_type=kind)
    flight.wait(3.0)
    assert flight.mission.digest == "", "no mission is loaded"
    assert requests_since(flight, before) == ["Steer"]

    digest = fenced(tool)
    before = len(flight.received["ci/request"])
    tool.send("MISSION_CLEAR_ALL", mission_type=PlanType.FENCE)
    assert tool.wait_for(upload(tool, HOP)) is PlanResult.ACCEPTED
    flight.wait(3.0)
    assert requests_since(flight, before) == ["LoadMission", "LoadMission"]
    assert flight.mission.digest not in ("", digest)
    assert not flight.last("motion/geofence").areas, "the mission that was sent last has no fence either"


def test_a_mission_that_cannot_be_cleared_keeps_its_fence(flight: Card) -> None:
    tool = begun(flight)
    digest = fenced(tool)
    assert Tool(flight, system=249).command(REQUEST_CONTROL, 1.0) is CommandResult.FAILED, "the holder is asked"
    before = len(flight.received["ci/request"])
    tool.send("COMMAND_LONG", command=REQUEST_CONTROL, param1=1.0, param2=1.0)
    cleared = tool.missions.clear(COMPANION, now_s=tool.now_s)
    assert tool.wait_for(cleared) is PlanResult.DENIED, "control was granted in the same moment"
    flight.wait(1.0)
    assert requests_since(flight, before) == ["Steer"], "the mission is not loaded again without its fence"
    assert flight.mission.digest == digest
    assert flight.last("motion/geofence").areas
    fence = tool.missions.download(COMPANION, kind=PlanType.FENCE, now_s=tool.now_s)
    assert tool.wait_for(fence) is PlanResult.ACCEPTED
    assert [one.command for one in fence.items] == [5003], "as stations are told"


def test_a_plan_that_cannot_be_flown_is_refused_by_what_is_wrong_and_the_one_before_stays(flight: Card) -> None:
    tool = begun(flight)
    before = flight.mission.digest
    for wrong, expected in (
        (item(16, frame=1), PlanResult.UNSUPPORTED_FRAME),
        (item(82), PlanResult.UNSUPPORTED),
        (item(16, param1=float("inf")), PlanResult.INVALID_PARAM1),
        (item(16, x=910_000_000), PlanResult.INVALID_PARAM5_X),
        (item(16, y=1_810_000_000), PlanResult.INVALID_PARAM6_Y),
        (item(16, height_m=float("nan")), PlanResult.INVALID_PARAM7_Z),
        (item(93, frame=2, param1=-1.0), PlanResult.INVALID),
        (item(16, height_m=500.0), PlanResult.INVALID),
    ):
        count = flight.flight.process.vehicle.companion.reasons.reported
        assert tool.wait_for(upload(tool, (HOP[0], wrong, HOP[3]))) is expected
        flight.wait(0.2)
        assert flight.mission.digest == before
        assert flight.flight.process.vehicle.companion.reasons.reported > count


def test_control_is_told_asked_for_and_handed_over(flight: Card) -> None:
    first = begun(flight)
    second = Tool(flight, system=249)
    flight.wait(1.2)
    assert (first.reported("CONTROL_STATUS")[-1].gcs_main, first.reported("CONTROL_STATUS")[-1].flags) == (0, 2)
    assert first.command(REQUEST_CONTROL, 1.0, 0.0, 10.0, 250.0) is CommandResult.ACCEPTED
    flight.wait(1.1)
    assert (second.reported("CONTROL_STATUS")[-1].gcs_main, second.reported("CONTROL_STATUS")[-1].flags) == (250, 0)
    assert second.command(REQUEST_CONTROL, 1.0, 0.0, 10.0, 250.0) is CommandResult.DENIED, "not for somebody else"
    assert second.command(REQUEST_CONTROL, 0.0) is CommandResult.NOT_IN_CONTROL
    assert second.command(REQUEST_CONTROL, 1.0, 0.0, 10.0, 249.0) is CommandResult.FAILED, "the holder is asked"
    (requested,) = first.reported("COMMAND_LONG")
    assert (requested.command, requested.param1, requested.param4) == (REQUEST_CONTROL, 1.0, 249.0)
    third = Tool(flight, system=248)
    assert third.command(REQUEST_CONTROL, 1.0) is CommandResult.DENIED
    assert first.command(REQUEST_CONTROL, 1.0, 1.0, 10.0, 250.0) is CommandResult.ACCEPTED, "lets it go"
    flight.until(lambda: flight.last("ci/control").holder == "249", 1.0, "handed over")
    assert second.command(REQUEST_CONTROL, 1.0, 1.0) is CommandResult.ACCEPTED, "lets everybody take over from it"
    assert first.command(512, 512.0) is CommandResult.ACCEPTED
    assert first.reported("CONTROL_STATUS")[-1].flags == 2
    flight.wait(0.5)  # the same command right after its answer would be a repeat
    assert third.command(REQUEST_CONTROL, 1.0) is CommandResult.ACCEPTED
    flight.until(lambda: flight.last("ci/control").holder == "248", 1.0, "taken over")
    assert second.command(REQUEST_CONTROL, 1.0) is CommandResult.FAILED, "the new holder does not"
    assert third.command(REQUEST_CONTROL, 0.0) is CommandResult.ACCEPTED
    flight.until(lambda: flight.last("ci/control").holder == "249", 1.0, "whoever has asked gets it")
    assert second.command(REQUEST_CONTROL, 0.0) is CommandResult.ACCEPTED
    flight.until(lambda: flight.last("ci/control").holder == "", 1.0, "released")


def test_our_own_station_gets_control_from_one_of_others_that_grants_it(flight: Card) -> None:
    tool = begun(flight)
    assert tool.wait_for(upload(tool, HOP)) is PlanResult.ACCEPTED, "which gives it control"
    assert "asked" in flight.request(Control(verb=ControlVerb.REQUEST)).reason
    flight.until(lambda: bool(tool.reported("COMMAND_LONG")), 1.0, "the holder is told")
    assert tool.reported("COMMAND_LONG")[0].param4 == 255.0
    assert tool.command(REQUEST_CONTROL, 1.0, 1.0) is CommandResult.ACCEPTED
    flight.until(lambda: flight.last("ci/control").holder == "255", 1.0, "granted")


def test_over_a_bad_radio_everything_arrives_once(flight: Card) -> None:
    begun(flight)
    radio = Conditions(latency_s=0.15, loss=0.1, duplicate=0.02, bandwidth_bit_s=57_600, bits_per_byte=10)
    tool = Tool(flight, system=251, conditions=radio)
    plan = (HOP[0], *(item(16, north / 10.0) for north in range(40)), HOP[3])
    fetch, uploading = tool.parameters.fetch(COMPANION, now_s=tool.now_s), upload(tool, plan)
    assert tool.wait_for(uploading) is PlanResult.ACCEPTED
    assert tool.wait_for(fetch) is ParameterResult.DONE
    assert set(fetch.parameters) == set(flight.flight.process.vehicle.companion.parameters._rows)
    assert tool.wait_for(read := tool.missions.download(COMPANION, now_s=tool.now_s)) is PlanResult.ACCEPTED
    assert len(read.items) == len(plan)
    # the last word after one of progress may be lost, and is not asked for again
    assert tool.command(START) in (CommandResult.ACCEPTED, CommandResult.NO_ANSWER)
    steered = [one.payload.body.verb for one in flight.received["ci/request"] if isinstance(one.payload.body, Steer)]
    assert steered == [Verb.START]
    loaded = [one for one in flight.received["ci/request"] if isinstance(one.payload.body, LoadMission)]
    assert len(loaded) == 2, "one of our own station, one of this"


def test_after_the_onboard_process_has_come_up_again_the_plan_is_there(flight: Card) -> None:
    tool = begun(flight)
    assert tool.wait_for(upload(tool, HOP)) is PlanResult.ACCEPTED
    flight.flight.process.kill()
    flight.wait(1.0)
    flight.run(restart(flight))
    again = Tool(flight)
    flight.until(lambda: bool(flight.since(0.0, "ci/mission")), 15.0, "the kept mission is taken up")
    assert flight.last("ci/mission").digest
    flight.wait(0.5)
    assert again.wait_for(read := again.missions.download(COMPANION, now_s=again.now_s)) is PlanResult.ACCEPTED
    assert [one.command for one in read.items] == [22, 178, 16, 16, 21]
    assert again.command(START) is CommandResult.ACCEPTED


async def restart(flight: Card) -> None:
    flight.received.pop("ci/mission")
    flight.flight.process.start()


def test_strangers_by_the_thousand_change_nothing_and_leave_nothing_behind(flight: Card) -> None:
    tool = begun(flight)
    assert tool.wait_for(upload(tool, HOP)) is PlanResult.ACCEPTED
    digest = flight.mission.digest
    companion = flight.flight.process.vehicle.companion
    requests = len(flight.received["ci/request"])
    stranger = Tool(flight, system=200)
    encoders = stranger.as_strangers(2000)
    for encode in encoders:
        encode("COMMAND_LONG", command=START)
        encode("COMMAND_LONG", command=REQUEST_CONTROL, param1=0.0)
        encode("MISSION_COUNT", count=3)
        encode("MISSION_CLEAR_ALL", mission_type=255)
        encode("PARAM_SET", param_id="HEIGHT_MAX_M", param_value=0x41200000, param_type=9)
        encode("MISSION_REQUEST_LIST")
    flight.wait(12.0)
    assert flight.mission.digest == digest
    assert flight.state("mission") == "waiting"
    assert flight.last("ci/control").holder == "250"
    requested = [one.payload for one in flight.received["ci/request"][requests:]]
    assert not [one for one in requested if isinstance(one, CiRequest) and one.sender != "255"], (
        "none reached the journal"
    )
    assert companion.commands.refused >= 4000
    assert companion.plans.refused >= 4000
    assert companion.parameters.refused >= 2000
    assert len(companion._peers) <= 64
    assert len(companion.commands.server._known) <= 128
    assert len(companion.plans.server._readers) <= 16
    assert not companion.plans.server._uploads
    assert len(reasons(flight)) < 60, "a flood of requests is no flood of texts"
    assert any("more refusals" in text for text in reasons(flight))
    assert tool.command(START) is CommandResult.ACCEPTED, "whoever holds control is served as before"


def test_who_claims_to_be_the_autopilot_on_a_station_link_gets_none_of_its_commands(flight: Card) -> None:
    flight.begin(GEO_HOP, is_started=False)
    vehicle, ends, received = flight.flight.process.vehicle, list[MemoryEnd](), ([], [])  # type: ignore[var-annotated]
    for number, frames in enumerate(received):
        wire, parser = MemoryLink(flight.flight.loop, Random(number)), Parser(is_datagram=True)
        link = vehicle.attach_station(f"udpin://127.0.0.1:{15_000 + number}")
        wire.b.on_data = link.receive
        link.open(wire.b)
        wire.a.on_data = lambda data, frames=frames, parser=parser: frames.extend(parser.receive(data))
        ends.append(wire.a)
    station, forger = Encoder(251, 190), Encoder(1, 1)
    ends[0].send(station.encode(message("HEARTBEAT", type=6)))
    for boot_ms in (900_000, 10):
        ends[1].send(forger.encode(message("SYSTEM_TIME", time_boot_ms=boot_ms)))
    flight.wait(0.1)
    ends[0].send(station.encode(message("COMMAND_LONG", target_system=1, target_component=1, command=512, param1=148)))
    flight.wait(0.5)
    assert "COMMAND_ACK" in names(received[0])
    assert "COMMAND_LONG" not in names(received[1])
    refused = vehicle.link_conditions()[-1].traffic.refused
    assert list(refused.values()) == [2]


def names(frames: list[Frame]) -> list[str]:
    return [frame.shape.name for frame in frames if frame.shape is not None]
