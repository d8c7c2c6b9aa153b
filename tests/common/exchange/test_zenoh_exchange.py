"""The zenoh middleware: late joiners, large messages, what is dropped and where, and bytes from strangers."""

import asyncio
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from tests.common.exchange.middlewares import EVENT, PLATFORM, TABLE, Ends, event, receive, until, zenoh
from zenoh import CongestionControl

from gloc3.exchange import Publisher
from gloc3.exchange.zenoh import ZenohExchange, open_exchange
from gloc3.exchange.zenoh_session import UNIX, ZenohEndpoints, new_session
from gloc3.messages.envelope import Envelope, Event, Severity, Source
from gloc3.messages.summaries import ComponentTable
from gloc3.messages.topics import TopicService, TopicTable
from gloc3.messages.vehicle import Image
from gloc3.messages.wire import type_name

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(60)]
CAMERA = f"{PLATFORM}/camera/front"


@contextmanager
def node(folder: Path, name: str, **entries: Any) -> Iterator[ZenohExchange]:
    """A node of its own, in this process."""
    place = f"{UNIX}/{folder}/z"
    where = {"listen": (place,), "peers": ("one", "other")} if name == "main" else {"connect": (place,)}
    with open_exchange(
        ZenohEndpoints(name=name, **where), asyncio.get_running_loop(), TopicTable.installed(), **entries
    ) as exchange:
        yield exchange


async def test_nodes_that_meet_late_get_the_last_message_of_what_is_once(tmp_path: Path) -> None:
    with node(tmp_path, "one") as one, node(tmp_path, "other") as other:
        tables: list[int] = []
        other.subscribe(f"{PLATFORM}/ci/*", lambda e: tables.append(e.payload.table))
        publisher = Publisher(one, PLATFORM, "ci", 7)
        for number in (1, 2):
            publisher.publish(TABLE, ComponentTable(table=number, rows=[]), 0.25)
        assert not tables
        with node(tmp_path, "main"):
            await until(lambda: tables)
            publisher.publish(TABLE, ComponentTable(table=3, rows=[]), 0.5)
            await until(lambda: tables[-1] == 3)
        await asyncio.sleep(0.3)
        with node(tmp_path, "main") as main:
            seen: list[int] = []
            main.subscribe(TABLE, lambda e: seen.append(e.payload.table))
            await until(lambda: seen)
        assert (tables, seen) == ([2, 3], [3])


@pytest.mark.parametrize("is_before", [True, False], ids=["before the connection", "after it"])
async def test_what_a_vehicle_tells_once_is_replaced_after_its_computer_has_been_started_again(
    is_before: bool, tmp_path: Path
) -> None:
    with node(tmp_path, "other") as station:
        tables: list[int] = []
        here: list[bool] = []
        station.subscribe(f"{PLATFORM}/ci/*", lambda e: tables.append(e.payload.table))
        station.watch("one/here", lambda _, is_alive: here.append(is_alive))
        for life, t_s in ((10, 3600.0), (20, 5.0)):
            with node(tmp_path, "one") as vehicle:
                publisher = Publisher(vehicle, PLATFORM, "ci", life)
                if is_before:
                    publisher.publish(TABLE, ComponentTable(table=life, rows=[]), t_s)
                with node(tmp_path, "main"):
                    vehicle.declare_alive("one/here")
                    await until(lambda: here[-1:] == [True])
                    if not is_before:
                        publisher.publish(TABLE, ComponentTable(table=life, rows=[]), t_s)
                    await until(lambda life=life: tables[-1:] == [life])  # type: ignore[misc]
                    publisher.publish(TABLE, ComponentTable(table=life + 1, rows=[]), t_s + 1.0)
                    await until(lambda life=life: tables[-1:] == [life + 1])  # type: ignore[misc]
            await until(lambda: here[-1:] == [False])
        assert tables == [10, 11, 20, 21]


