"""A flight by commands to the autopilot itself: each one, and what was seen of it."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

from gloc3.errors import Refused
from gloc3.mavlink.codec import Frame, decode
from gloc3.mavlink.flight_modes import mode_name
from gloc3.mavlink.message import MavlinkMessage
from gloc3.mission.formats.items import ForeignPlan, MavItem, PlanEntry
from gloc3_groundstation.api import connect
from gloc3_groundstation.links.link import StationLinkCore
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.services.vehicle import VehicleServices
from gloc3_groundstation.station import wording

NORTH_DEG = 1e-4
"""11 m."""
COMES_S = 60.0
HOLDS = ("AUTO.LOITER", "BRAKE")
RETURNS = ("AUTO.RTL", "RTL", "SMART_RTL")
LANDS = ("AUTO.LAND", "LAND")
MISSIONS = ("AUTO.MISSION", "AUTO")


class Watch:
    """The last message of each name, of the autopilot."""

    def __init__(self, link: StationLinkCore) -> None:
        self.last: dict[str, MavlinkMessage] = {}
        self.unlisten = link.listen(self._receive)

    def _receive(self, frame: Frame) -> None:
        found = decode(frame)
        if found is not None and frame.component == 1:
            self.last[found.name] = found

    def field(self, name: str, field: str) -> float:
        return float(getattr(self.last.get(name), field, float("nan")))

    @property
    def mode(self) -> str:
        beat = self.last.get("HEARTBEAT")
        return "" if beat is None else mode_name(beat.autopilot, beat.type, beat.custom_mode)

    @property
    def is_armed(self) -> bool:
        return bool(int(getattr(self.last.get("HEARTBEAT"), "base_mode", 0)) & 128)

    @property
    def place(self) -> tuple[float, float, float]:
        """Latitude, longitude in degrees, altitude in m."""
        latitude, longitude = (self.field("GLOBAL_POSITION_INT", name) * 1e-7 for name in ("lat", "lon"))
        return latitude, longitude, self.field("GLOBAL_POSITION_INT", "alt") * 1e-3

    @property
    def height_m(self) -> float:
        return self.field("GLOBAL_POSITION_INT", "relative_alt") * 1e-3

    async def comes(self, is_so: Callable[[], bool], within_s: float = COMES_S) -> None:
        async with asyncio.timeout(within_s):
            while not is_so():
                await asyncio.sleep(0.05)

    async def enters(self, modes: tuple[str, ...]) -> str:
        await self.comes(lambda: self.mode in modes)
        return f"mode {self.mode}"


async def patiently(work: Callable[[], Awaitable[None]], within_s: float = 90.0) -> None:
    """Commands it again while the vehicle is not ready for it."""
    loop = asyncio.get_running_loop()
    end_s = loop.time() + within_s
    while True:
        try:
            await work()
            return
        except Refused:
            if loop.time() > end_s:
                raise
            await asyncio.sleep(1.0)


def _plan(latitude: float, longitude: float) -> ForeignPlan:
    items = (
        MavItem(command=22, frame=3, params=(0.0, 0.0, 0.0, None), x=latitude, y=longitude, z=6.0),
        MavItem(command=16, frame=3, params=(0.0, 0.0, 0.0, None), x=latitude + 3.0 * NORTH_DEG, y=longitude, z=6.0),
        MavItem(command=20, frame=2),
    )
    return ForeignPlan(
        entries=tuple(PlanEntry(items=(item,)) for item in items), home=(latitude, longitude, 0.0), raw={}
    )


async def fly(services: VehicleServices, link: StationLinkCore) -> dict[str, str]:
    """Carries every command out once; by command what was seen.

    Raises:
        Refused, TimeoutError: one is not carried out.
    """

    async def act(action: Action, *values: float) -> None:
        try:
            await services.actions.act(action, *values)
        except Refused as refusal:
            raise Refused(f"{action}: {refusal}") from None

    seen: dict[str, str] = {}
    watch = Watch(link)
    await services.learn()
    await patiently(lambda: act(Action.ARM))
    await watch.comes(lambda: watch.is_armed)
    seen["arm"] = "armed"
    await act(Action.DISARM)
    await watch.comes(lambda: not watch.is_armed)
    seen["disarm"] = "disarmed"
    await services.rates.request("GLOBAL_POSITION_INT", 4.0)
    await patiently(lambda: act(Action.TAKE_OFF, 5.0), 60.0)
    await watch.comes(lambda: watch.height_m > 4.0)
    seen["take off to 5 m"] = f"{watch.height_m:.1f} m above home"
    latitude, longitude, altitude_m = watch.place
    await act(Action.GO_TO, latitude + NORTH_DEG, longitude, altitude_m, float("nan"))
    await watch.comes(lambda: abs(watch.place[0] - latitude - NORTH_DEG) < 1e-5)
    seen["go to a place 11 m north"] = f"within {abs(watch.place[0] - latitude - NORTH_DEG) * 111_319.0:.1f} m of it"
    await act(Action.SPEED, 2.0)
    seen["speed of 2 m/s"] = "accepted"
    await act(Action.HOLD)
    seen["hold"] = await watch.enters(HOLDS)
    await services.plans.upload(_plan(latitude, longitude))
    await patiently(lambda: act(Action.START_PLAN), 20.0)
    seen["start the plan"] = await watch.enters(MISSIONS)
    await act(Action.PAUSE_PLAN)
    seen["pause the plan"] = await watch.enters((*HOLDS, "LOITER"))
    seen["restart in the air"] = await _told(act(Action.REBOOT))
    await act(Action.RETURN)
    seen["return"] = await watch.enters(RETURNS)
    await act(Action.LAND)
    seen["land"] = await watch.enters(LANDS)
    await watch.comes(lambda: not watch.is_armed)
    seen["land"] += ", then disarmed"
    mode = "AUTO.LOITER" if watch.mode.startswith("AUTO.") or "PX4" in str(services.snapshots.firmware) else "GUIDED"
    await services.actions.set_mode(mode)
    seen["mode"] = await watch.enters((mode,))
    seen["restart on the ground"] = await _told(act(Action.REBOOT))
    return seen


async def fly_by_script(url: str, folder: Path) -> dict[str, str]:
    """The same by the API for scripts; by command what telemetry showed then.

    Raises:
        Gloc3Error: one is not carried out.
    """
    seen: dict[str, str] = {}
    async with connect(url) as station:
        vehicle = await station.vehicle()

        async def command(text: str) -> None:
            seen[text] = await vehicle.command(text, ready_s=90.0, within_s=COMES_S)

        for text in ("arm", "disarm", "take_off 5"):
            await command(text)
        platform = vehicle.state
        assert platform.vehicle is not None
        assert platform.vehicle.value.geo is not None
        latitude, longitude, _ = platform.vehicle.value.geo
        seen["go to a place 11 m north"] = await vehicle.command(
            f"go_to {latitude + NORTH_DEG:.7f}, {longitude:.7f}, 5"
        )
        for text in ("speed 2", "hold"):
            await command(text)
        file = folder / "there.waypoints"
        rows = ["QGC WPL 110", f"0\t1\t0\t16\t0\t0\t0\t0\t{latitude:.7f}\t{longitude:.7f}\t0\t1"]
        for number, (item, north) in enumerate(((22, 0.0), (16, 3.0 * NORTH_DEG), (20, 0.0)), start=1):
            place = f"{latitude + north:.7f}\t{longitude:.7f}\t6" if item != 20 else "0\t0\t0"
            rows.append(f"{number}\t0\t3\t{item}\t0\t0\t0\t0\t{place}\t1")
        file.write_text("\n".join(rows) + "\n")
        await vehicle.upload(file)
        for text in ("start_plan", "pause_plan"):
            await command(text)
        seen["reboot in the air"] = await _told(vehicle.command("reboot"))
        await vehicle.command("hold")
        seen["hold at once"] = wording.mode(vehicle.state)
        await command("land")
        mode = "Position" if "px4" in vehicle.name else "GUIDED"
        await command(f"mode {mode}")
    return seen


async def _told(work: Awaitable[object]) -> str:
    """What becomes of a command that some autopilots refuse: PX4's simulation has nothing to restart."""
    try:
        await work
    except Refused as refusal:
        return f"refused: {refusal}"
    return "accepted"
