"""Commands to autopilots without a companion: MAVSDK's own process behind the station's link, against the simulated vehicle."""

import asyncio
from collections.abc import Callable
from functools import partial

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.codec import Frame, decode
from gloc3_groundstation.links.link import StationLinkCore
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.services.vehicle import VehicleServices

from .test_services_with_sitl import at_hand, simulated, until, vehicle

__all__ = ["vehicle"]
pytestmark = [pytest.mark.sockets, pytest.mark.flight]

HOLDS = {"px4": (4 << 16 | 3 << 24,), "ardupilot": (17,)}
"""Custom modes: AUTO.LOITER, and BRAKE."""
RETURNS = {"px4": (4 << 16 | 5 << 24,), "ardupilot": (6,)}
LANDS = {"px4": (4 << 16 | 6 << 24,), "ardupilot": (9,)}


class Watch:
    """The last message of each name."""

    def __init__(self, link: StationLinkCore) -> None:
        self.last: dict[str, object] = {}
        self.unlisten = link.listen(self._receive)

    def _receive(self, frame: Frame) -> None:
        found = decode(frame)
        if found is not None and (found.name != "HEARTBEAT" or frame.component == 1):
            self.last[found.name] = found

    def field(self, name: str, field: str) -> float:
        return float(getattr(self.last.get(name), field, float("nan")))

    @property
    def mode(self) -> int:
        return int(getattr(self.last.get("HEARTBEAT"), "custom_mode", -1))

    def is_in(self, mode: int) -> bool:
        return self.mode == mode

    @property
    def is_armed(self) -> bool:
        return bool(int(getattr(self.last.get("HEARTBEAT"), "base_mode", 0)) & 128)

    @property
    def height_m(self) -> float:
        return self.field("GLOBAL_POSITION_INT", "relative_alt") * 1e-3


async def accepted(services: VehicleServices, action: Action, *arguments: float, within_s: float = 30.0) -> None:
    """Commands it again while the vehicle is not ready for it."""
    loop = asyncio.get_running_loop()
    end_s = loop.time() + within_s
    while True:
        try:
            await services.actions.act(action, *arguments)
            return
        except Refused:
            if loop.time() > end_s:
                raise
            await asyncio.sleep(0.5)


async def test_every_command_is_carried_out_and_confirmed(vehicle: tuple[str, int]) -> None:
    style, port = vehicle
    async with at_hand(port) as (services, link):
        await services.learn()
        watch = Watch(link)

        async def comes(is_so: Callable[[], bool]) -> None:
            await until(is_so, 40.0)

        with pytest.raises(Refused, match="above 0 and up to 1000 m"):
            await services.actions.act(Action.TAKE_OFF, -3.0)
        await accepted(services, Action.ARM)
        await comes(lambda: watch.is_armed)
        await services.actions.act(Action.DISARM)
        await comes(lambda: not watch.is_armed)
        await accepted(services, Action.ARM)
        await services.actions.act(Action.TAKE_OFF, 5.0)
        await comes(lambda: watch.height_m > 4.0)
        with pytest.raises(Refused, match="is armed"):
            await services.actions.act(Action.REBOOT)
        latitude, longitude = (watch.field("GLOBAL_POSITION_INT", name) * 1e-7 for name in ("lat", "lon"))
        altitude_m = watch.field("GLOBAL_POSITION_INT", "alt") * 1e-3
        await services.actions.act(Action.GO_TO, latitude + 1e-4, longitude, altitude_m, float("nan"))
        await comes(lambda: abs(watch.field("GLOBAL_POSITION_INT", "lat") * 1e-7 - latitude - 1e-4) < 1e-5)
        await services.actions.act(Action.SPEED, 2.0)
        await services.actions.act(Action.HOLD)
        await comes(lambda: watch.mode in HOLDS[style])
        await services.actions.act(Action.RETURN)
        await comes(lambda: watch.mode in RETURNS[style])
        await services.actions.act(Action.LAND)
        await comes(lambda: watch.mode in LANDS[style])
        await comes(lambda: not watch.is_armed)
        with pytest.raises(Refused, match="it has no mode"):
            await services.actions.set_mode("AUTO" if style == "px4" else "FLOAT")
        await services.actions.set_mode("AUTO.LOITER" if style == "px4" else "GUIDED")
        await services.actions.act(Action.REBOOT)
        assert services.actions._mavsdk.dropped > 0


OTHERS: dict[str, dict[Action, int | str]] = {
    "rover": {Action.HOLD: 4, Action.RETURN: 11, Action.LAND: "it does not land: hold stops it"},
    "auv": {Action.HOLD: 2, Action.RETURN: "knows no mode", Action.LAND: 9},
    "plane": {Action.HOLD: 12, Action.RETURN: 11, Action.LAND: 26},
    "quadplane": {Action.HOLD: 12, Action.RETURN: 11, Action.LAND: 20},
}
"""By vehicle: the mode that each command leads to, or why it is refused."""


@pytest.mark.parametrize("name", sorted(OTHERS))
async def test_each_class_of_ardupilot_holds_returns_and_lands_in_its_own_modes(name: str) -> None:
    with simulated("ardupilot", "--vehicle", name) as port:
        async with at_hand(port) as (services, link):
            await services.learn()
            watch = Watch(link)
            for action, expected in OTHERS[name].items():
                if isinstance(expected, str):
                    with pytest.raises(Refused, match=expected):
                        await services.actions.act(action)
                else:
                    await services.actions.act(action)
                    await until(partial(watch.is_in, expected), 20.0)