async def test_of_two_nodes_that_hold_one_the_newer_message_stays_after_a_break(tmp_path: Path) -> None:
    with node(tmp_path, "other") as station, node(tmp_path, "one") as newer, node(tmp_path, "one") as older:
        tables: list[int] = []
        station.subscribe(TABLE, lambda e: tables.append(e.payload.table))
        for source, boot, t_s in ((older, 1, 5.0), (newer, 2, 9.0)):
            Publisher(source, PLATFORM, "ci", boot).publish(TABLE, ComponentTable(table=boot, rows=[]), t_s)
        for _ in range(3):
            with node(tmp_path, "main"):
                await until(lambda: tables[-1:] == [2])
                await asyncio.sleep(0.3)
                assert tables[-1] == 2


async def test_a_picture_arrives_as_it_was_and_what_is_lost_of_many_is_counted(tmp_path: Path) -> None:
    async with zenoh(tmp_path) as ends:
        publisher = Publisher(ends.platform, PLATFORM, "camera", 7)
        picture = Image(camera="front", width=640, height=480, data=bytes(range(256)) * 1200, reason="dark")
        came: list[Envelope[Image]] = []
        ends.station.subscribe(CAMERA, came.append)

        def show(number: int) -> bool:
            publisher.publish(CAMERA, replace(picture, reason=str(number)), 0.25)
            return False

        await until(lambda: came or show(0))
        assert came[0].payload == replace(picture, reason="0")
        assert came[0].type == type_name(Image)
        for number in range(1, 41):
            show(number)
        time.sleep(1.0)  # a loop that is busy with something else
        await asyncio.sleep(0.5)
        show(41)
        await until(lambda: came[-1].payload.reason == "41")
        assert isinstance(ends.station, ZenohExchange)
        missing = came[-1].sequence - came[0].sequence + 1 - len(came)
        problems = ends.station.problems()
        assert problems[f"lost {CAMERA}"] == missing > 0
        assert 0 < problems[f"late {CAMERA}"] <= missing


async def test_a_break_of_many_topics_is_one_report(tmp_path: Path) -> None:
    reported: list[str] = []
    with (
        node(tmp_path, "main", troubled=lambda _, text: reported.append(text)) as main,
        node(tmp_path, "one") as one,
    ):
        seen: list[int] = []
        main.subscribe(f"{PLATFORM}/components/*/event", lambda e: seen.append(e.sequence))

        def send(sequence: int) -> bool:
            for name in ("pose", "limiter", "viewer"):
                topic, text = f"{PLATFORM}/components/{name}/event", Event(severity=Severity.INFO, text="x")
                one.publish(Envelope(topic, Source(PLATFORM, name, 7), sequence, 0.0, "", type_name(Event), text))
            return len(seen) >= 3

        await until(lambda: send(0))
        send(5)
        await until(lambda: seen.count(5) == 3)
        await until(lambda: reported, 6.0)
        await asyncio.sleep(0.1)
        (report,) = reported
        assert report.startswith(f"lost {PLATFORM}/components/pose/event: messages are missing (4 so far)")
        assert report.endswith("; and of 2 other topics")


