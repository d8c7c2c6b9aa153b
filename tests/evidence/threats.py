"""The threat model: who may attack, what holds it off, which tests show it, what is left; sockets and attacks are measured."""

import asyncio
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import msgspec
from tests.commands.listening import ALONE, listening
from tests.commands.programs import program
from tests.commands.test_listening_sockets import make_network
from tests.evidence.page import ROOT, Bar, Figure, Progress
from tests.onboard.process.replays import ATTACKS, Replayed

COMMANDS: dict[str, str] = {
    "sitl": "companion link",
    "sitl --autopilot ardupilot": "ground link tcpin",
    "sitl --vehicle rov --sensors 0 --dvl a50://127.0.0.1:16171": "Doppler velocity log",
    "sitl --link udpin://0.0.0.0:14550": "is open to the network and not signed",
    "relay udpin://:15001 udpout://127.0.0.1:15002": "relaying between",
    "relay udpin://0.0.0.0:15001 udpout://127.0.0.1:15002": "is open to the network and not signed",
    "onboard pelican_rtk --out out": "components; log in",
    "onboard pelican_rtk --out out --station udpin://0.0.0.0:14550": "is open to the network and not signed",
    "onboard pelican_rtk --out out --network yard/pelican.main/network.yaml": "components; log in",
    "station --headless --config none.toml": "listening on",
    "station --headless --config none.toml --link udpin://0.0.0.0:14550": "is open to the network and not signed",
    "station --web --foxglove --config none.toml": "the station is at",
    "station --web --web-host 0.0.0.0 --config none.toml": "warning: anyone with the address",
    "station --web --config none.toml --network yard/alice/network.yaml": "the station is at",
    "doctor pelican_rtk --autopilot udpin://0.0.0.0:14540": "is open to the network and not signed",
}
"""Commands, each with what it says once its sockets are open."""


class Threat(NamedTuple):
    """What somebody may try."""

    who: str
    what: str
    defence: str
    tests: tuple[str, ...]
    left: str


