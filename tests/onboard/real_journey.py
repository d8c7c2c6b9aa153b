"""The journey of a real vehicle through `gloc3 onboard`: begun by one station, which dies, and ended by another."""

import asyncio
import math
import socket
from itertools import pairwise
from pathlib import Path

import msgspec
from tests.commands.programs import Program, program
from tests.onboard.real_vehicle import Vehicle, pictures, simulated, station, until

from gloc3.log.reader import LogReader
from gloc3.messages.command_interface import Verb
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station
from gloc3_sitl.demo.demo import free_ports

# A simulation that is starved of its computer stands still now and then: it goes on when it is there again.
MISSION = """\
mission: a box with pictures
frame: site
geofence: {{polygon_m: [[-{m}, -{m}], [{edge}, -{m}], [{edge}, {edge}], [-{m}, {edge}]]}}
on_failure: land
on_link_loss: continue
on_low_battery: land
on_pose_lost: continue
tasks:
  depart: {{actions: {{off: {{{start}}}}}}}
  box:
    after: [depart]
    actions:
      way: {{follow_waypoints: {{waypoints_m: [[{far}, 0, {h}], [{far}, {far}, {h}], [0, {far}, {h}]], speed_m_s: {speed}, acceptance_m: {near}}}}}
      photos: {{record_images: {{camera: ground, every_s: 2}}, until: way}}
  recover: {{after: [box], actions: {{home: {{return_home: {{}}}}, end: {{land: {{}}, after: [home]}}}}}}
"""
WAY = "box.way#"
PAUSE_S = 15.0
"""Of what waits in circles."""
STANDS_S = 4.0


def mission_for(vehicle: Vehicle) -> str:
    far, margin = vehicle.far_m, vehicle.margin_m
    return MISSION.format(
        start=vehicle.start, far=far, h=vehicle.height_m, speed=vehicle.speed_m_s, near=vehicle.near_m, m=margin,
        edge=far + margin,
    )  # fmt: skip


def known(operator: Station, vehicle: Vehicle) -> PlatformSnapshot:
    found = operator.fleet.get(vehicle.platform)
    assert found is not None
    return found


def state(operator: Station, vehicle: Vehicle) -> str:
    mission = known(operator, vehicle).mission
    return str(mission.value.state) if mission is not None else ""


def is_armed(operator: Station, vehicle: Vehicle) -> bool:
    reported = known(operator, vehicle).vehicle
    return reported is None or reported.value.is_armed


def speed_m_s(operator: Station, vehicle: Vehicle) -> float:
    reported = known(operator, vehicle).vehicle
    return float(reported.value.speed_m_s) if reported is not None else math.inf


class Led(msgspec.Struct, frozen=True):
    """How it went."""

    took_s: float
    """From the first metre of the way to its end, pause included."""
    rms_m: float
    """Distance from the straight ways between the waypoints; of what waits in circles, behind the first waypoint, before
    which it has waited."""
    most_m: float
    misses_m: list[float]
    """Nearest distance to each waypoint."""
    wait_m: float
    """Farthest that it was, while paused, from where it was told to pause."""
    inside_m: float
    """Least distance to the fence."""
    fence: str
    """What the autopilot has last said of the mission's fence."""
    home_m: float
    """Distance from home at its end."""
    highest_m: float
    lowest_m: float
    pictures: int
    had_pilot: bool


async def lead(vehicle: Vehicle, folder: Path, wind_m_s: float = 0.0) -> Led:
    """Makes the journey; fails where something is not as it should be."""
    first, second = free_ports(2, socket.SOCK_DGRAM)
    (folder / "mission.yaml").write_text(mission_for(vehicle))
    camera = f"ground_camera={pictures(folder / 'pictures')}"
    with simulated(vehicle, folder / "sitl", wind_m_s) as lines:
        link = lines.first
        if vehicle.preset:
            with program("preset", "apply", vehicle.preset, "--autopilot", link, "--yes", folder=folder) as preset:
                assert await asyncio.to_thread(preset.end) == 0, preset.text
        links = ["--station", f"udpout://127.0.0.1:{first}", "--station", f"udpout://127.0.0.1:{second}"]
        received = ["--link", f"udpin://127.0.0.1:{first}"]
        with (
            program(
                "onboard", vehicle.platform, "--autopilot", link, *links, "--device", camera, "--out", "out",
                folder=folder,
            ) as onboard,
            program("station", "--headless", "--mission", "mission.yaml", *received, folder=folder) as begun,
        ):  # fmt: skip
            try:
                begun.await_line(lambda line: "task box: running" in line, within_s=150.0)
                begun.interrupt(9)
                await finish(vehicle, f"udpin://127.0.0.1:{second}", onboard)
                onboard.interrupt()
                assert onboard.end() == 0, onboard.text
            finally:
                (folder / "station.txt").write_text(begun.text)
                (folder / "onboard.txt").write_text(onboard.text)
    return measured(folder / "out", vehicle)


