"""Commands to autopilots without a companion: MAVSDK's own process behind the station's link, against the simulated vehicle."""

from functools import partial
from pathlib import Path

import pytest

from gloc3.errors import Refused
from gloc3_groundstation.services.actions import Action

from .action_journey import Watch, fly, fly_by_script, patiently
from .test_services_with_sitl import at_hand, simulated, until, vehicle

__all__ = ["vehicle"]
pytestmark = [pytest.mark.sockets, pytest.mark.flight]


async def test_every_command_is_carried_out_and_confirmed(vehicle: tuple[str, int]) -> None:
    _, port = vehicle
    async with at_hand(port) as (services, link):
        with pytest.raises(Refused, match="above 0 and up to 1000 m"):
            await services.actions.act(Action.TAKE_OFF, -3.0)
        with pytest.raises(Refused, match="is no place"):
            await services.actions.act(Action.GO_TO, 147.0, 8.0, 500.0, 0.0)
        seen = await fly(services, link)
        assert len(seen) == 13
        assert "is armed" in seen["restart in the air"]
        assert seen["restart on the ground"] == "accepted"
        with pytest.raises(Refused, match="it has no mode"):
            await services.actions.set_mode("FLOAT")


async def test_every_command_is_carried_out_by_a_script(vehicle: tuple[str, int], tmp_path: Path) -> None:
    _, port = vehicle
    seen = await fly_by_script(f"udpout://127.0.0.1:{port}", tmp_path)
    assert len(seen) == 12
    assert "is armed" in seen["reboot in the air"]


OTHERS: dict[str, dict[Action, int | str]] = {
    "rover": {Action.HOLD: 4, Action.RETURN: 11, Action.LAND: "hold stops it"},
    "auv": {Action.HOLD: 2, Action.RETURN: "hold stops it", Action.LAND: 9},
    "plane": {Action.HOLD: 12, Action.RETURN: 11, Action.LAND: "it does not fly"},
    "quadplane": {Action.HOLD: 12, Action.RETURN: 11, Action.LAND: 20},
}
"""By vehicle: the mode that each command leads to, or why it is refused."""


def is_in(watch: Watch, mode: int) -> bool:
    return watch.field("HEARTBEAT", "custom_mode") == mode


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
                    await patiently(partial(services.actions.act, action), 30.0)  # it may be without a position yet
                    await until(partial(is_in, watch, expected), 20.0)


@pytest.mark.parametrize("is_armed", [False, True])
async def test_a_refused_take_off_leaves_the_vehicle_as_it_was(is_armed: bool) -> None:
    with simulated("ardupilot", "--vehicle", "rover") as port:
        async with at_hand(port) as (services, link):
            await services.learn()
            watch = Watch(link)
            await patiently(partial(services.actions.set_mode, "GUIDED"), 30.0)
            if is_armed:
                await patiently(partial(services.actions.act, Action.ARM))
                await until(lambda: watch.is_armed, 20.0)
            with pytest.raises(Refused, match="cannot do it; it ") as refusal:
                await patiently(partial(services.actions.act, Action.TAKE_OFF, 5.0), 0.0)
            left = "it is armed" if is_armed else "it was armed for it, and disarmed again"
            assert str(refusal.value).endswith(left)
            await until(lambda: watch.is_armed is is_armed, 20.0)
