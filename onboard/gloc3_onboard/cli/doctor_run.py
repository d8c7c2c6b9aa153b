"""Checks a vehicle's computer and autopilot without flying: opens the link, listens for a while, makes the list."""

import asyncio
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from gloc3.cli.port_advice import port_advice
from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.mavlink.transport.endpoints import Endpoint
from gloc3.messages.preflight import Check, Group, Verdict, in_order
from gloc3.messages.readiness import LinkCondition, SensorCondition
from gloc3.messages.vehicle import Pose
from gloc3.platform.platform import Platform
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.checks.checklist import checklist
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.cli.direct import beat, heartbeat_of, open_direct, signing_of
from gloc3_onboard.process.computer import HostComputer
from gloc3_onboard.sensors.registry import source_urls
from gloc3_onboard.sensors.rig import calibration_problems
from gloc3_onboard.sensors.sensor_watch import unopened_conditions

POLL_PERIOD_S: Final = 0.1
SETTLED_S: Final = 6.0
"""Time after all has been read for the autopilot to report its sensors, s."""
FRESH_S: Final = 1.0
"""Age above which a position counts as lost, s."""


class DoctorOptions(NamedTuple):
    """Options of `gloc3 doctor`."""

    platform: Platform
    autopilot: str
    out: Path
    wait_s: float
    system_id: int = 1
    folder: Path = Path()
    """Of the platform file."""
    devices: tuple[str, ...] = ()
    """Sources that differ from the platform file's, as NAME=URL."""


async def examine(question: DoctorOptions) -> list[Check]:
    """Makes the list; findings never raise."""
    loop = asyncio.get_running_loop()
    clock = Clock(loop)
    endpoints: list[Endpoint] = []
    computer = HostComputer(
        question.out, clock, links=partial(_conditions, endpoints), sensors=partial(_sensors, question)
    )
    await loop.run_in_executor(None, computer.measure)
    link = AutopilotLink(loop, clock, question.system_id, signing=signing_of(question.autopilot, clock))
    problem = ""
    try:
        endpoint = await open_direct(link, question.autopilot, loop)
    except Refused as refusal:
        problem = str(refusal)
    else:
        endpoints.append(endpoint)
        await _listen(link, loop, question.wait_s)
    try:
        checks = checklist(_readings(question, link, computer, loop.time()))
    finally:
        link.close()
        for one in endpoints:
            await one.close()
    return in_order(_with_port(checks, problem))


def _conditions(endpoints: list[Endpoint]) -> list[LinkCondition]:
    return [
        LinkCondition(
            one.url, "" if one.is_connected else one.problem or "nothing is received there", one.bytes_received
        )
        for one in endpoints
    ]


def _sensors(question: DoctorOptions) -> list[SensorCondition]:
    """How the sensors are, without opening them."""
    platform = question.platform
    used = sorted({device for row in platform.components for device in row.devices.values()})
    urls = source_urls(platform, used, question.devices)
    wrong = calibration_problems(platform, question.folder)
    return unopened_conditions(urls, question.folder, platform.cameras.__contains__, wrong)


async def _listen(link: AutopilotLink, loop: asyncio.AbstractEventLoop, wait_s: float) -> None:
    """Waits until everything has been read and has settled, or the time is up."""
    end_s = loop.time() + wait_s
    read_s: float | None = None
    heart = heartbeat_of(link.own)
    while loop.time() < end_s:
        beat(heart, link, loop.time())
        await asyncio.sleep(POLL_PERIOD_S)
        setup = link.inspection.setup
        if setup.is_complete and setup.sensors_present and link.telemetry.state.is_connected:
            read_s = loop.time() if read_s is None else read_s
            is_ready = link.telemetry.state.is_armable and link.telemetry.pose is not None
            if is_ready or loop.time() - read_s >= SETTLED_S:
                return


def _readings(question: DoctorOptions, link: AutopilotLink, computer: HostComputer, now_s: float) -> Readings:
    stamped, height = link.telemetry.pose, link.telemetry.height
    pose: Pose | None = None
    if stamped is not None:
        own = stamped.pose
        pose = Pose(
            position_ned_m=own.position_ned_m,
            velocity_ned_m_s=own.velocity_ned_m_s,
            ned_from_frd=own.ned_from_frd,
            sources=["autopilot"],
        )
    setup = link.inspection.setup
    return Readings(
        platform=question.platform,
        now_s=now_s,
        autopilot=link.telemetry.state,
        setup=setup if setup.style is not None else None,
        computer=computer.state(),
        pose=pose,
        is_pose_fresh=stamped is not None and now_s - stamped.t_s < FRESH_S,
        height=height.height if height is not None else None,
    )


def _with_port(checks: list[Check], problem: str) -> list[Check]:
    """The checks, with a port that cannot be opened or is silent as an error: there is no flight without it."""
    found = [
        Check(one.group, one.name, Verdict.RED, one.finding, one.advice) if one.name == "port" and one.advice else one
        for one in checks
        if (one.group, one.name) != (Group.COMPUTER, "log")  # nothing records here
    ]
    if problem:
        found.append(Check(Group.COMPUTER, "port", Verdict.RED, problem, port_advice(problem)))
    return found
