"""The terminal with a bare vehicle behind a memory link, whose services a scripted vehicle gives."""

import asyncio
import random
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from pathlib import Path

from tests.groundstation.services.scripted_vehicle import PX4, TOPICS, VEHICLE, Logs, ScriptedVehicle
from textual.widgets import ContentSwitcher

from gloc3.exchange import LocalExchange
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.parameter import Parameter, ParameterType, parameter
from gloc3.mavlink.transport.memory import PERFECT, Conditions, MemoryLink
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.services_desk import ServicesDesk
from gloc3_groundstation.links.link import LinkContext, StationLinkCore
from gloc3_groundstation.services.machines import Wire
from gloc3_groundstation.station import fleet as reducers
from gloc3_groundstation.station.snapshots import AutopilotSnapshot, Fleet, PlatformSnapshot, Timed
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.configuration import Configuration
from gloc3_groundstation.tui.app import StationApp

from .scripted_platform import VEHICLE as SUMMARY
from .scripted_platform import ScriptedPlatform
from .station_scene import Scene

NAME = "px4-1"
TIMEOUT_S = 20.0
PARAMETERS = [
    parameter("COM_ARM_WO_GPS", 1, ParameterType.INT32),
    parameter("EKF2_GPS_CHECK", 245, ParameterType.INT32),
    parameter("MPC_XY_VEL_MAX", 12.0, ParameterType.REAL32),
    parameter("MPC_Z_VEL_MAX_UP", 3.0, ParameterType.REAL32),
    parameter("NAV_DLL_ACT", 0, ParameterType.INT32),
    parameter("RTL_RETURN_ALT", 60.0, ParameterType.REAL32),
    *(parameter(f"CAL_ACC{n}_ID", 1310988 + n, ParameterType.INT32) for n in range(30)),
]
INFOS = """{"parameters": [
{"name": "MPC_XY_VEL_MAX", "shortDesc": "Maximum horizontal velocity", "units": "m/s", "min": 0, "max": 20, "default": 12,
 "increment": 1, "decimalPlaces": 2, "group": "Multicopter Position Control", "type": "Float",
 "longDesc": "If the velocity setpoint is above this value it is capped, also when the stick is at its end."},
{"name": "NAV_DLL_ACT", "shortDesc": "Set data link loss failsafe mode", "default": 2, "group": "Commander", "type": "Int32",
 "rebootRequired": true, "values": [{"value": 0, "description": "Disabled"}, {"value": 1, "description": "Hold mode"},
 {"value": 2, "description": "Return mode"}, {"value": 3, "description": "Land mode"}]},
{"name": "EKF2_GPS_CHECK", "shortDesc": "Integer bitmask controlling GPS checks", "default": 245, "group": "EKF2",
 "type": "Int32", "bitmask": [{"index": 0, "description": "Min sat count"}, {"index": 2, "description": "Min PDOP"}]},
{"name": "RTL_RETURN_ALT", "shortDesc": "Return mode return altitude", "units": "m", "min": 0, "max": 1000, "default": 60,
 "group": "Return Mode", "type": "Float"}]}"""


class ServicesScene(Scene):
    """A terminal scene with the vehicle behind it."""

    vehicle: ScriptedVehicle
    memory: MemoryLink
    services: ServicesDesk

    async def wait(self, is_so: Callable[[], bool]) -> None:
        """Waits in wall time, as the vehicle's answers come in it."""
        loop = asyncio.get_running_loop()
        ends_s = loop.time() + TIMEOUT_S
        while not is_so():
            if loop.time() > ends_s:
                raise AssertionError("it never came to that")
            await self.pilot.pause(0.01)

    async def tab(self, title: str) -> None:
        """Goes on to the service of a title."""
        for _ in ServiceKind:
            base = self.app.base
            assert base is not None
            panes = base.query_one("#service_panes", ContentSwitcher)
            before = panes.current
            if before == title.lower():
                return
            await self.press("tab")
            await self.wait(lambda before=before, panes=panes: panes.current != before)  # type: ignore[misc]
        raise AssertionError(f"there is no {title}")


@asynccontextmanager
async def services_scene(
    size: tuple[int, int] = (80, 24),
    configuration: Configuration = Configuration(),  # noqa: B008 - immutable
    *,
    conditions: Conditions = PERFECT,
    parameters: Iterable[Parameter] = PARAMETERS,
    logs: Logs | None = None,
    folder: Path | None = None,
    downloads: Path = Path(),
    autopilot: int = PX4,
) -> AsyncIterator[ServicesScene]:
    """The services screen of a vehicle without a companion."""
    loop = asyncio.get_running_loop()
    exchange, memory = LocalExchange(), MemoryLink(loop, random.Random(5), conditions)
    vehicle = ScriptedVehicle(
        loop, memory, autopilot=autopilot, parameters=parameters, logs=logs or Logs(), folder=folder
    )
    link = StationLinkCore(memory.a.send, LinkContext(loop=loop, exchange=exchange, topics=TOPICS, boot=1))
    memory.a.on_data = link.receive
    station = Station(exchange, loop, "255", 11)

    def reach(name: str) -> tuple[Wire, Address]:
        assert name == NAME
        return link, VEHICLE

    services = ServicesDesk(station, reach, downloads)
    app = StationApp(Desk(station, services=services), configuration)

    def received(fleet: Fleet, now_s: float) -> Fleet:
        bare = PlatformSnapshot(
            name=NAME,
            boot=0,
            first_received_s=now_s,
            received_s=now_s + 1000,
            vehicle=Timed(SUMMARY, now_s + 1000),
            has_companion=False,
            autopilot=AutopilotSnapshot(link="udpin://0.0.0.0:14550", system=1, component=1, firmware="PX4"),
        )
        return reducers.with_platform(fleet, bare)

    station.change(received)
    async with app.run_test(size=size) as pilot:
        here = ServicesScene(app, pilot, ScriptedPlatform(exchange), station, exchange)
        here.vehicle, here.memory, here.services = vehicle, memory, services
        await here.wait(lambda: here.is_shown(app.current_mode))
        await here.go("6")
        try:
            yield here
        finally:
            await services.close()
            station.close()
            link.close()
            vehicle.runner.stop()
