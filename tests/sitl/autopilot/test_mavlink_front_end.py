"""The MAVLink front end: streams, requests, commands, routing, and what each style says of itself."""

from collections import Counter
from math import inf, nan

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gloc3.mavlink.codec import Encoder, Parser, message, shape
from gloc3_sitl.autopilot.mavlink.commands import HANDLERS
from gloc3_sitl.autopilot.mavlink.links import LinkKind
from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.autopilot.surroundings import SupplyState
from gloc3_sitl.autopilot.verdict import Author
from gloc3_sitl.vehicles.simulator import BOOT_S, Simulator, SimulatorSettings
from gloc3_sitl.world import World

from .bench import ARM, REPOSITION, SET_MODE, Bench

pytestmark = pytest.mark.thorough

GET_INTERVAL, SET_INTERVAL, REQUEST = 510, 511, 512
STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])
PREARM = 0x10000000
NOT_THERE = ("FENCE_STATUS", "OPEN_DRONE_ID_ARM_STATUS", "ORBIT_EXECUTION_STATUS", "WHEEL_DISTANCE")
"""Messages of what the simulated vehicle does not have, or has switched off."""


class Ear:
    """Somebody on a link of his own."""

    def __init__(self, sim: Simulator, kind: LinkKind, system: int, component: int) -> None:
        self.counts: Counter[str] = Counter()
        self.senders: Counter[tuple[int, int]] = Counter()
        self.results: list[Result] = []
        self._parser = Parser(is_datagram=True)
        self._encoder = Encoder(system, component)
        self._receive = sim.attach(self._handle, kind)

    def _handle(self, data: bytes) -> None:
        for frame in self._parser.receive(data):
            self.senders[frame.sender] += 1
            if frame.shape is not None:
                self.counts[frame.shape.name] += 1
                if frame.shape.name == "COMMAND_ACK" and (ack := frame.decode()) is not None:
                    self.results.append(Result(ack.result))

    def report(self, name: str, **fields: object) -> None:
        self._receive(self._encoder.encode(message(name, **fields)))


def test_a_companions_link_begins_with_pose_at_25_hertz_in_px4_style() -> None:
    sim = Simulator(World.load("open"), SimulatorSettings(seed=1))
    ear = Ear(sim, LinkKind.COMPANION, 1, 191)
    sim.advance(4.0)
    ear.counts.clear()
    sim.advance(6.0)
    assert ear.counts["HEARTBEAT"] == 2
    assert ear.counts["LOCAL_POSITION_NED"] == pytest.approx(50, abs=2)
    assert ear.counts["ATTITUDE_QUATERNION"] == pytest.approx(50, abs=2)
    assert ear.counts["DISTANCE_SENSOR"] == pytest.approx(20, abs=2)


@pytest.mark.parametrize(("style", "count"), [("px4", 2), ("ardupilot", 12)])
def test_px4_lets_nobody_change_the_rate_of_its_heartbeat(style: str, count: int) -> None:
    bench = Bench(style)
    bench.run(1.0)
    assert bench.command(SET_INTERVAL, 0, 200_000) is (Result.DENIED if style == "px4" else Result.ACCEPTED)
    bench.counts.clear()
    bench.run(2.0)
    assert bench.counts["HEARTBEAT"] == pytest.approx(count, abs=1)


def test_ardupilot_is_silent_until_it_is_asked() -> None:
    bench = Bench("ardupilot")
    bench.run(3.0)
    assert set(bench.counts) <= {"HEARTBEAT", "STATUSTEXT", "HOME_POSITION", "GPS_GLOBAL_ORIGIN"}
    bench.send(
        "REQUEST_DATA_STREAM", target_system=1, target_component=1, req_stream_id=6, req_message_rate=5, start_stop=1
    )
    bench.run(2.0)
    assert bench.counts["GLOBAL_POSITION_INT"] == pytest.approx(10, abs=1)
    assert bench.counts["ATTITUDE"] == 0


def test_ardupilots_stream_parameters_change_every_link() -> None:
    bench = Bench("ardupilot")
    bench.run(3.0)
    bench.set_parameter("MAV1_EXTRA1", 10)
    bench.run(2.0)
    assert bench.counts["ATTITUDE"] == pytest.approx(20, abs=1)


