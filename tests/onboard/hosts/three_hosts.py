"""One vehicle on three hosts, each a network namespace with its own clock: the vehicle, a vision computer, a base station.

The Pelican flies in the hold without satellites, by the pose that it fuses from its odometers; the stereo pair is on the
vision computer, its odometer there or on the base station.
"""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, asynccontextmanager
from datetime import UTC, datetime, timedelta
from math import inf
from pathlib import Path
from typing import Final

from tests.commands.programs import Program, program
from tests.flight.fleet_trial import Command
from tests.onboard.hosts.managed import managed
from tests.onboard.hosts.namespaces import BASE, GROUND, NETS, VEHICLE, VISION, inside, namespaces, relay
from tests.onboard.hosts.patrol import begin, command, mission_state
from tests.onboard.hosts.three_hosts_faults import LANDS, RADIO, Fault, Scene
from tests.onboard.hosts.three_hosts_told import Report, Trial, measured
from tests.onboard.real_vehicle import flights, station, until
from tests.stalls import Watch

from gloc3.exchange.zenoh_session import QUIC
from gloc3.messages.command_interface import Verb
from gloc3.messages.vehicle import LandedState
from gloc3.mission.model.states import ENDED
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.platform.reader import whole_text
from gloc3_groundstation.station.command_client import Declined
from gloc3_groundstation.station.station import Station

A_DAY: Final = timedelta(days=1)
PORT, RELAYED, SENSORS, CAMERAS, AUTOPILOT, STATION, RADIOED = 7447, 7448, 5600, 5601, 14540, 14550, 14551
LEGS: Final = 20
SETTLES_S: Final = 3.0
GOES_ON_S: Final = 45.0
MISSION: Final = """\
mission: along the wall
frame: hold
geofence: {polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}
on_failure: land
on_link_loss: continue
on_low_battery: land
on_pose_lost: land
on_restart: continue
tasks:
  depart: {actions: {up: {take_off: {height_m: 1.5}}}}
  way:
    after: [depart]
    actions:
      way: {follow_waypoints: {waypoints_m: [WAY], speed_m_s: 0.3}}
  recover: {after: [way], actions: {down: {land: {}}}}
"""
HOSTS: Final = f"hosts: {{{VEHICLE}: {{}}, {VISION}: {{on_loss: ignore}}, {BASE}: {{on_loss: hold}}}}\n"
DEVICES: Final = {
    VEHICLE: (
        "imu=autopilot://",
        *(f"{name}=tcp://127.0.0.1:{SENSORS}" for name in ("ground_camera", "tracker_camera", "laser")),
    ),
    VISION: (f"stereo_camera=tcp://{NETS[VISION]}.1:{CAMERAS}",),
}
SPREAD: Final = {"front_cameras": VISION, "features": VISION}
"""Rows that are not on the vehicle, beside the odometer."""


def platform(odometer: str) -> str:
    """The Pelican with `host:` in three rows; it records the ground camera alone, since pictures go to who takes them."""
    text = whole_text("pelican")
    for name, host in {**SPREAD, "stereo_odometry": odometer}.items():
        text = text.replace(f"{{name: {name},", f"{{name: {name}, host: {host},")
    text = text.replace("[camera/ground, camera/front_left, camera/front_right]", "[camera/ground]")
    text = text.replace("[ground, front_left, front_right]", "[ground]")
    return text.replace("components:\n", f"{HOSTS}components:\n", 1)


def simple() -> str:
    """The Pelican with satellites and without cameras; on the base station stands a second limiter by."""
    text = whole_text("pelican_rtk")
    text = text.replace("{name: limiter_standby,", f"{{name: limiter_standby, host: {BASE},")
    return text.replace("components:\n", f"{HOSTS}components:\n", 1)


class ThreeHosts:
    """The hosts, the lines between them, and the vehicle."""

    def __init__(self, scene: Scene, simulator: Program) -> None:
        self.scene, self.simulator = scene, simulator

    def lines(self, text: str) -> int:
        """How many lines of the vehicle hold a text."""
        return sum(text in line for line in self.scene.mains[VEHICLE].lines)

    def lost(self, host: str) -> int:
        """How often a host has been told to be lost."""
        return self.lines(f"host {host} is lost")

    def here(self, host: str) -> int:
        """How often a host has been told to be here."""
        return self.lines(f"host {host} is here")


