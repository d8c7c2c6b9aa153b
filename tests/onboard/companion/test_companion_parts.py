"""Parts of the services for others: names of parameters, items of plans, reasons that are not too many."""

import asyncio
import math
from random import Random
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gloc3.camera.model import CameraModel
from gloc3.clock import Clock, VirtualLoop
from gloc3.component.context import HostContext
from gloc3.errors import InputError
from gloc3.exchange import LocalExchange, Publisher
from gloc3.mavlink import codec
from gloc3.mavlink.codec import MavlinkMessage
from gloc3.mavlink.message import Address, Field
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.plan import PlanItem, PlanResult
from gloc3.messages.frames import GeoPoint
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import GimbalState
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.formats import to_mission
from gloc3.mission.formats.items import FenceArea
from gloc3.mission.formats.items import ForeignPlan as PlanFile
from gloc3.mission.formats.to_mission import CONVERTED, LEFT_OUT
from gloc3.network.rights import Rights
from gloc3.platform.reader import load_platform
from gloc3_onboard.companion.cameras import CameraEntry, cameras_of
from gloc3_onboard.companion.companion import MOST, PERIOD_S, Companion, Reasons
from gloc3_onboard.companion.files import MemoryFiles
from gloc3_onboard.companion.parameter_table import CompanionParameter, exact, rows_of, short_name
from gloc3_onboard.companion.plans import Verdict, fence_of, items_of, judge, plan_of

CIRCUMSTANCES: dict[str, Any] = {
    "platform": load_platform("pelican_rtk"),
    "origin": GeoPoint(39.5528, 2.6285, 2.0),
    "home_altitude_m": 2.0,
    "home_ned_m": (0.0, 0.0, 0.0),
    "start_ned_m": None,
}
COMPANION = Address(1, 191)
SQUARE = ((47.0, 8.0), (47.1, 8.0), (47.1, 8.1), (47.0, 8.1))


def fence_item(command: int, place: tuple[float, float] = (47.0, 8.0), **fields: Any) -> PlanItem:
    return PlanItem(command=command, x=round(place[0] * 1e7), y=round(place[1] * 1e7), **fields)


@pytest.mark.parametrize("name", ["pelican", "pelican_rtk", "hummingbird"])
def test_every_platform_has_parameters_with_names_of_their_own_that_fit(name: str) -> None:
    rows = rows_of(load_platform(name).components)
    names = [row.name for row in rows]
    assert len(set(names)) == len(names) > 50
    assert max(map(len, names)) <= 16
    assert all(row.problem(row.value) == "" for row in rows), "what is set now is in its bounds"
    assert not [row.setting for row in rows if row.setting and not row.text], "each says what it is"


@given(st.lists(st.from_regex(r"[a-z][a-z0-9_]{0,40}", fullmatch=True), max_size=40))
def test_short_names_fit_and_are_all_different(full: list[str]) -> None:
    used: set[str] = set()
    names = [short_name(one, used) for one in full]
    assert len(set(names)) == len(names)
    assert all(0 < len(name) <= 16 for name in names)


def test_a_short_name_is_like_the_long_one_and_a_short_one_is_kept() -> None:
    used: set[str] = set()
    assert short_name("height_max_m", used) == "HEIGHT_MAX_M"
    assert short_name("waypoints_return_speed_m_s", used) == "WPN_RTR_SPED_M_S"
    assert short_name("height_max_m", used) == "HEIGHT_MAX_M2"


def test_bounds_and_whole_numbers_are_kept_and_floats_are_as_they_were_written() -> None:
    row = CompanionParameter(name="A", component="", setting="a_m_s", value=1.0, low=0.0, high=7.0, is_whole=True)
    assert (row.unit, row.problem(7.0), row.problem(1.5)) == ("m/s", "", "A must be a whole number, not 1.5")
    assert row.problem(8.0) == "A must be from 0 to 7, not 8"
    assert exact(0.10000000149011612) == 0.1


def test_a_fence_is_the_same_after_the_wire() -> None:
    areas = (
        FenceArea(is_inclusion=True, polygon=SQUARE),
        FenceArea(is_inclusion=False, polygon=SQUARE[:3]),
        FenceArea(is_inclusion=False, polygon=SQUARE[1:]),
        FenceArea(is_inclusion=True, center=(47.0, 8.0), radius_m=50.0),
    )
    assert fence_of(items_of(PlanFile(entries=(), fence=areas).fence_items())) == areas
    assert fence_of((fence_item(5000), fence_item(5003, param1=5.0))) == (
        FenceArea(is_inclusion=True, center=(47.0, 8.0), radius_m=5.0),
    )


