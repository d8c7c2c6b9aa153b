"""The hosts of a platform, from what they say of themselves over a bad radio to the health screen."""

import asyncio

import msgspec
import pytest
from msgspec.structs import replace
from tests.common.exchange.mavlink.ends import PLATFORM, pair_on
from tests.groundstation.station_scene import scene

from gloc3.clock import run_virtual
from gloc3.messages.hosts import HostState, HostStatus, ProcessLine
from gloc3.messages.software import own_software
from gloc3_groundstation.station import fleet as reducers
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot
from gloc3_groundstation.tui.views.hosts import host_lines
from gloc3_groundstation.tui.widgets.lines import text_of
from gloc3_onboard.hosts.host_watch import ROWS, HostBook

ROW_BYTES = 16
MAIN = HostStatus(
    host="main",
    is_clock_host=True,
    processes=[
        ProcessLine("", 11, "up", ["driver"]),
        ProcessLine("eyes", 0, "away", ["stereo"], restarts=2, last_words="ended by SIGSEGV"),
        ProcessLine("spare", 0, "left", []),
    ],
    **own_software()._asdict(),
    load=0.42,
)
VISION = HostStatus(
    host="vision",
    is_clock_host=False,
    processes=[ProcessLine("", 12, "up", ["laser"])],
    **own_software()._asdict(),
    clock_offset_s=-1234.567,
    clock_bound_s=0.0012,
    load=1.25,
)


def book() -> HostBook:
    """Two hosts that were heard, and one that was not."""
    found = HostBook(["main", "vision", "base"], "main")
    found.update(MAIN)
    found.update(VISION)
    return found


def shown(found: HostBook, age_s: float = 0.0, width: int = 130) -> list[str]:
    """What a station shows of it that was told just now."""
    summaries = list(found.summaries())
    platform = PlatformSnapshot(
        name="p",
        boot=1,
        first_received_s=0.0,
        received_s=0.0,
        host_names=found.names(),
        hosts={line.index: (line, 0.0) for summary in summaries for line in summary.lines},
    )
    return [" ".join(text_of(line).split()) for line in host_lines(platform, age_s, width)]


def test_each_host_is_told_with_its_processes_clock_load_version_and_last_words() -> None:
    version = MAIN.version
    assert shown(book()) == [
        "host state processes load clock version last exit",
        f"main here 1 of 2 down, 2× anew 42 % the platform's {version} eyes: ended by SIGSEGV",
        f"vision here 1 up 125 % -1234.57 s ± 2 ms {version}",
        "base expected 0 up 0 % not compared yet",
    ]


def test_a_host_that_is_lost_of_another_version_or_not_heard_for_long_is_told_so() -> None:
    found = book()
    found.presence("vision", is_here=False)
    assert "vision lost 0 up" in shown(found)[2]
    found.presence("vision", is_here=True)
    assert "vision here 1 up" in shown(found)[2]
    found.update(replace(VISION, protocol="another"))
    assert "vision other version" in shown(found)[2]
    assert "vision was other version" in shown(found, age_s=60.0)[2]


def test_a_platform_of_one_process_has_nothing_to_tell() -> None:
    found = HostBook(["main"], "main")
    found.update(replace(MAIN, processes=MAIN.processes[:1]))
    assert not found.is_reportable
    found.update(MAIN)
    assert found.is_reportable


def test_a_row_has_few_bytes_and_all_hosts_arrive_over_a_radio_that_loses_frames() -> None:
    worst = HostBook([f"host{number}" for number in range(2 * ROWS)], "host0")
    processes = [replace(MAIN.processes[1], restarts=10**6, last_words="x" * 500)] * 20
    for number in range(2 * ROWS):
        worst.update(replace(VISION, host=f"host{number}", processes=processes, load=1e3, clock_bound_s=1e9))
    for summary in worst.summaries():
        assert all(len(msgspec.msgpack.encode(line)) <= ROW_BYTES for line in summary.lines)

    async def report() -> Fleet:
        station, platform, _ = pair_on(1)
        for _ in range(8):
            platform.report(3)
            for summary in worst.summaries():
                await asyncio.sleep(2.0 / worst.parts)
                platform.publisher.publish(f"{PLATFORM}/ci/hosts", summary, 0.0)
        platform.publisher.publish(f"{PLATFORM}/ci/host_names", worst.names(), 0.0)
        await asyncio.sleep(10.0)
        fleet = Fleet()
        for t_s, envelope in station.came:
            fleet = reducers.receive(fleet, envelope, t_s)
        return fleet

    found = run_virtual(report()).get(PLATFORM)
    assert found is not None
    assert found.host_names == worst.names()
    assert [line for _, (line, _) in sorted(found.hosts.items())] == [
        line for each in worst.summaries() for line in each.lines
    ]


@pytest.mark.sockets
async def test_the_health_screen_shows_the_hosts_of_a_platform_that_has_several() -> None:
    async with scene() as here:
        here.platform.speak()
        await here.go("2")
        assert not here.app.screen.query_one("#hosts").display
        here.platform.report("host_names", book().names())
        for summary in book().summaries():
            here.platform.report("hosts", summary)
        await here.until("hosts", "1 of 2 down, 2× anew")
        assert "vision" in here.shown("hosts")


def test_states_go_by_their_place() -> None:
    assert [str(state) for state in HostState] == ["expected", "here", "other version", "lost"]