SIGNING, ROUTER = "tests/common/mavlink/test_signing.py::", "tests/common/mavlink/test_router.py::"
HANDLER = "tests/onboard/command_server/test_request_handler.py::"
THREATS = (
    Threat(
        "radio",
        "frames are forged, repeated or held back",
        "MAVLink 2 signing with a key per link: what is not signed, not newer than the last frame of its sender, or over a minute "
        "old where the clock is right, is dropped and told",
        (
            SIGNING + "test_unsigned_frames_are_refused_but_for_the_radios",
            SIGNING + "test_what_was_heard_on_one_link_is_old_on_another_with_the_key",
            SIGNING + "test_what_was_held_back_for_more_than_a_minute_stays_out_where_the_clock_is_right",
        ),
        "signing is off without a key; nothing is encrypted; 48 bits of a hash",
    ),
    Threat(
        "radio",
        "a station's command is held back and let go later",
        "requests end by the platform's own clock, as they end for the operator",
        (
            HANDLER + "test_what_was_held_back_on_the_way_is_not_carried_out_when_it_comes",
            HANDLER
            + "test_a_request_from_before_the_vehicle_s_clock_started_again_is_refused_and_a_question_is_answered",
            "tests/groundstation/station/test_requests.py::test_a_request_ends_by_the_platform_s_own_clock_as_it_ends_for_the_operator",
            "tests/onboard/companion/test_acoustic_orders.py::test_an_order_that_was_held_back_on_the_way_is_refused",
        ),
        "a station that has not heard the vehicle yet states no limit; commands of other programs end by the age of signed frames "
        "alone; orders by modem after 10 minutes",
    ),
    Threat(
        "radio",
        "invented senders fill the tables",
        "room is shared by peers, and behind one peer senders that are heard but once make room",
        (
            ROUTER + "test_a_flood_behind_one_peer_keeps_out_nobody_behind_another",
            ROUTER + "test_a_flood_behind_one_radio_keeps_out_no_newcomer_behind_the_same",
            "tests/common/mavlink/test_fair_share.py",
        ),
        "256 that keep sending behind the same radio; jamming: a link loss, with its policy",
    ),
    Threat(
        "network",
        "strangers reach a socket",
        "everything is on loopback unless an address is given; what is open and unsigned says so",
        ("tests/commands/test_listening_sockets.py", "tests/onboard/process/test_open_links.py"),
        "a real PX4 or ArduPilot that `gloc3 sitl --firmware` starts opens ports of its own to the network, and that is told; other "
        "users of the same computer reach loopback",
    ),
    Threat(
        "network",
        "a second autopilot claims the id of the first",
        "the first peer is pinned, the second is dropped and told; the id is never learned from a station's link",
        (
            "tests/onboard/process/test_open_links.py::test_the_first_peer_is_the_autopilot_and_a_second_one_is_told",
            ROUTER + "test_our_autopilot_is_never_learned_from_a_link_to_stations",
        ),
        "who speaks before the true one, or after 3 s of its silence, is taken for it: sign that link",
    ),
    Threat(
        "network",
        "others read or command over the network",
        "mutual TLS by an authority of the network's own, rules by certificate (page network-security)",
        (
            "tests/common/network/test_who_may_what.py::test_without_a_certificate_that_counts_nothing_is_read_or_commanded",
            "tests/common/network/test_stations_on_the_network.py::test_requests_that_are_not_what_they_say_are_counted_told_and_not_carried_out",
        ),
        "who has `authority.key` makes members; a revoked one counts until the others have the new list",
    ),
    Threat(
        "network",
        "another site's page uses the operator's browser",
        "`--web` answers to this computer's names and to its own page only; beyond loopback it opens by a token, for commands or read-only",
        (
            "tests/groundstation/web/test_web.py::test_pages_of_other_sites_and_names_pointed_here_get_nothing",
            "tests/groundstation/web/test_access.py::test_the_token_leaves_the_address_for_a_cookie_and_without_either_there_is_a_clear_page",
            "tests/groundstation/web/test_access.py::test_who_may_only_watch_mirrors_the_terminal_and_keys_and_hold_do_nothing",
        ),
        "with --web-host and without --web-tls nothing is encrypted",
    ),
    Threat(
        "malicious station",
        "an observer commands, or one operator as another",
        "the role is set by the platform's end of the link; on the network the key that a request comes on proves its sender",
        (
            HANDLER + "test_an_observer_may_look_and_not_command",
            HANDLER + "test_a_station_without_control_is_refused_and_told_who_holds_it",
            "tests/onboard/command_server/test_senders.py",
        ),
        "an operator may take control over; that is logged with its author. On a MAVLink link all who have its key are one",
    ),
    Threat(
        "mission",
        "a file that makes the vehicle or the parser misbehave",
        "limits on size, depth and anchors; the checker before and onboard; the limiter enforces the fence in flight",
        (
            "tests/common/documents/test_document.py::test_a_yaml_bomb_is_refused_at_its_anchors",
            "tests/common/mission/test_mission_reader.py::test_damaged_missions_are_read_or_refused_with_findings",
            "tests/common/mission/test_mission_definitions.py::test_uses_cannot_make_a_short_file_stand_for_a_huge_one",
        ),
        "a mission without a fence; a fence that its author drew in the wrong place",
    ),
    Threat(
        "plan",
        "a `.plan` or WPL file of another program",
        "read as data, everything that cannot be expressed is told, then checked like a mission",
        (
            "tests/common/mission/test_mission_formats.py::test_any_bytes_are_read_or_refused",
            "tests/common/mission/test_mission_formats.py::test_plans_that_cannot_be_read_are_refused_with_the_place",
        ),
        "with `flown_by: autopilot` its path is the autopilot's, and only the uploaded fence holds it",
    ),
    Threat(
        "log",
        "a damaged or forged MCAP file is opened",
        "what cannot be read is skipped and named; nothing in a log is executed",
        (
            "tests/common/log/test_log_damage.py::test_no_bytes_whatever_break_the_reader",
            "tests/common/log/test_log_damage.py::test_unknown_and_changed_types_are_read_as_dictionaries",
        ),
        "logs are not signed: who can write the file can change what it says",
    ),
    Threat(
        "vehicle",
        "a vehicle, or what is in its place, sends bad bytes or asks for files",
        "bounded, checked parsing; MAVLink FTP serves its own folder only; messages of another version are refused",
        (
            "tests/common/mavlink/test_ftp.py::test_nothing_outside_the_folder_can_be_reached",
            "tests/common/messages/test_wire.py::test_deeply_nested_bytes_are_refused",
            "tests/groundstation/services/test_parameter_info.py::test_what_becomes_huge_when_it_is_unpacked_is_refused",
        ),
        "an autopilot that lies consistently about itself; its position has a second opinion (docs/pose.md)",
    ),
)