@pytest.mark.parametrize(
    ("items", "result"),
    [
        ((fence_item(5003),), PlanResult.INVALID_PARAM1),
        ((fence_item(5003, param1=math.nan),), PlanResult.INVALID_PARAM1),
        ((fence_item(5001, param1=2.0),) * 2, PlanResult.INVALID_PARAM1),
        ((fence_item(5001, param1=3.0),) * 2, PlanResult.INVALID),
        ((fence_item(5001, param1=3.0), fence_item(5002, param1=3.0)), PlanResult.INVALID),
        ((fence_item(5003, param1=3.0, frame=1),), PlanResult.UNSUPPORTED_FRAME),
        ((fence_item(16),), PlanResult.UNSUPPORTED),
    ],
)
def test_a_fence_that_is_none_is_refused_by_what_is_wrong(items: tuple[PlanItem, ...], result: PlanResult) -> None:
    found = fence_of(items)
    assert isinstance(found, Verdict)
    assert (found.result, found.reason.startswith("item ")) == (result, True)


@given(st.lists(st.builds(PlanItem, command=st.integers(0, 65535), frame=st.integers(0, 255), param1=st.floats())))
def test_whatever_comes_is_judged_and_nothing_raises(items: list[PlanItem]) -> None:
    for found in (judge(tuple(items)), fence_of(tuple(items))):
        assert found is None or not isinstance(found, Verdict) or found.result is not PlanResult.ACCEPTED


numbers = st.one_of(st.floats(width=32), st.floats(-100.0, 100.0, width=32))
known_items = st.builds(
    PlanItem,
    command=st.sampled_from(sorted({*CONVERTED, *LEFT_OUT})),
    frame=st.sampled_from([0, 2, 3, 5, 6, 10, 11]),
    param1=numbers,
    param2=numbers,
    param3=numbers,
    param4=numbers,
    x=st.one_of(st.integers(395_528_000, 395_529_000), st.integers(-(2**31), 2**31 - 1)),
    y=st.one_of(st.integers(26_285_000, 26_286_000), st.integers(-(2**31), 2**31 - 1)),
    z=numbers,
)


@given(st.lists(known_items, max_size=12))
def test_a_plan_whose_items_can_be_flown_each_becomes_a_mission_or_is_refused_as_a_whole(items: list[PlanItem]) -> None:
    if judge(tuple(items)) is not None:
        return
    try:
        text, _ = to_mission(plan_of(tuple(items), ()), "plan", "plan", CIRCUMSTANCES["platform"])
    except InputError:
        return
    read = check_text(text, "plan", Circumstances(**CIRCUMSTANCES))
    assert read.is_ok or read.findings


