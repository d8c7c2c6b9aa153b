"""The autopilot's home: set by DO_SET_HOME, and read back."""

from math import hypot
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import MavCommandClient
from gloc3.mavlink.services.interval import REQUEST_MESSAGE
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3_groundstation.services.actions import ActionService
from gloc3_groundstation.services.machines import Machines

DO_SET_HOME: Final = 179
HOME_POSITION: Final = 242
GLOBAL: Final = 0
"""MAV_FRAME: altitudes above the sea."""
READ_BACK_S: Final = 4.0
"""Longest time for the new home to be reported, s."""
SAME_M: Final = 0.5


class HomeReport(msgspec.Struct, frozen=True):
    """A home position that a component has reported."""

    sender: Address
    place: GeoPoint


class HomeReceiver(Microservice[HomeReport]):
    """Receives home positions; each is returned as an event."""

    handles = frozenset({"HOME_POSITION"})

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Handles a HOME_POSITION."""
        del now_s
        place = GeoPoint(message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3)
        self._events.append(HomeReport(sender, place))


class HomeService:
    """Sets the home of one autopilot.

    Args:
        machines: run the clients, a `HomeReceiver` among them.
        commands: sends the commands.
        actions: explains refusals by the autopilot's own reasons.
        target: the autopilot.
    """

    def __init__(self, machines: Machines, commands: MavCommandClient, actions: ActionService, target: Address) -> None:
        self._machines, self._commands, self._actions, self._target = machines, commands, actions, target
        self._reported: GeoPoint | None = None
        machines.on_event(self._receive_event)

    async def set(self, place: GeoPoint) -> None:
        """Moves home, and returns when the autopilot reports it there.

        Raises:
            Refused: it is no place on Earth, or the autopilot refuses, does not answer, or reports another home.
        """
        if not (abs(place.latitude_deg) <= 90.0 and abs(place.longitude_deg) <= 180.0 and abs(place.altitude_m) < 1e4):
            raise Refused(
                f"{place.latitude_deg:g}, {place.longitude_deg:g}, {place.altitude_m:g} m is no place on Earth"
            )
        machines, begin_s = self._machines, self._machines.now_s
        position = round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7), place.altitude_m
        call = self._commands.send_int(self._target, DO_SET_HOME, frame=GLOBAL, position=position, now_s=begin_s)
        try:
            await machines.until(lambda: call.result is not None)
        finally:
            self._commands.abandon(call)
        if call.result is not CommandResult.ACCEPTED:
            words = call.result.words if call.result is not None else "cancelled"
            raise Refused(await self._actions.explained(words, begin_s))
        await self._read_back(place)

    async def _read_back(self, place: GeoPoint) -> None:
        machines, self._reported = self._machines, None
        end_s = machines.now_s + READ_BACK_S
        request = self._commands.send_long(self._target, REQUEST_MESSAGE, (HOME_POSITION,), now_s=machines.now_s)
        timer = machines.loop.call_at(end_s, machines.settle)
        try:
            await machines.until(lambda: self._is_at(place) or machines.now_s >= end_s)
        finally:
            timer.cancel()
            self._commands.abandon(request)
        if not self._is_at(place):
            found = "is not reported"
            if self._reported is not None:
                found = f"is reported {_distance_m(place, self._reported):.1f} m away"
            raise Refused(f"the autopilot has accepted it, but its home {found}")

    def _is_at(self, place: GeoPoint) -> bool:
        return self._reported is not None and _distance_m(place, self._reported) <= SAME_M

    def _receive_event(self, event: object) -> None:
        if isinstance(event, HomeReport) and event.sender == self._target:
            self._reported = event.place


def _distance_m(place: GeoPoint, other: GeoPoint) -> float:
    """Distance in three dimensions."""
    return hypot(*TangentPlane(place).ned_from_geo(*other))