def test_an_interval_can_be_set_asked_for_and_stopped() -> None:
    bench = Bench()
    bench.run(3.0)
    number = shape("ATTITUDE").id
    assert bench.command(SET_INTERVAL, number, 20_000) is Result.ACCEPTED
    bench.run(1.0)
    assert bench.counts["ATTITUDE"] == pytest.approx(50, abs=2)
    assert bench.command(GET_INTERVAL, number) is Result.ACCEPTED
    assert bench.last("MESSAGE_INTERVAL").interval_us == 20_000
    assert bench.command(SET_INTERVAL, number, -1) is Result.ACCEPTED
    before = bench.counts["ATTITUDE"]
    bench.run(1.0)
    assert bench.counts["ATTITUDE"] == before


def test_px4_refuses_another_rate_for_its_current_mission_item_and_goes_on_at_its_own() -> None:
    sim = Simulator(World.load("open"), SimulatorSettings(seed=1))
    ear = Ear(sim, LinkKind.COMPANION, 1, 191)
    ear.report("HEARTBEAT", type=18, autopilot=8)
    sim.advance(1.0)
    number = shape("MISSION_CURRENT").id
    ear.report("COMMAND_LONG", target_system=1, target_component=1, command=SET_INTERVAL, param1=number, param2=500_000)
    assert ear.results[-1] is Result.FAILED
    ear.counts.clear()
    sim.advance(5.0)
    assert ear.counts["MISSION_CURRENT"] == pytest.approx(5, abs=1)


def test_px4_sends_its_origin_when_it_changes_and_on_request_and_never_at_an_interval() -> None:
    sim = Simulator(World.load("open"), SimulatorSettings(seed=1))
    early = Ear(sim, LinkKind.COMPANION, 1, 191)
    sim.advance(5.0)
    assert early.counts["GPS_GLOBAL_ORIGIN"] == 1
    late = Ear(sim, LinkKind.COMPANION, 1, 192)
    number = shape("GPS_GLOBAL_ORIGIN").id
    late.report(
        "COMMAND_LONG", target_system=1, target_component=1, command=SET_INTERVAL, param1=number, param2=500_000
    )
    assert late.results[-1] is Result.ACCEPTED
    sim.advance(9.0)
    assert late.counts["GPS_GLOBAL_ORIGIN"] == 0
    late.report("COMMAND_LONG", target_system=1, target_component=1, command=REQUEST, param1=number)
    assert late.counts["GPS_GLOBAL_ORIGIN"] == 1


@pytest.mark.flight
@STYLES
def test_every_message_that_can_be_told_is_told_on_request(style: str) -> None:
    bench = Bench(style)
    bench.take_off()
    for name in bench.sim.front.context.producers:
        bench.pilot.switch_on()
        bench.command(REQUEST, shape(name).id)
        if name not in NOT_THERE:
            assert bench.counts[name] >= 1, name
    assert bench.command(REQUEST, shape("AUTOPILOT_VERSION").id) is Result.ACCEPTED
    assert bench.last("AUTOPILOT_VERSION").capabilities & 0x2000
    assert bench.command(REQUEST, shape("CAMERA_INFORMATION").id) is not Result.ACCEPTED


@STYLES
def test_the_heartbeat_tells_style_mode_and_arming(style: str) -> None:
    bench = Bench(style)
    bench.get_ready()
    heartbeat = bench.last("HEARTBEAT")
    assert (heartbeat.type, heartbeat.autopilot) == (2, 12 if style == "px4" else 3)
    assert not heartbeat.base_mode & 128
    bench.set_mode("Position" if style == "px4" else "GUIDED")
    bench.command(ARM, 1)
    bench.run(0.1)
    heartbeat = bench.last("HEARTBEAT")
    assert heartbeat.custom_mode == (3 << 16 if style == "px4" else 4)
    assert heartbeat.base_mode & 128
    assert heartbeat.system_status == 4


def test_the_prearm_bit_follows_readiness() -> None:
    bench = Bench()
    bench.run(0.5)
    bench.command(REQUEST, 1)
    assert not bench.last("SYS_STATUS").onboard_control_sensors_health & PREARM
    bench.get_ready()
    bench.command(REQUEST, 1)
    assert bench.last("SYS_STATUS").onboard_control_sensors_health & PREARM


