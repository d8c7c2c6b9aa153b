"""Before a mission starts its fence is in the autopilot of every class: uploaded, read back, switched on, and told."""

from pathlib import Path

import msgspec
import pytest
from tests.flight.card import Card

from gloc3.errors import Gloc3Error
from gloc3.messages.command_interface import Preflight
from gloc3.messages.preflight import PreflightReport, Verdict
from gloc3.platform.reader import load_platform

AROUND = "{polygon_m: [[-HALF, -HALF], [HALF, -HALF], [HALF, HALF], [-HALF, HALF]], ceiling_m: 100}"
HALF_M = {"plane": "600"}
"""For its landing approach; 200 m for the others."""
SET_OFF = {
    "pelican_rtk": "take_off: {height_m: 2}",
    "plane": "take_off: {height_m: 50}",
    "vtol": "take_off: {height_m: 40}",
}
"""What is not `drive_off` or `dive`."""
OWN = {"rover": "drive_off: {}", "boat": "drive_off: {}", "auv": "dive: {depth_m: 2}", "rov": "dive: {depth_m: 2}"}
ACTS = {"auv": Verdict.WARNING, "rov": Verdict.WARNING}
"""What the pre-flight list says of what the autopilot does at it: ArduSub only records that it was left."""


def text(platform: str, around: str = "") -> str:
    frame = next(iter(load_platform(platform).frames))
    begin = {**SET_OFF, **OWN}[platform]
    return "\n".join(
        [
            "mission: inside",
            f"frame: {frame}",
            f"geofence: {around or AROUND.replace('HALF', HALF_M.get(platform, '200'))}",
            "on_failure: land",
            "on_low_battery: land",
            "on_pose_lost: land",
            f"tasks: {{go: {{actions: {{off: {{{begin}}}, down: {{land: {{}}, after: [off]}}}}}}}}\n",
        ]
    )


@pytest.mark.parametrize(
    ("platform", "style"),
    [
        ("pelican_rtk", "px4"),
        ("pelican_rtk", "ardupilot"),
        ("plane", "ardupilot"),
        ("vtol", "px4"),
        ("vtol", "ardupilot"),
        ("rover", "ardupilot"),
        ("boat", "ardupilot"),
        ("auv", "ardupilot"),
        ("rov", "ardupilot"),
    ],
)
def test_the_fence_stands_on_the_autopilot_before_the_start(platform: str, style: str, tmp_path: Path) -> None:
    flight = Card(style, tmp_path)
    try:
        flight.begin(text(platform), platform=platform, is_started=False)
        autopilot = flight.flight.simulator.autopilot
        assert len(autopilot.plans.fence) == 4
        assert autopilot.commander.fence.is_kept(autopilot.craft) or platform in ACTS
        assert flight.last("autopilot_fence").progress == "confirmed"
        reply = flight.request(Preflight())
        report = msgspec.convert(reply.result, PreflightReport)
        (line,) = [one for one in report.checks if one.name == "fence"]
        assert line.verdict is ACTS.get(platform, Verdict.OK), line.finding
    finally:
        flight.close()


def test_a_plane_whose_landing_approach_would_leave_the_fence_is_not_given_the_mission(tmp_path: Path) -> None:
    """Onboard the heading of the runway is known: the vehicle stands on it."""
    flight = Card("ardupilot", tmp_path)
    around = AROUND.replace("-HALF, ", "-120, ").replace("HALF", "700")
    try:
        with pytest.raises(Gloc3Error, match=r"landing approach leaves the fence .* with the runway at 2 degrees"):
            flight.begin(text("plane", around), platform="plane", is_started=False)
    finally:
        flight.close()
