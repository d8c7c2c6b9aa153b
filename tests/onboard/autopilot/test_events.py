"""Events in words: the dictionary is read from the vehicle's own file; what does not fit it is left out."""

import lzma
import struct
from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.onboard.autopilot.test_autopilot_link import Rig

from gloc3.mavlink.services.files.ftp_files import FolderFiles
from gloc3.mavlink.services.files.ftp_server import FtpServer
from gloc3_onboard.autopilot.events import LARGEST_BYTES, EventDictionary

OWN = 1 << 24
MODES = {"name": "modes", "type": "mode_group_t"}
HOLD, OTHERS = 1 << 4, 1 << 5
CHECKS = {
    "1": {"name": "x_arming_check_summary", "message": ""},
    "2": {"name": "lid", "message": "The lid is open", "description": "Close it.\n\nMore", "arguments": [MODES]},
}
GROUPS: dict[str, Any] = {
    "arming_check": {"events": CHECKS},
    "health": {"events": {"3": {"name": "x_health_summary", "message": ""}}},
    "default": {
        "events": {
            "7": {
                "name": "wind",
                "message": "Wind {1:.1m/s}, {2}, <b>{3m}</b>{9}",
                "description": '<profile name="dev">PARAM_X</profile>',
                "arguments": [
                    {"name": "a", "type": "float"},
                    {"name": "b", "type": "px4::side_t"},
                    {"name": "c", "type": "int16_t"},
                ],
            }
        }
    },
}
ENUMS = {
    "mode_group_t": {"type": "uint32_t"},
    "side_t": {"type": "uint8_t", "entries": {"1": {"name": "left", "description": "Left side"}}},
}
COMPONENT = {
    "enums": ENUMS,
    "event_groups": GROUPS,
    "navigation_mode_groups": {"groups": {"4": [4 << 16 | 3 << 24], "5": [65536]}},
}


def packed(component: Any = COMPONENT) -> bytes:
    return lzma.compress(msgspec.json.encode({"version": 2, "components": {"1": component}}), preset=0)


def test_arguments_units_tags_and_enums_are_put_into_words() -> None:
    dictionary = EventDictionary(packed())
    found = dictionary.describe(OWN | 7, struct.pack("<fBh", 12.34, 1, -3))
    assert found is not None
    assert (found.text, found.group) == ("Wind 12.3 m/s, Left side, -3 m{9}", "default")
    unlisted = dictionary.describe(OWN | 7, struct.pack("<fBh", 1.0, 9, 0))
    assert unlisted is not None
    assert unlisted.text.startswith("Wind 1.0 m/s, 9, ")
    lid = dictionary.describe(OWN | 2, struct.pack("<I", HOLD))
    assert lid is not None
    assert (lid.text, lid.modes) == ("The lid is open. Close it", HOLD)


@pytest.mark.parametrize(("number", "arguments"), [(OWN | 99, b""), (7, bytes(40)), (OWN | 7, b"\0\0")])
def test_what_is_not_listed_or_cut_off_is_no_event(number: int, arguments: bytes) -> None:
    assert EventDictionary(packed()).describe(number, arguments) is None


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xfd7zXZ\0 no",
        packed()[:100],
        lzma.compress(b"[]", preset=0),
        packed({"event_groups": {"default": {"events": {"x": {"name": "n", "message": "m"}}}}}),
        lzma.compress(bytes(2 * LARGEST_BYTES), preset=0),
    ],
    ids=["empty", "garbage", "cut off", "other JSON", "a number that is none", "one that swells"],
)
def test_what_is_no_dictionary_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"\S"):
        EventDictionary(data)


def report(rig: Rig, *checks: tuple[int, int]) -> None:
    """A report on arming: severity and modes of each check that fails."""
    rows = [(1, 8, b""), *((2, severity, struct.pack("<I", modes)) for severity, modes in checks), (3, 8, b"")]
    for number, severity, arguments in rows:
        rig.autopilot.send("EVENT", id_=OWN | number, log_levels=severity, arguments=arguments.ljust(40, b"\0"))
    rig.run(0.3)


def test_reasons_are_those_of_the_present_mode_in_the_last_whole_report(tmp_path: Path) -> None:
    folder = tmp_path / "etc" / "extras"
    folder.mkdir(parents=True)
    (folder / "all_events.json.xz").write_bytes(packed())
    with Rig() as rig:
        rig.autopilot.prearm_health = 0
        rig.autopilot.add(FtpServer(rig.autopilot.own, FolderFiles(tmp_path)))
        rig.run(6.0)
        report(rig, (3, HOLD), (3, OTHERS), (4, HOLD))
        assert rig.device.state().reasons == ["The lid is open. Close it"]
        report(rig, (3, OTHERS))
        assert rig.device.state().reasons == []
        alert = struct.pack("<fBh", 15.0, 1, 2).ljust(40, b"\0")
        rig.autopilot.send("EVENT", id_=OWN | 7, log_levels=2, arguments=alert)
        rig.run(0.3)
        assert rig.link.telemetry.texts_since(0.0) == ["Wind 15.0 m/s, Left side, 2 m{9}"]
        rig.autopilot.report("Wind\t", 2)
        rig.run(0.3)
        alerts = [text for text in rig.reported if text.startswith("the autopilot says")]
        assert alerts == ["the autopilot says: Wind 15.0 m/s, Left side, 2 m{9}"], (
            "its text, with a tab, is the same event"
        )


def test_an_autopilot_without_a_dictionary_is_asked_again_after_a_minute_and_says_so_once(tmp_path: Path) -> None:
    with Rig() as rig:
        rig.autopilot.add(FtpServer(rig.autopilot.own, FolderFiles(tmp_path)))
        rig.run(50.0)
        report(rig, (3, HOLD))
        assert rig.device.state().reasons == []
        assert [text for text in rig.reported if "all_events" in text] == [
            "PX4's event texts are missing: /etc/extras/all_events.json.xz cannot be read (FILE_NOT_FOUND)"
        ]