def test_a_local_position_is_told_only_while_there_is_one() -> None:
    bench = Bench()
    bench.run(0.5)
    assert bench.command(REQUEST, 32) is Result.TEMPORARILY_REJECTED
    bench.get_ready()
    assert bench.command(REQUEST, 32) is Result.ACCEPTED


@STYLES
def test_commands_that_nobody_knows_are_unsupported(style: str) -> None:
    bench = Bench(style)
    assert bench.command(31010) is Result.UNSUPPORTED


@STYLES
def test_modes_that_do_not_exist_are_refused(style: str) -> None:
    bench = Bench(style)
    bench.get_ready()
    before = bench.mode
    assert bench.command(SET_MODE, 1, 99, 0) is not Result.ACCEPTED
    assert bench.mode == before


@pytest.mark.flight
def test_a_place_is_gone_to_by_command_int_in_both_styles() -> None:
    for style in ("px4", "ardupilot"):
        bench = Bench(style)
        bench.take_off()
        goal = bench.item(16, 6.0, -3.0, 4.0)
        altitude = bench.sim.world.home.altitude_m + 4.0
        wanted = {"frame": 0, "x": goal.x, "y": goal.y, "z": altitude}
        assert bench.command(REPOSITION, -1, 1, 0, nan, as_int=wanted) is Result.ACCEPTED
        bench.run(9.0)
        north, east, down = bench.position
        assert (north, east, down) == pytest.approx((6.0, -3.0, -4.0), abs=0.3)


def test_ardupilot_calibrates_its_gyro_in_progress_and_then_done() -> None:
    bench = Bench("ardupilot")
    bench.get_ready()
    assert bench.command(241, 1) is Result.IN_PROGRESS
    bench.run(1.2)
    assert bench.last("COMMAND_ACK").result == 0


# -- several links ------------------------------------------------------------------------------------------------------


def test_frames_pass_between_links_by_their_addresses() -> None:
    sim = Simulator(World.load("open"), SimulatorSettings(seed=1))
    companion = Ear(sim, LinkKind.BARE, 1, 191)
    station = Ear(sim, LinkKind.BARE, 255, 190)
    other = Ear(sim, LinkKind.BARE, 254, 190)
    for ear in (companion, station, other):
        ear.report("HEARTBEAT", type=18, autopilot=8)
    assert companion.senders[255, 190] == 1
    station.report("COMMAND_LONG", target_system=1, target_component=191, command=31010)
    assert companion.counts["COMMAND_LONG"] == 1
    assert other.counts["COMMAND_LONG"] == 0
    station.report("COMMAND_LONG", target_system=1, target_component=1, command=31010)
    assert companion.counts["COMMAND_LONG"] == 1
    assert station.counts["COMMAND_ACK"] == 1
    assert other.counts["COMMAND_ACK"] == 0


def test_each_link_has_its_own_unbroken_sequence() -> None:
    sim = Simulator(World.load("open"), SimulatorSettings(seed=1))
    sequences: list[int] = []
    parser = Parser(is_datagram=True)

    def receive(data: bytes) -> None:
        sequences.extend(frame.sequence for frame in parser.receive(data))

    sim.attach(receive, LinkKind.GROUND)
    Ear(sim, LinkKind.COMPANION, 1, 191)
    sim.advance(3.0)
    assert sequences == [number % 256 for number in range(len(sequences))]


# -- whatever comes in --------------------------------------------------------------------------------------------------


@settings(max_examples=30)
@given(st.binary(max_size=300))
def test_garbage_is_survived(data: bytes) -> None:
    BARE_BENCH.sim.front.context.router.links[0].parser.receive(data)
    BARE_BENCH._receive(data)