async def finish(vehicle: Vehicle, url: str, onboard: Program) -> None:
    """Another station takes over, pauses, resumes, and sees the mission to its end."""
    async with station(url, 254) as operator:
        await until(lambda: operator.fleet.get(vehicle.platform) is not None, 20.0, "the platform is heard")
        await until(lambda: state(operator, vehicle) == "running", 20.0, "the mission runs")
        await operator.client.request_control(vehicle.platform, is_take_over=True)
        await until(lambda: speed_m_s(operator, vehicle) > 0.6 * vehicle.speed_m_s, 30.0, "it is on its way")
        await operator.client.steer(vehicle.platform, Verb.PAUSE)
        await until(lambda: state(operator, vehicle) == "paused", 10.0, "it is paused")
        if vehicle.is_winged:
            await asyncio.sleep(PAUSE_S)
        else:
            await until(lambda: speed_m_s(operator, vehicle) < 0.3, 20.0, f"it stands; {onboard.text}")
            await asyncio.sleep(STANDS_S)
        await operator.client.steer(vehicle.platform, Verb.RESUME)
        await until(lambda: state(operator, vehicle) == "running", 10.0, "it goes on")
        await until(lambda: state(operator, vehicle) in ("done", "failed"), 300.0, f"it ends; {onboard.text}")
        summary = known(operator, vehicle).mission
        assert summary is not None
        assert summary.value.state == "done", summary.value.reason
        await until(lambda: not is_armed(operator, vehicle), 5.0, "it is disarmed")


def measured(out: Path, vehicle: Vehicle) -> Led:
    """What the log tells of the way."""
    far, edge = vehicle.far_m, vehicle.far_m + vehicle.margin_m
    with LogReader(out / "log.mcap") as reader:
        moving = [
            (entry.envelope.t_s, entry.envelope.payload.state)
            for entry in reader.entries("action_status/*")
            if entry.envelope.payload.action_id.startswith(WAY)
        ]
        poses = [(entry.envelope.t_s, entry.envelope.payload.position_ned_m) for entry in reader.entries("pose")]
        had_pilot = any(entry.envelope.payload.has_pilot_control for entry in reader.entries("driver"))
        fences = [str(entry.envelope.payload.progress) for entry in reader.entries("autopilot_fence")]
    begun_s = next(t_s for t_s, now in moving if now == "paused")
    resumed_s = next(t_s for t_s, now in moving if now == "running" and t_s > begun_s)
    way = [(t_s, place) for t_s, place in poses if moving[0][0] <= t_s <= moving[-1][0]]
    waiting = [place for t_s, place in poses if begun_s <= t_s <= resumed_s]
    corners = [(0.0, 0.0), (far, 0.0), (far, -far), (0.0, -far)]
    nearest = [min((_over_ground_m(place, corner), t_s) for t_s, place in way) for corner in corners[1:]]
    legs = list(pairwise(corners))
    begin_s = moving[0][0]
    if vehicle.is_winged:
        legs, begin_s = legs[1:], nearest[0][1]
    errors = [min(_away_m(place, *leg) for leg in legs) for t_s, place in way if t_s >= begin_s]
    heights = [-place[2] for _, place in poses]
    margin = vehicle.margin_m
    return Led(
        took_s=round(moving[-1][0] - moving[0][0], 1),
        rms_m=round(math.sqrt(sum(error * error for error in errors) / len(errors)), 2),
        most_m=round(max(errors), 2),
        misses_m=[round(distance_m, 2) for distance_m, _ in nearest],
        wait_m=round(max(_over_ground_m(place, waiting[0]) for place in waiting), 2),
        inside_m=round(min(min(n + margin, edge - n, -e + margin, edge + e) for _, (n, e, _) in poses), 1),
        fence=fences[-1] if fences else "",
        home_m=round(_over_ground_m(poses[-1][1], (0.0, 0.0)), 1),
        highest_m=round(max(heights), 2),
        lowest_m=round(min(heights), 2),
        pictures=len(list((out / "images").glob("*.png"))),
        had_pilot=had_pilot,
    )


def _over_ground_m(place: tuple[float, ...], other: tuple[float, ...]) -> float:
    return math.dist(place[:2], other[:2])


def _away_m(place: tuple[float, float, float], begin: tuple[float, float], end: tuple[float, float]) -> float:
    """How far a place is from a straight way, over ground."""
    (an, ae), (bn, be) = begin, end
    length = math.dist(begin, end)
    share = ((place[0] - an) * (bn - an) + (place[1] - ae) * (be - ae)) / length**2
    share = min(1.0, max(0.0, share))
    return math.hypot(place[0] - an - share * (bn - an), place[1] - ae - share * (be - ae))