async def test_pictures_go_through_memory_to_those_on_this_computer_and_others_get_them_too(tmp_path: Path) -> None:
    with (
        node(tmp_path, "main", is_sharing=False) as far,
        node(tmp_path, "one") as sender,
        node(tmp_path, "other") as near,
    ):
        publisher = Publisher(sender, PLATFORM, "camera", 7)
        picture = Image(camera="front", width=640, height=480, data=bytes(range(256)) * 1200)
        came: dict[str, list[Envelope[Image]]] = {"far": [], "near": [], "late": []}
        far.subscribe(CAMERA, came["far"].append)
        near.subscribe(f"{PLATFORM}/camera/*", came["near"].append)
        begin_s = asyncio.get_running_loop().time()
        while not all(came.values()) or asyncio.get_running_loop().time() < begin_s + 1.5:
            publisher.publish(CAMERA, picture, 0.25)
            await asyncio.sleep(0.02)
            if came["near"] and came["far"] and not came["late"]:
                end_late = near.subscribe(CAMERA, came["late"].append)
        for exchange, name in ((far, "far"), (near, "near")):
            assert all(envelope.payload == picture for envelope in came[name])
            numbers = [envelope.sequence for envelope in came[name]]
            assert numbers == sorted(set(numbers)), "each comes once"
            assert exchange.problems().get(f"lost {CAMERA}", 0) == numbers[-1] - numbers[0] + 1 - len(numbers)
        assert mapped() == {"rw-s", "r--s"}, "written by one, read by the other"
        end_late()
        await sender.renew(ZenohEndpoints(name="one", connect=(f"{UNIX}/{tmp_path}/z",)))
        assert mapped() == set()
        came["near"].clear()
        while not came["near"]:
            publisher.publish(CAMERA, picture, 0.25)
            await asyncio.sleep(0.02)
    assert mapped() == set()


def mapped() -> set[str]:
    """How shared memory is mapped into this process."""
    lines = Path("/proc/self/maps").read_text().splitlines()
    return {line.split()[1] for line in lines if "memfd:gloc3" in line}


@pytest.mark.parametrize("megabytes", [0.3, 3.0])
async def test_pictures_reach_a_computer_that_shares_no_memory(megabytes: float, tmp_path: Path) -> None:
    with node(tmp_path, "main", is_sharing=False) as main, node(tmp_path, "one") as one:
        came: list[Envelope[Image]] = []
        main.subscribe(CAMERA, came.append)
        publisher = Publisher(one, PLATFORM, "camera", 7)
        picture = Image(camera="front", width=1000, height=1000, data=bytes(range(200)) * round(megabytes * 5000))

        def show() -> bool:
            publisher.publish(CAMERA, picture, 0.25)
            return False

        await until(lambda: came or show())
        assert came[0].payload == picture


async def test_bytes_from_strangers_are_counted_and_told_never_raised(tmp_path: Path) -> None:
    reported: list[str] = []
    with (
        node(tmp_path, "main", troubled=lambda _, text: reported.append(text)) as main,
        new_session(ZenohEndpoints(name="one", connect=(f"{UNIX}/{tmp_path}/z",))) as stranger,
    ):
        received, _ = receive(main, EVENT)
        types = TopicTable.installed().types
        good = Envelope(EVENT, Source("p", "c", 1), 0, 0.25, "", type_name(type(event("x"))), event("x"))
        bad = [
            b"",
            b"\xc1 no msgpack",
            types.encode(good)[:-3],
            types.encode(replace(good, type="Stranger#000000")),
            types.encode(replace(good, type=good.type[:-6] + "000000")),
            types.encode(replace(good, topic=f"{PLATFORM}/motion/grant")),
        ]

        def put() -> bool:
            for data in bad:
                stranger.put(EVENT, data)
            stranger.put(EVENT, types.encode(good), attachment=b"odd")
            stranger.put(EVENT, types.encode(good))
            return False

        await until(lambda: received or put())
        counted = main.problems()
        assert counted[f"damaged {EVENT}"] >= 5
        assert counted[f"versions {EVENT}"] >= 1
        assert counted[f"misplaced {EVENT}"] >= 1
        assert any("versions differ" in text for text in reported)
        assert any("it says that it is of minoas/motion/grant" in text for text in reported)


STOPPED = """
import asyncio, sys
from gloc3.exchange.zenoh import open_exchange
from gloc3.exchange.zenoh_session import ZenohEndpoints
from gloc3.messages.topics import TopicService, TopicTable
async def live():
    node = ZenohEndpoints(name="one", connect=(sys.argv[1],))
    with open_exchange(node, asyncio.get_running_loop(), TopicTable.installed()) as exchange:
        exchange.subscribe("**", lambda envelope: None)
        exchange.declare_alive("one")
        await asyncio.sleep(60)
asyncio.run(live())
"""


