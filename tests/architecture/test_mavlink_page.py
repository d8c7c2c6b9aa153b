"""The page of MAVLink finds the messages that a module handles in each of their forms."""

from tests.house.mavlink import handled

SOURCE = """
_HEARTBEAT, _TIME = shape("HEARTBEAT").id, shape("SYSTEM_TIME").id
KEEPS = {"ODOMETRY": 3}

def receive(self, message, sender, now_s):
    match message.name:
        case "ATTITUDE" | "VFR_HUD":
            return
    if message.name == "STATUSTEXT" or message.name in ("GPS_RAW_INT", "no message"):
        self._send("COMMAND_LONG")
"""


def test_handled_messages_are_found_in_every_form() -> None:
    found = {"HEARTBEAT", "SYSTEM_TIME", "ATTITUDE", "VFR_HUD", "STATUSTEXT", "GPS_RAW_INT"}
    assert handled("tests.house.mavlink", SOURCE) == found


def test_a_microservice_declares_its_messages() -> None:
    assert handled("gloc3.mavlink.services.timesync", "handles = frozenset()") == {"TIMESYNC"}
