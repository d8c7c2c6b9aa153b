"""Targets of what an autopilot, or who claims to be one, sends to the onboard process, and of uploaded plans."""

import lzma
from typing import Final

import msgspec
from tests.fuzz.common.mavlink import messages_of
from tests.fuzz.target import as_file, fuzz_target, refuses

from gloc3.mavlink.codec import message
from gloc3.mavlink.services.plan import PlanItem
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.formats.to_mission import to_mission
from gloc3.platform.reader import load_platform
from gloc3_onboard.autopilot.events import EventDictionary
from gloc3_onboard.autopilot.families import style_of
from gloc3_onboard.autopilot.presets.files import load_preset
from gloc3_onboard.autopilot.telemetry import Telemetry
from gloc3_onboard.companion.plans import Verdict, fence_of, judge, plan_of

PLATFORM: Final = load_platform("pelican_rtk")
NUMBERS: Final = tuple(component << 24 | number for component in (0, 1) for number in range(8))
TELEMETRY: Final = (
    "HEARTBEAT", "SYS_STATUS", "EXTENDED_SYS_STATE", "ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT",
    "GPS_GLOBAL_ORIGIN", "HOME_POSITION", "ESTIMATOR_STATUS", "BATTERY_STATUS", "VFR_HUD", "SYSTEM_TIME", "TIMESYNC",
    "DISTANCE_SENSOR", "RC_CHANNELS", "GPS_RAW_INT", "EKF_STATUS_REPORT", "STATUSTEXT", "ALTITUDE", "SCALED_PRESSURE",
)  # fmt: skip


@fuzz_target("gloc3_onboard.autopilot.telemetry", "gloc3_onboard.autopilot.families")
def autopilot_telemetry(data: bytes) -> None:
    """Telemetry of any content, of either family, raises nothing; what is made of it can be sent on."""
    for autopilot in (3, 12):
        style = style_of(message("HEARTBEAT", type=2, autopilot=autopilot))
        assert style is not None
        telemetry, now_s = Telemetry(), 0.0
        telemetry.adopt(style)
        telemetry.connected(is_connected=True)
        for received, _ in messages_of(data, TELEMETRY):
            now_s += 0.05
            telemetry.receive(received, now_s)
            telemetry.texts_since(0.0)
        msgspec.msgpack.encode(telemetry.state)
        if telemetry.pose is not None:
            msgspec.msgpack.encode(telemetry.pose.pose)


@fuzz_target("gloc3_onboard.autopilot.events")
def event_dictionary(data: bytes) -> None:
    """A dictionary of events, packed or not, describes any event or none, or is refused as a `ValueError`."""
    text, _, arguments = data.partition(b"\xff--")

    def whole(packed: bytes) -> None:
        dictionary = EventDictionary(packed)
        for number in NUMBERS:
            found = dictionary.describe(number, arguments[:25].ljust(25, b"\0"))
            assert found is None or isinstance(found.text, str)
        dictionary.mode_bit(3)

    refuses(lambda: whole(text), ValueError)
    refuses(lambda: whole(lzma.compress(text, preset=0)), ValueError)


@fuzz_target("gloc3_onboard.autopilot.presets", "gloc3.documents")
def preset_file(data: bytes) -> None:
    """A file of parameters to set is a preset, or is refused with findings and places."""
    refuses(lambda: load_preset(str(as_file(data, "preset.yaml"))))


@fuzz_target("gloc3_onboard.companion.plans", "gloc3.mission.formats")
def uploaded_plan(data: bytes) -> None:
    """Items that a ground station uploads are a fence and a mission that can be checked, or are refused as a whole."""
    items = tuple(
        PlanItem(
            command=received.command,
            frame=received.frame,
            param1=received.param1,
            param2=received.param2,
            param3=received.param3,
            param4=received.param4,
            x=received.x,
            y=received.y,
            z=received.z,
        )
        for received, _ in messages_of(data, ("MISSION_ITEM_INT",))
    )
    fence = fence_of(items)
    if judge(items) is not None:
        return

    def whole() -> None:
        text, _ = to_mission(plan_of(items, () if isinstance(fence, Verdict) else fence), "plan", "f", PLATFORM)
        report = check_text(text, "f", Circumstances(platform=PLATFORM))
        assert report.is_ok or report.findings

    refuses(whole)