async def fly(
    folder: Path,
    odometer: str | None,
    faults: tuple[Fault, ...],
    report: Callable[[str], None],
    calm_s: float,
    settle_s: float = SETTLES_S,
) -> Report:
    """Flies with the stereo odometer on a host, and with faults one after the other, after a while without any.

    Args:
        folder: for everything that is written.
        odometer: its host; None to fly without cameras, by satellites.
        faults: one that ends with a landing is the last.
        report: told how far it is.
        calm_s: how long nothing is wrong at first.
        settle_s: how long a mission has to go on, or a vehicle to hold, before that is believed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "p.yaml").write_text(simple() if odometer is None else platform(odometer))
    stalls = Watch()
    async with (
        three_hosts(folder, has_cameras=odometer is not None) as hosts,
        station(f"udpin://{GROUND}.2:{STATION}", 255) as operator,
        _telling(operator, report),
    ):
        started_s = time.monotonic()
        name = await flights.await_platform(operator, None)
        await until(lambda: all(hosts.here(host) for host in NETS), 90.0, "all hosts are here")
        start_s = time.monotonic() - started_s
        await begin(operator, name, MISSION.replace("WAY", ", ".join(["[3, 0, 1.5], [0, 0, 1.5]"] * LEGS)))
        await until(lambda: mission_state(operator, name, "way") == "running", 60.0, "it flies")
        stalls.start()
        calm = time.monotonic(), time.monotonic() + calm_s
        await asyncio.sleep(calm_s)
        trials = []
        for fault in faults:
            trials.append(await _go_through(fault, hosts, operator, name, settle_s))
            report(str(trials[-1]))
        end = "landed"
        if not faults or faults[-1].mission != LANDS:
            await _reported(operator, name, Verb.SKIP)
            await until(lambda: mission_state(operator, name) in ENDED, 120.0, "the mission ends")
            end = mission_state(operator, name)
        for host in (BASE, VISION, VEHICLE):
            await asyncio.to_thread(hosts.scene.mains[host].end)
        hosts.simulator.interrupt()
        await asyncio.to_thread(hosts.simulator.end)
        for host, main in hosts.scene.mains.items():
            (folder / f"{host}.txt").write_text("\n".join(main.lines))
    return measured(folder, odometer or "none", end, calm, start_s, trials, stalls.longest_s)


@asynccontextmanager
async def _telling(operator: Station, report: Callable[[str], None]) -> AsyncIterator[None]:
    """Says in the end what the operator was told, whatever became of the flight."""
    try:
        yield
    finally:
        for event in operator.fleet.events:
            report(f"{event.received_s:.2f} {event.source}: {event.text}")


async def _go_through(fault: Fault, hosts: ThreeHosts, operator: Station, name: str, settle_s: float) -> Trial:
    """One fault, until everything is as before; the operator says resume where the mission is paused."""
    concerned = tuple(NETS) if fault.host == VEHICLE else (fault.host,) if fault.host in NETS else ()
    lost, here = hosts.lost(fault.host), {host: hosts.here(host) for host in concerned}
    life = hosts.scene.mains[VEHICLE].program
    commands = asyncio.create_task(_commands(operator, name)) if fault.host == RADIO else None
    fault.begin(hosts.scene)
    begun_s = time.monotonic()
    await asyncio.sleep(fault.for_s)
    fault.end(hosts.scene)
    ended_s = time.monotonic()
    wrong = []
    try:
        if fault.is_lost:
            await until(lambda: hosts.lost(fault.host) > lost, 10.0, "it is told to be lost")
        if fault.mission == LANDS:
            await until(lambda: _stands(operator, name), 60.0, "it stands")
        if fault.is_lost or hosts.scene.mains[VEHICLE].program is not life:
            await until(
                lambda: all(hosts.here(host) > count for host, count in here.items()), 60.0, "all are here again"
            )
        healed_s = time.monotonic() - ended_s
        sent = await commands if commands is not None else []
        held_at_s = 0.0 if fault.mission == LANDS else await _resumed(operator, name, settle_s)
        is_lost = hosts.lost(fault.host) > lost
    except AssertionError as error:
        wrong.append(str(error))
        healed_s, sent, is_lost, held_at_s = -1.0, [], hosts.lost(fault.host) > lost, 0.0
    return Trial(
        name=fault.name,
        host=fault.host,
        begun_s=begun_s,
        ended_s=ended_s,
        is_lost=is_lost,
        healed_s=round(healed_s, 1),
        held_at_s=held_at_s,
        commands=sent,
        wrong=wrong,
    )


def _stands(operator: Station, name: str) -> bool:
    """Whether a companion that has heard of the autopilot tells that it is down and disarmed."""
    known = operator.fleet.get(name)
    vehicle = None if known is None or known.vehicle is None else known.vehicle.value
    return vehicle is not None and vehicle.landed == LandedState.ON_GROUND and not vehicle.is_armed


async def _resumed(operator: Station, name: str, settle_s: float) -> float:
    """Says resume where the mission is paused, until it has gone on for a while; when that was said last, or 0."""
    reported_s, until_s = 0.0, time.monotonic() + GOES_ON_S
    running_s = inf
    while time.monotonic() < running_s + settle_s:
        assert time.monotonic() < until_s, "the mission does not go on"
        await asyncio.sleep(0.1)
        state = mission_state(operator, name, "way")
        running_s = min(running_s, time.monotonic()) if state == "running" else inf
        if state == "paused" and time.monotonic() > reported_s + settle_s:
            await asyncio.sleep(settle_s)  # what holds shall stand before
            reported_s = time.monotonic()
            await _reported(operator, name, Verb.RESUME)
    return reported_s


async def _reported(operator: Station, name: str, verb: Verb) -> None:
    """Has the mission resumed, or its way skipped; asks again where that is refused: the autopilot is not there yet, say."""
    until_s = time.monotonic() + GOES_ON_S
    while True:
        try:
            await operator.client.steer(name, verb, "way" if verb is Verb.SKIP else "")
        except Declined:
            if time.monotonic() > until_s:
                raise
            await asyncio.sleep(1.0)
            if verb is Verb.SKIP or mission_state(operator, name, "way") == "paused":
                continue
        return


async def _commands(operator: Station, name: str) -> list[Command]:
    """Commands that an operator sends meanwhile, and what he is told of them."""
    sent = []
    for _ in range(12):
        sent.append(asyncio.create_task(command(operator, name, "viewer")))
        await asyncio.sleep(0.6)
    return list(await asyncio.gather(*sent))


@asynccontextmanager
async def three_hosts(folder: Path, *, has_cameras: bool) -> AsyncIterator[ThreeHosts]:
    """The namespaces, the simulated vehicle, the relays, and the three main processes."""
    with ExitStack() as stack:
        stack.enter_context(namespaces())
        _network(folder)
        here = inside(VEHICLE)
        link = f"companion=udpout://127.0.0.1:{AUTOPILOT}"
        sitl = ["sitl", "--link", link, "--out", "truth"]
        sitl += ["--no-gps", "--sensors", str(SENSORS)] if has_cameras else []
        simulator = stack.enter_context(program(*sitl, folder=folder, before=here))
        if has_cameras:
            stack.enter_context(relay(VEHICLE, f"{NETS[VISION]}.1:{CAMERAS}", f"127.0.0.1:{SENSORS}"))
        to_vehicle = f"127.0.0.1:{RELAYED}"
        relays = {
            VISION: stack.enter_context(relay(VISION, to_vehicle, f"{NETS[VISION]}.1:{PORT}")),
            BASE: stack.enter_context(relay(BASE, f"udp/{to_vehicle}", f"{NETS[BASE]}.1:{PORT}")),
            RADIO: stack.enter_context(relay(VEHICLE, f"udp/127.0.0.1:{RADIOED}", f"{GROUND}.2:{STATION}")),
        }
        mains = {}
        for host in (VEHICLE, *NETS):
            words = ["onboard", "p.yaml", "--host", host, "--network", f"net/pelican.{host}/network.yaml"]
            words += ["--out", "out"]
            if host == VEHICLE:
                words += ["--autopilot", f"udpin://127.0.0.1:{AUTOPILOT}", "--station", f"udpout://127.0.0.1:{RADIOED}"]
            for device in DEVICES.get(host, ()) if has_cameras else ():
                words += ["--device", device]
            mains[host] = stack.enter_context(managed(words, folder, inside(host)))
        yield ThreeHosts(Scene(mains, relays), simulator)


def _network(folder: Path) -> None:
    """Network files: the vision computer by TLS, the base station by QUIC, both through relays on their own side."""
    now, reached = datetime.now(UTC), f"127.0.0.1:{RELAYED}"
    listening = {VEHICLE: [f"0.0.0.0:{PORT}", f"{QUIC}0.0.0.0:{PORT}"]}
    register.found(folder / "net", "hold", now, A_DAY)
    for host in (VEHICLE, *NETS):
        entry = register.NetworkMember(
            role=MemberRole.PLATFORM,
            certificate="",
            until="",
            listen=listening.get(host, []),
            reached_at=[reached, f"{QUIC}{reached}"] if host == VEHICLE else [],
        )
        register.add(folder / "net", f"pelican.{host}", entry, now, A_DAY, is_renewed=False)
    for host, other in ((VISION, f', "{QUIC}{reached}"'), (BASE, f'"{reached}", ')):
        file = folder / "net" / f"pelican.{host}" / "network.yaml"
        text = file.read_text()
        assert other in text, text
        file.write_text(text.replace(other, ""))