@settings(max_examples=60)
@given(
    st.sampled_from(sorted(HANDLERS)),
    st.lists(st.one_of(st.floats(width=32), st.sampled_from([0.0, 1.0, 2.0, -1.0, nan])), min_size=7, max_size=7),
    st.booleans(),
)
@example(246, [1.0] * 7, False)  # boots anew
@example(246, [2.0] * 7, False)  # goes off for good
@example(17, [0.0] * 7, False)
def test_commands_with_any_numbers_are_answered(command: int, params: list[float], is_int: bool) -> None:
    bench = BARE_BENCH
    bench.run(0.02)
    if bench.sim.is_down:
        bench.sim.switch(SupplyState.REBOOT)
        bench.run(BOOT_S + 0.1)
    if bench.sim.autopilot.commander.is_terminated:
        bench.sim.autopilot.commander.is_terminated = False
    before = bench.counts["COMMAND_ACK"]
    values = {f"param{index}": value for index, value in enumerate(params[:4], start=1)}
    if is_int:
        place = {"frame": 6, "x": 473_977_420, "y": 85_455_940, "z": params[6]}
        bench.send("COMMAND_INT", target_system=1, target_component=1, command=command, **values, **place)
    else:
        rest = {f"param{index}": value for index, value in enumerate(params[4:], start=5)}
        bench.send("COMMAND_LONG", target_system=1, target_component=1, command=command, **values, **rest)
    assert bench.counts["COMMAND_ACK"] > before
    bench.sim.autopilot.commander.disarm(Author.SELF, is_forced=True)


@pytest.mark.parametrize(
    ("command", "params"),
    [
        (192, (0.0, nan, 0.0, 0.0, 0.0, 0.0, 0.0)),
        (192, (0.0, inf, 0.0, 0.0, 0.0, 0.0, 0.0)),
        (511, (32.0, 1e25, 0.0, 0.0, 0.0, 0.0, 0.0)),
        (510, (32.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
        (611, (0.0, 0.0, 0.0, 0.0, 47.0, 8.0, 1e30)),
        (611, (0.0, 0.0, 0.0, 0.0, 4700.0, 8.0, 1e3)),
        (179, (0.0, 0.0, 0.0, 0.0, 47.0, 8.0, 1e30)),
    ],
)
@pytest.mark.parametrize("style", ["px4", "ardupilot"])
def test_numbers_beyond_reason_are_refused_and_the_telemetry_goes_on(
    style: str, command: int, params: tuple[float, ...]
) -> None:
    bench = Bench(style)
    bench.run(1.0)
    values = {f"param{index}": value for index, value in enumerate(params, start=1)}
    bench.send("COMMAND_LONG", target_system=1, target_component=1, command=command, **values)
    acks, beats = bench.counts["COMMAND_ACK"], bench.counts["HEARTBEAT"]
    bench.run(5.0)
    assert acks == 1
    assert bench.counts["HEARTBEAT"] > beats


@settings(max_examples=60)
@given(st.lists(st.floats(width=32), min_size=9, max_size=9), st.integers(0, 65535), st.integers(0, 20))
def test_setpoints_with_any_numbers_leave_finite_throttles(values: list[float], mask: int, frame: int) -> None:
    bench = BARE_BENCH
    names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz")
    bench.send(
        "SET_POSITION_TARGET_LOCAL_NED",
        target_system=1,
        target_component=1,
        coordinate_frame=frame,
        type_mask=mask,
        **dict(zip(names, values, strict=True)),
    )
    bench.run(0.04)
    assert all(0.0 <= throttle <= 1.0 for throttle in bench.sim.autopilot.outputs)


BARE_BENCH = Bench()


@STYLES
def test_what_a_station_on_two_links_asks_for_on_one_comes_on_that_one(style: str) -> None:
    sim = Simulator(World.load("open"), SimulatorSettings(seed=1, style=style))
    first, second = (Ear(sim, LinkKind.BARE, 255, 190) for _ in range(2))
    sim.advance(3.0)
    for ear in (first, second):
        ear.report("HEARTBEAT", type=6, autopilot=8)
    fields = {"target_system": 1, "target_component": 1, "command": SET_INTERVAL}
    second.report("COMMAND_LONG", param1=float(shape("SYSTEM_TIME").id), param2=1e5, **fields)
    first.counts.clear()
    second.counts.clear()
    sim.advance(5.0)
    assert second.results == [Result.ACCEPTED]
    assert second.counts["SYSTEM_TIME"] > 15
    assert first.counts["SYSTEM_TIME"] < 5