def any_field(chance: Random, field: Field) -> Any:
    """A value that the wire can hold."""
    if field.type == "char":
        return "".join(chance.choices("ABC_\u00e9/.", k=chance.randrange(field.elements // 2)))
    if field.elements:
        return chance.randbytes(field.elements)
    if field.type == "float":
        return chance.choice([0.0, 1.0, math.nan, math.inf, -1.0, 1e30, 148.0, 512.0])
    bits = 8 * {"8": 1, "1": 2, "3": 4, "6": 8}[field.type.lstrip("uint")[0]]
    low = 0 if field.type.startswith("u") else -(2 ** (bits - 1))
    return chance.choice([low, 0, 1, 3, low + 2**bits - 1, chance.randrange(low, low + 2**bits)])


@pytest.mark.thorough
def test_whatever_is_sent_to_it_nothing_raises_and_it_still_answers() -> None:
    loop = VirtualLoop()
    companion = Companion(
        COMPANION,
        load_platform("pelican_rtk"),
        HostContext("pelican_rtk", LocalExchange(), Clock(loop), loop, TopicTable(), Random(1)),
        Rights("pelican_rtk"),
    )
    companion.share(MemoryFiles({"file": b"content"}))
    companion.add_cameras([CameraEntry(100, "ground", "record_images")], "pelican_rtk", LocalExchange())
    sent: list[MavlinkMessage] = []
    receive, parser, chance = companion.attach(lambda message, _: sent.append(message)), codec.Parser(), Random(1)
    shapes = [shape for number in sorted(companion._wanted) if (shape := codec.shape(codec.name_of(number)))]
    encoders = [codec.Encoder(system, 190) for system in (255, 254, 1)]
    commands = [17, 20, 21, 193, 224, 300, 400, 510, 511, 512, 520, 530, 2000, 2001, 2002, 31010, 32100, 60000]
    for _ in range(4000):
        shape = chance.choice(shapes)
        fields = {field.attribute: any_field(chance, field) for field in shape.fields}
        target = {"target_system": 1, "target_component": chance.choice([191, 191, 100])}
        fields |= target if "target_system" in fields else {}
        fields |= {"command": chance.choice(commands)} if "command" in fields else {}
        receive(parser.receive(chance.choice(encoders).encode(codec.message(shape.name, **fields))))
        loop.run_until_complete(asyncio.sleep(chance.choice([0.0, 0.01, 0.3])))
    assert loop.failures == []
    sent.clear()
    requested = codec.message("COMMAND_LONG", target_system=1, target_component=191, command=512, param1=148.0)
    receive(parser.receive(codec.Encoder(253, 190).encode(requested)))
    assert {"COMMAND_ACK", "AUTOPILOT_VERSION"} <= {reported.name for reported in sent}
    companion.close()
    loop.close()


STREAM = "rtsp://192.168.1.20:554/stream"


def test_cameras_are_those_that_can_be_recorded_and_a_network_camera_has_a_stream() -> None:
    pelican = load_platform("pelican")
    models = {"ground": CameraModel(width=640, height=480, focal_px=(400.0, 400.0), center_px=(320.0, 240.0))}
    found = cameras_of(pelican, models.get, {"ground_camera": f"{STREAM}?delay_s=0.1", "stereo_camera": "none://"})
    assert [(one.component, one.name, one.stream_url) for one in found] == [
        (100, "ground", STREAM),
        (101, "front_left", ""),
        (102, "front_right", ""),
    ]
    assert found[0].model is models["ground"]
    few = msgspec.structs.replace(pelican, first_camera_component=104)
    assert [one.component for one in cameras_of(few, models.get, {})] == [104, 105]
    assert cameras_of(msgspec.structs.replace(pelican, first_camera_component=0), models.get, {}) == []


def test_a_camera_with_a_stream_says_where_it_is() -> None:
    loop, exchange = VirtualLoop(), LocalExchange()
    context = HostContext("pelican", exchange, Clock(loop), loop, TopicTable(), Random(1))
    companion = Companion(COMPANION, load_platform("pelican"), context, Rights("pelican"))
    assert companion.add_cameras([CameraEntry(101, "mast", "record_images", None, STREAM)], "pelican", exchange) == [
        Address(1, 101)
    ]
    sent: list[tuple[int, MavlinkMessage]] = []
    receive = companion.attach(lambda message, component: sent.append((component, message)))
    for number in (259.0, 269.0, 270.0):
        wanted = codec.message("COMMAND_LONG", target_system=1, target_component=101, command=512, param1=number)
        receive(codec.Parser().receive(codec.Encoder(255, 190).encode(wanted)))
        loop.run_until_complete(asyncio.sleep(0.1))
    found = {message.name: message for component, message in sent if component == 101}
    assert found["CAMERA_INFORMATION"].flags == 2 | 256
    stream = found["VIDEO_STREAM_INFORMATION"]
    assert (stream.stream_id, stream.count, stream.type, stream.uri) == (1, 1, 0, STREAM)
    assert found["VIDEO_STREAM_STATUS"].flags == 1
    companion.close()
    loop.close()


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("COMMAND_LONG", {"target_component": 100, "command": 512, "param1": 263.0, "param2": math.nan}),
        ("COMMAND_LONG", {"target_component": 100, "command": 2002, "param1": math.inf}),
        ("COMMAND_LONG", {"target_component": 100, "command": 2000, "param2": 1.0, "param3": math.inf}),
        ("COMMAND_LONG", {"target_component": 100, "command": 2000, "param2": 1.0, "param3": 1e30}),
        ("COMMAND_LONG", {"target_component": 100, "command": 2000, "param2": math.inf, "param3": 2.0}),
        ("COMMAND_INT", {"target_component": 191, "command": 1000, "frame": 2, "x": 0x7FFF_FFFF}),
    ],
)
def test_a_command_with_a_value_that_is_not_set_is_refused_and_the_next_one_is_answered(
    name: str, fields: dict[str, Any]
) -> None:
    loop, exchange = VirtualLoop(), LocalExchange()
    context = HostContext("pelican", exchange, Clock(loop), loop, TopicTable(), Random(1))
    companion = Companion(COMPANION, load_platform("pelican"), context, Rights("pelican"))
    companion.add_cameras([CameraEntry(100, "ground", "record_images")], "pelican", exchange)
    companion.add_gimbal("pelican", exchange, 1)
    gimbal = GimbalState(device=154, owner_system=255, owner_component=190)
    Publisher(exchange, "pelican", "gimbal", 1).publish("pelican/gimbal", gimbal, 0.0)
    acks: list[int] = []
    receive = companion.attach(
        lambda message, _: acks.append(message.result) if message.name == "COMMAND_ACK" else None
    )
    for sender in (254, 253):
        command = codec.Encoder(sender, 190).encode(codec.message(name, target_system=1, **fields))
        receive(codec.Parser().receive(command))
        loop.run_until_complete(asyncio.sleep(0.1))
    assert acks == [CommandResult.DENIED, CommandResult.DENIED]
    companion.close()
    loop.close()


def test_of_many_reasons_some_are_told_and_the_rest_is_counted() -> None:
    reported: list[str] = []
    reasons = Reasons(reported.append)
    for number in range(MOST + 5):
        reasons.report(str(number))
    assert reported == [str(number) for number in range(MOST)]
    reasons.tick(PERIOD_S - 0.1)
    reasons.tick(PERIOD_S)
    assert reported[MOST:] == ["and 5 more refusals"]
    assert reasons.next_tick_s() is None
    reasons.report("again")
    assert reported[-1] == "again"
    assert reasons.reported == MOST + 6
