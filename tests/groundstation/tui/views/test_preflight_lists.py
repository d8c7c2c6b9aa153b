"""The station's side of the pre-flight list: its own lines, what is kept, and how it reads."""

import asyncio
from typing import Any

import pytest
from msgspec.structs import replace
from tests.groundstation.scripted_platform import CHECKS, CLOCK, LINK_LOSS, ScriptedPlatform, refused

from gloc3 import __version__
from gloc3.exchange import LocalExchange
from gloc3.messages.preflight import Check, Group, PreflightReport, Verdict
from gloc3_groundstation.desk.preflight_desk import CheckList, PreflightDesk, ReceivedList, station_checks
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import LinkStatistics, PlatformSnapshot
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.tui.views.preflight import no_list_lines, preflight_headline, preflight_rows, preflight_title
from gloc3_groundstation.tui.widgets.lines import text_of

HERON = PlatformSnapshot(name="heron", boot=7, first_received_s=0.0, received_s=10.0)


def reported(**changes: Any) -> ReceivedList:
    fields: dict[str, Any] = {"checks": list(CHECKS), "version": __version__, "utc_s": 5000.0, **changes}
    return ReceivedList(PreflightReport(**fields), boot=7, received_s=10.0, utc_s=5000.1)


def own(
    known: ReceivedList | None = None, *, now_s: float = 10.0, trip_s: float | None = 0.2, **link: Any
) -> dict[str, Check]:
    platform = replace(HERON, link=LinkStatistics(**link))
    return {check.name: check for check in station_checks(platform, known or reported(), trip_s, now_s)}


def test_a_good_link_between_equal_ends_is_all_right() -> None:
    assert {check.verdict for check in own().values()} == {Verdict.OK}
    assert own()["round trip"].finding == "200 ms"


@pytest.mark.parametrize(
    ("checks", "name", "verdict"),
    [
        (own(loss=0.2), "loss", Verdict.WARNING),
        (own(loss=0.6), "loss", Verdict.WARNING),
        (own(now_s=20.0), "loss", Verdict.RED),
        (own(trip_s=2.0), "round trip", Verdict.WARNING),
        (own(trip_s=None), "round trip", Verdict.UNKNOWN),
        (own(reported(version="0.0.9")), "versions", Verdict.WARNING),
        (own(reported(protocol="00c0ffee")), "versions", Verdict.RED),
        (own(reported(version="")), "versions", Verdict.UNKNOWN),
        (own(reported(utc_s=5060.0)), "clocks", Verdict.WARNING),
        (own(reported(utc_s=None)), "clocks", Verdict.UNKNOWN),
    ],
)
def test_a_bad_link_or_ends_that_differ_say_what_to_do(checks: dict[str, Check], name: str, verdict: Verdict) -> None:
    assert checks[name].verdict is verdict
    assert checks[name].advice or verdict is Verdict.UNKNOWN


async def test_a_list_is_asked_for_kept_and_forgotten_with_the_platforms_life() -> None:
    exchange = LocalExchange()
    platform = ScriptedPlatform(exchange)
    platform.delay_s = 0.0
    station = Station(exchange, asyncio.get_running_loop(), "255", 11)
    platform.speak()
    desk = PreflightDesk(station)
    assert desk.is_due("heron")
    assert await desk.refresh("heron")
    assert not desk.is_due("heron")
    known = station.fleet.get("heron")
    assert known is not None
    found = desk.list_of(known)
    assert {check.group for check in found.checks} >= {"autopilot", "link"}
    assert found.age_s is not None
    assert not desk.list_of(replace(known, boot=8)).checks
    desk.invalidate("heron")
    assert desk.is_due("heron")
    station.close()


async def test_a_platform_that_refuses_leaves_the_reason() -> None:
    from gloc3.messages.command_interface import Preflight

    exchange = LocalExchange()
    platform = ScriptedPlatform(exchange)
    platform.delay_s = 0.0
    platform.answer_next(Preflight, refused("not now"))
    station = Station(exchange, asyncio.get_running_loop(), "255", 11)
    platform.speak()
    desk = PreflightDesk(station)
    assert not await desk.refresh("heron")
    known = station.fleet.get("heron")
    assert known is not None
    assert desk.list_of(known).problem == "not now"
    station.close()


def shown(*checks: Check, age_s: float | None = 3.0, width: int = 80) -> str:
    found = CheckList(checks, age_s, is_requesting=False, problem="")
    lines = [preflight_headline(HERON, found, width), *(row.line for row in preflight_rows(found, width))]
    assert all(len(text_of(line)) <= width for line in lines)
    return "\n".join([preflight_title(found), *map(text_of, lines)])


def test_a_red_line_says_that_the_start_is_refused_and_what_to_do() -> None:
    text = shown(CHECKS[0], LINK_LOSS, CLOCK)
    assert text.splitlines()[0] == "checks: 1 red, 1 warning, 1 ok, 3 s ago"
    assert "1 line is red: the start is refused   o starts anyway" in text
    assert "failsafes  ✗ RED     link loss" in text
    assert "→ set NAV_DLL_ACT to 0" in text


def test_a_list_without_red_names_the_key_that_starts() -> None:
    assert "nothing is red   s starts the mission" in shown(*CHECKS)
    assert wording.duration(3.0) in shown(*CHECKS)


def test_without_a_mission_no_key_is_offered_that_would_do_nothing() -> None:
    fine = CheckList(tuple(CHECKS), 3.0, is_requesting=False, problem="")
    assert text_of(preflight_headline(HERON, fine, 80, can_start=False)).endswith("there is no mission to start now")
    bad = fine._replace(checks=(LINK_LOSS,))
    assert text_of(preflight_headline(HERON, bad, 80, can_start=False)).strip() == "1 line is red: the start is refused"
    none = fine._replace(checks=(Check(Group.MISSION, "loaded", Verdict.UNKNOWN, "none is loaded", "stream one"),))
    assert "→ open one: 3, then o" in text_of(preflight_rows(none, 80)[1].line)
    assert "→ u uploads the open mission" in text_of(preflight_rows(none, 80, has_plan=True)[1].line)


def test_of_a_vehicle_without_a_companion_no_list_is_waited_for() -> None:
    bare, none = replace(HERON, has_companion=False), CheckList((), None, is_requesting=False, problem="")
    assert "no GLOC3 companion" in text_of(preflight_headline(bare, none, 80))
    reported = " ".join(text_of(line).strip() for line in no_list_lines(bare, "", 60))
    assert "gloc3 doctor PLATFORM --autopilot URL" in reported
    assert not no_list_lines(HERON, "", 60)


def test_a_long_reason_is_whole_below_and_an_older_list_stays() -> None:
    long = "the platform " + "has said no " * 12
    lines = no_list_lines(HERON, long, 60)
    assert " ".join(text_of(line).strip() for line in lines) == long.strip()
    kept = CheckList(tuple(CHECKS), 40.0, is_requesting=False, problem="not now")
    assert "no newer list: not now" in text_of(preflight_headline(HERON, kept, 80))


def test_a_list_that_has_not_come_and_one_of_a_platform_that_refuses_say_so() -> None:
    requested = CheckList((), None, is_requesting=True, problem="")
    assert "requesting its list" in text_of(preflight_headline(HERON, requested, 80))
    assert "no list: not now" in text_of(preflight_headline(HERON, requested._replace(problem="not now"), 80))
