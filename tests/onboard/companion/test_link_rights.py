"""Rights on a MAVLink link: what its stations may send to the autopilot itself, past the command interface."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.common.network.test_rights import FILE
from tests.common.network.test_rights import Yard as RightsOf

from gloc3.mavlink.codec import Encoder, Frame, Parser, message
from gloc3.network.rights import Rights
from gloc3_onboard.companion.link_rights import LinkRights

ARM, CALIBRATE, TERMINATE, MESSAGE, CONTROL_FENCE = 400, 241, 185, 512, 207
CAMERA_SETTINGS, VIDEO_STREAM, FORMAT = 522, 2504, 526
MODES = FILE.replace("[terminate]", "[]")


def frame(name: str, **fields: Any) -> Frame:
    (found,) = Parser().receive(Encoder(250, 190).encode(message(name, **fields)))
    return found


FRAMES: dict[str, Frame] = {
    "read a parameter": frame("PARAM_REQUEST_READ"),
    "request a message": frame("COMMAND_LONG", command=MESSAGE),
    "request a camera's settings": frame("COMMAND_LONG", command=CAMERA_SETTINGS),
    "request a stream's address": frame("COMMAND_LONG", command=VIDEO_STREAM),
    "format a card": frame("COMMAND_LONG", command=FORMAT),
    "set a parameter": frame("PARAM_SET"),
    "calibrate": frame("COMMAND_LONG", command=CALIBRATE),
    "write a file": frame("FILE_TRANSFER_PROTOCOL"),
    "arm": frame("COMMAND_LONG", command=ARM),
    "terminate": frame("COMMAND_INT", command=TERMINATE),
    "fence off": frame("COMMAND_LONG", command=CONTROL_FENCE),
    "mode": frame("SET_MODE"),
    "sticks": frame("MANUAL_CONTROL"),
    "a mission": frame("MISSION_COUNT"),
    "heartbeat": frame("HEARTBEAT"),
}
READING = {"read a parameter", "request a message", "request a camera's settings", "request a stream's address"}
MAINTAINING = {"set a parameter", "calibrate", "write a file", "format a card"}
FLYING = FRAMES.keys() - READING - MAINTAINING


def passed(rights: Rights, member: str) -> set[str]:
    link = LinkRights(rights, member)
    return {what for what, one in FRAMES.items() if not link.withholds(one)}


@pytest.fixture
def rights_of(tmp_path: Path) -> Callable[[str], Rights]:
    return lambda text: RightsOf(tmp_path, text).rights


def test_a_link_passes_on_what_its_members_role_permits(rights_of: Callable[[str], Rights]) -> None:
    rights = rights_of(MODES)
    assert passed(rights, "alice") == READING | FLYING
    assert passed(rights, "carol") == READING | FLYING
    assert passed(rights, "mike") == READING | MAINTAINING
    assert passed(rights, "erin") == READING, "nobody sees there whether it keeps to its capabilities"
    assert passed(rights, "dora") == set()
    assert passed(rights, "") == set()


def test_what_needs_two_persons_passes_for_none(rights_of: Callable[[str], Rights]) -> None:
    assert passed(rights_of(FILE), "alice") == READING
    assert passed(rights_of(FILE.replace("[terminate]", "[maintain]")), "mike") == READING


def test_without_a_file_everything_passes_and_a_role_counts_from_the_moment_on(tmp_path: Path) -> None:
    yard = RightsOf(tmp_path, MODES)
    assert passed(Rights("pelican"), "") == set(FRAMES)
    link = LinkRights(yard.rights, "dora")
    assert link.withholds(FRAMES["arm"])
    yard.rights.appoint("carol", "dora", "operator", 60.0)
    assert not link.withholds(FRAMES["arm"])
    yard.now_s += 60.0
    assert link.withholds(FRAMES["arm"])