async def test_a_receiver_that_stands_still_holds_up_no_loop_and_goes_by_its_lease(tmp_path: Path) -> None:
    with node(tmp_path, "main") as main:
        loop = asyncio.get_running_loop()
        alive: list[bool] = []
        main.watch("one", lambda _, is_alive: alive.append(is_alive))
        process = await asyncio.create_subprocess_exec(sys.executable, "-c", STOPPED, f"{UNIX}/{tmp_path}/z")
        await until(lambda: alive == [True], within_s=60.0)
        process.send_signal(signal.SIGSTOP)
        ends = Ends(main, main)
        worst_s = 0.0
        for _ in range(100):
            begin_s = loop.time()
            for _ in range(60):
                ends.report("x" * 2000)
            worst_s = max(worst_s, loop.time() - begin_s)
            await asyncio.sleep(0)
        assert worst_s < 0.5, "publishing waited for a link"
        await until(lambda: alive == [True, False])
        process.kill()
        await process.wait()


async def test_a_message_that_is_too_long_for_its_topic_is_told_and_dropped_at_both_ends(tmp_path: Path) -> None:
    long = b"x" * (TopicService.REPORT.most_bytes + 1)
    with node(tmp_path, "main") as main, node(tmp_path, "one") as one:
        received, _ = receive(main, EVENT)
        publisher = Publisher(one, PLATFORM, "speaker", 7)

        def say(text: str) -> bool:
            publisher.publish(EVENT, event(text), 0.25)
            return False

        await until(lambda: received or say("short"))
        say(long.decode())
        assert one.problems() == {f"unsent {EVENT}": 1}
    with (
        node(tmp_path, "main") as main,
        new_session(ZenohEndpoints(name="one", connect=(f"{UNIX}/{tmp_path}/z",))) as stranger,
    ):
        received, _ = receive(main, EVENT)
        await until(lambda: main.problems().get(f"too_long {EVENT}") or stranger.put(EVENT, long))
        huge = b"x" * (TopicService.BULK.most_bytes + 1_000_000)
        stranger.put(EVENT, huge, congestion_control=CongestionControl.BLOCK)  # no session reads that
        stranger.put(EVENT, b"short", congestion_control=CongestionControl.BLOCK)
        await until(lambda: f"damaged {EVENT}" in main.problems())
        assert main.problems()[f"too_long {EVENT}"] < 10
        assert not received


async def test_one_sender_cannot_fill_the_loop_or_keep_others_out(tmp_path: Path) -> None:
    reported: list[str] = []
    row = TopicTable.installed().row(f"{PLATFORM}/ci/ask/eve")
    assert row is not None
    with (
        node(tmp_path, "main", troubled=lambda _, text: reported.append(text)) as main,
        new_session(ZenohEndpoints(name="one", connect=(f"{UNIX}/{tmp_path}/z",))) as eve,
    ):
        receive(main, f"{PLATFORM}/ci/ask/*")
        await until(lambda: main.problems() or eve.put(f"{PLATFORM}/ci/ask/eve", b"?"))
        for _ in range(2000):
            eve.put(f"{PLATFORM}/ci/ask/eve", b"?", congestion_control=CongestionControl.BLOCK)
        eve.put(f"{PLATFORM}/ci/ask/alice", b"?")
        await until(lambda: f"damaged {PLATFORM}/ci/ask/alice" in main.problems())
        await until(lambda: f"too_many {PLATFORM}/ci/ask/eve" in main.problems())
        read, dropped = (main.problems()[f"{kind} {PLATFORM}/ci/ask/eve"] for kind in ("damaged", "too_many"))
        assert read < 0.2 * 2000 < dropped
        assert any(
            f"too_many {PLATFORM}/ci/ask/eve: more than {row.most_hz:g} messages a second" in one for one in reported
        )