class _Sockets(msgspec.Struct, frozen=True):
    listed: list[str]
    open: list[str]


def _listen(line: str, said: str) -> _Sockets:
    """Starts a command in a network of its own."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if "--network" in line:
            make_network(folder)
        with program(*line.split(), folder=folder, before=ALONE) as running:
            running.await_line(lambda text: said in text)
            found = listening(running.process.pid)
        return _Sockets([str(one) for one in found], [str(one) for one in found if one.is_open])


def _attack(number: int) -> Replayed:
    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(ATTACKS[number](Path(folder)))


def _run_tests(nodes: Sequence[str]) -> dict[str, list[int]]:
    """Runs tests; for each name as given, how many passed and how many did not."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        line = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", f"--junitxml={report}"]
        subprocess.run([*line, *nodes], cwd=ROOT, check=False, capture_output=True)
        cases = list(ET.parse(report).iter("testcase")) if report.exists() else []
    found = {node: [0, 0] for node in nodes}
    for case in cases:
        module = f"{case.attrib['classname'].replace('.', '/')}.py"
        for node in nodes:
            file, _, name = node.partition("::")
            if module == file and name in ("", case.attrib["name"].partition("[")[0]):
                found[node][len(case) > 0 and case[0].tag in ("failure", "error", "skipped")] += 1
    return found


def security(progress: Progress) -> list[Figure]:
    """The sockets, the attacks, and the tests of every threat."""
    figures = []
    for line, said in COMMANDS.items():
        found = msgspec.convert(progress.part(line, partial(_listen, line, said)), _Sockets)
        is_meant = "0.0.0.0" in line
        value = f"{', '.join(found.listed)}{'; it says so' if is_meant else ''}"
        figures.append(
            Figure(
                f"sockets of `gloc3 {line}`",
                value,
                "told at the start" if is_meant else "loopback only",
                bool(found.open) is is_meant and bool(found.listed),
            )
        )
    for number in range(len(ATTACKS)):
        attacked = msgspec.convert(progress.part(f"attack {number}", partial(_attack, number)), Replayed)
        figures.append(Figure(attacked.attack, attacked.seen, "held off", attacked.is_held_off))
    nodes = sorted({node for threat in THREATS for node in threat.tests})
    results = progress.part("tests", lambda: _run_tests(nodes))
    for threat in THREATS:
        passed, failed = (sum(results[node][index] for node in threat.tests) for index in (0, 1))
        names = ", ".join(f"`{node.removeprefix('tests/')}`" for node in threat.tests)
        is_met = not failed and all(results[node][0] for node in threat.tests)
        figures.append(
            Figure(
                f"{threat.who}: {threat.what}",
                f"{threat.defence}. {passed} of {passed + failed} tests pass: {names}. Left: {threat.left}",
                "all pass",
                is_met,
            )
        )
    return figures


BARS = (
    Bar(
        "security",
        "Commands listen only where they say, and attacks on their sockets fail",
        "Each command is started in a network namespace of its own, and the sockets that it listens on are read from "
        "`/proc/net`. Then attacks run against the real sockets of an onboard process. The last rows are the threat "
        "model: the attacker and the attempt, the defence, the tests that fail without it, which are run for this "
        "page, and the remaining risk. [docs/security.md](../security.md) explains it.",
        security,
    ),
)
