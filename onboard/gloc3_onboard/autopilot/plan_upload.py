"""Uploads a plan to the autopilot, reads it back, and follows its progress: mission protocol without I/O."""

from collections.abc import Iterator, Sequence
from itertools import accumulate
from typing import Final

import msgspec

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.mission_client import CurrentItem, ItemReached, MissionClient, Transfer
from gloc3.mavlink.services.plan import PlanItem, PlanResult, PlanType
from gloc3.messages.frames import GeoPoint
from gloc3.messages.vehicle import Style
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.formats.commands import command_name
from gloc3.mission.formats.items import FenceArea, ForeignPlan, MavItem
from gloc3.plan_wire import mission_to_wire, to_wire
from gloc3_onboard.sensors.devices import CommandAnswer, FileProgress, GeoPath, VtolWay

ABSOLUTE, NO_PLACE, RELATIVE = 0, 2, 3
"""MAV_FRAME: heights above mean sea level, none, above home."""
WAYPOINT, STAY, STAY_FOR_A_TIME, TAKE_OFF, CHANGE_SPEED = 16, 17, 19, 22, 178
VTOL_TAKE_OFF, VTOL_TRANSITION = 84, 3000
ON_ROTORS, ON_WINGS = 3.0, 4.0
"""MAV_VTOL_STATE."""
AIR_SPEED, GROUND_SPEED = 0.0, 1.0
SAME_HEIGHT_M: Final = 0.02
"""ArduPilot keeps heights in whole centimetres."""

COMPLETE, ACTIVE = 5, 3
"""MISSION_STATE."""
SAME_PLACE: Final = 1
"""A unit of the wire's positions: about a centimetre."""


class PlanUploader:
    """Upload of one plan at a time; a newer one replaces one under way.

    Args:
        client: the mission protocol; driven by its owner.
        kind: kind of plan.
        words: its name in answers.
    """

    def __init__(self, client: MissionClient, kind: PlanType, words: str) -> None:
        self._client, self._kind, self._words = client, kind, words
        self._items: tuple[PlanItem, ...] = ()
        self._ticket = 0
        self._transfer: Transfer | None = None
        self._setting: Transfer | None = None
        """Sets the first item of a plan that has been read back."""
        self._is_reading = False

    def send(self, ticket: int, items: tuple[PlanItem, ...], target: Address, now_s: float) -> None:
        """Sends a plan; without items the autopilot's is cleared."""
        self._cancel(now_s)
        self._items, self._ticket, self._is_reading = items, ticket, False
        if items:
            self._transfer = self._client.upload(target, items, now_s=now_s, kind=self._kind)
        else:
            self._transfer = self._client.clear(target, now_s=now_s, kind=self._kind)

    def read(self, ticket: int, items: tuple[PlanItem, ...], target: Address, now_s: float) -> None:
        """Reads the autopilot's plan and compares it with this one, without sending it."""
        self._cancel(now_s)
        self._items, self._ticket, self._is_reading = items, ticket, True
        self._transfer = self._client.download(target, now_s=now_s, kind=self._kind)

    def _cancel(self, now_s: float) -> None:
        """Cancels the plan before, so that none of its transfers answers for this one."""
        for transfer in (self._transfer, self._setting):
            if transfer is not None and transfer.result is None:
                self._client.cancel(transfer, now_s)
        self._setting = None

    def received(self, transfer: Transfer, now_s: float) -> tuple[int, CommandAnswer] | None:
        """A transfer has ended: the ticket and its answer once the plan is read back, or could not be sent."""
        if transfer is not self._transfer or transfer.result is None:
            return None
        if transfer.result is not PlanResult.ACCEPTED:
            doing = "read back" if self._is_reading else "uploaded"
            index = None if self._is_reading else transfer.refused_index
            item = "" if index is None else f"{self._item_name(index)}: "
            return self._ticket, CommandAnswer(
                False, f"the {self._words} could not be {doing}: {item}{transfer.result.words}"
            )
        if not self._is_reading:
            self._is_reading = True
            self._transfer = self._client.download(transfer.target, now_s=now_s, kind=self._kind)
            return None
        if not self._is_same(transfer.items):
            return self._ticket, CommandAnswer(False, f"the autopilot read back another {self._words} than was sent")
        return self._ticket, CommandAnswer(True, "")

    def _item_name(self, index: int) -> str:
        """An item for people."""
        return f"item {index + 1}, {command_name(self._items[index].command)}"

    def _is_same(self, held: Sequence[PlanItem]) -> bool:
        """Whether all that must be is the same: an autopilot may change frame and flags."""
        return [(one.command, one.param1, one.x, one.y) for one in held] == [
            (one.command, one.param1, one.x, one.y) for one in self._items
        ]


class PlanUpload(PlanUploader):
    """Upload of a path's plan, and the autopilot's progress on it."""

    def __init__(self, client: MissionClient) -> None:
        super().__init__(client, PlanType.MISSION, "plan")
        self.reached = 0
        """Number of positions of the path that the autopilot has passed."""
        self._begin = self._first = 0
        """Its first item, and the first one that is flown to."""
        self._passed: tuple[int, ...] = (0,)
        """How many places are passed while each item from the first is flown, and after the last one."""
        self._has_begun = False
        """What the autopilot says of its progress is of this plan: until the first item is set it is of the one before."""

    def begin(self, ticket: int, *, path: GeoPath, style: Style, target: Address, now_s: float) -> None:
        """Sends the plan of a path.

        Raises:
            Refused: a number does not fit the wire.
        """
        items = path_items(path, style)
        planned = plan_of(path, style)
        self._begin = int(style is Style.ARDUPILOT)
        self._first = self._begin + next(number for number, (item, _) in enumerate(planned) if item.frame != NO_PLACE)
        self._passed, self.reached = tuple(accumulate((passes for _, passes in planned), initial=0)), 0
        self._has_begun = False
        self.send(ticket, items, target, now_s)

    def received(self, transfer: Transfer, now_s: float) -> tuple[int, CommandAnswer] | None:
        """Starts the verified plan at its first item, wherever the autopilot was in the previous one."""
        if transfer is not self._setting:
            ended = super().received(transfer, now_s)
            if ended is None or not ended[1].is_accepted:
                return ended
            self._setting = self._client.set_current(transfer.target, self._begin, now_s=now_s)
            return None
        if transfer.result is None:
            return None
        current = self._client.current.get(transfer.target)  # ArduPilot goes on to the first place at once
        if transfer.result is PlanResult.ACCEPTED or current == self._first:
            self._has_begun = True
            return self._ticket, CommandAnswer(True, "")
        return self._ticket, CommandAnswer(False, f"the plan could not be started: {transfer.result.words}")

    def follow(self, event: CurrentItem | ItemReached) -> None:
        """Handles the autopilot's progress; a later report makes up for a lost one."""
        number = event.number - self._begin + isinstance(event, ItemReached)
        if self._has_begun and number >= 0:
            self.reached = max(self.reached, self._passed[min(number, len(self._passed) - 1)])

    def _is_same(self, held: Sequence[PlanItem]) -> bool:
        """Whether the plans match; ArduPilot has its own home as first item, and keeps only the value of a speed."""
        if len(held) != len(self._items) or any(
            one.command != sent.command for one, sent in zip(held[1:], self._items[1:], strict=True)
        ):
            return False
        return all(
            (one.x, one.y) == (sent.x, sent.y) and abs(one.z - sent.z) <= SAME_HEIGHT_M
            for one, sent in zip(held[self._first :], self._items[self._first :], strict=True)
        )


def path_items(way: GeoPath, style: Style) -> tuple[PlanItem, ...]:
    """A way as items of the mission protocol: `plan_of`, and before that ArduPilot's home.

    Raises:
        Refused: a number does not fit the wire.
    """
    items = [item for item, _ in plan_of(way, style)]
    if style is Style.ARDUPILOT:
        items = [_at(way.places[0], WAYPOINT), *items]
    return tuple(to_wire(item, f"plan item {number}") for number, item in enumerate(items))


def plan_of(way: GeoPath, style: Style) -> tuple[tuple[MavItem, bool], ...]:
    """The items of a way, each with whether one more of its places is passed once it is done.

    What flies on wings ends in a circle round its last place, until it is told otherwise. What has rotors, too, begins with
    the form of the way, leaves its wings before the last place, and hovers there.
    """
    kind = AIR_SPEED if way.is_winged else GROUND_SPEED
    speed = _instant(CHANGE_SPEED, kind, way.speed_m_s, -1.0)
    places = [(_waypoint(place, way), True) for place in way.places]
    if way.vtol is not None:
        return tuple(_vtol_plan(way, way.vtol, (speed, False), places, style))
    if way.is_from_ground:
        places[0] = (_at(way.places[0], TAKE_OFF), True)
    ends = [(_at(way.places[-1], STAY), False)] if way.is_winged else []
    return ((speed, False), *places, *ends)


PlannedItem = tuple[MavItem, bool]


def _vtol_plan(
    way: GeoPath, vtol: VtolWay, speed: PlannedItem, places: list[PlannedItem], style: Style
) -> Iterator[PlannedItem]:
    last = way.places[-1]
    if way.is_from_ground:
        if style is Style.ARDUPILOT:  # it would go on on wings; its height counts from where it stands
            yield _instant(VTOL_TRANSITION, ON_ROTORS), False
            yield msgspec.structs.replace(_at(last, VTOL_TAKE_OFF), frame=RELATIVE, z=vtol.climb_m), True
        else:
            yield _at(last, TAKE_OFF), True
    else:
        yield _instant(VTOL_TRANSITION, ON_WINGS if vtol.on_wings else ON_ROTORS), False
        yield speed
        yield from places[:-1]
        if vtol.on_wings and vtol.hovers:
            if vtol.brakes_at is not None:
                yield _waypoint(vtol.brakes_at, way), False
            yield _instant(VTOL_TRANSITION, ON_ROTORS), False
            yield _at(last, WAYPOINT, way.hold_s, vtol.within_m), True
        else:
            yield places[-1]
    yield _at(last, STAY), False


def _instant(command: int, one: float, two: float = 0.0, three: float = 0.0) -> MavItem:
    return MavItem(command=command, frame=NO_PLACE, params=(one, two, three, 0.0))


def _waypoint(place: GeoPoint, way: GeoPath) -> MavItem:
    if way.is_winged and way.hold_s > 0.0:
        return _at(place, STAY_FOR_A_TIME, way.hold_s)
    return _at(place, WAYPOINT, way.hold_s, way.acceptance_m, 0.0, way.heading_deg)


def _at(
    place: GeoPoint, command: int, one: float = 0.0, two: float = 0.0, three: float = 0.0, four: float | None = 0.0
) -> MavItem:
    return MavItem(
        command=command,
        frame=ABSOLUTE,
        params=(one, two, three, four),
        x=place.latitude_deg,
        y=place.longitude_deg,
        z=place.altitude_m,
    )


class FileUpload(PlanUploader):
    """Upload of the items of a plan, unchanged."""

    def __init__(self, client: MissionClient) -> None:
        super().__init__(client, PlanType.MISSION, "plan")
        self.progress = FileProgress()
        self._begin = 0
        self._behind = 0
        """How much less an item's number on the wire is than in the file."""
        self._is_checking = False
        """It is read whether the autopilot has the items already."""
        self._has_begun = self._was_active = False
        self._target: Address | None = None

    def begin(
        self, ticket: int, *, order: FlyFileOrder, continue_at: int, style: Style, target: Address, now_s: float
    ) -> None:
        """Sends the items, unless it is to be continued and the autopilot has them already.

        Raises:
            Refused: a number does not fit the wire.
        """
        has_home = style is Style.ARDUPILOT
        items = mission_to_wire(order.items, order.home, has_home=has_home)
        self._behind, self._target = int(not has_home), target
        self._begin = max(int(has_home), continue_at - self._behind)
        self._has_begun = self._was_active = False
        self.progress = FileProgress()
        if continue_at:
            self._is_checking = True
            self.read(ticket, items, target, now_s)
        else:
            self._is_checking = False
            self.send(ticket, items, target, now_s)

    def received(self, transfer: Transfer, now_s: float) -> tuple[int, CommandAnswer] | None:
        """Begins the verified plan at its first item, or leaves one that is there already where it is."""
        if transfer is self._setting:
            return self._is_set(transfer)
        ended = super().received(transfer, now_s)
        if ended is None:
            return None
        if self._is_checking:
            self._is_checking = False
            if ended[1].is_accepted:
                self._has_begun = True
                return ended
            self.send(self._ticket, self._items, transfer.target, now_s)
            return None
        if ended[1].is_accepted:
            self._setting = self._client.set_current(transfer.target, self._begin, now_s=now_s)
            return None
        return ended

    def _is_set(self, transfer: Transfer) -> tuple[int, CommandAnswer] | None:
        if transfer.result is None:
            return None
        current = self._client.current.get(transfer.target, -1)
        if transfer.result is PlanResult.ACCEPTED or current > self._begin:  # it went on past items that take no time
            self._has_begun = True
            return self._ticket, CommandAnswer(True, "")
        return self._ticket, CommandAnswer(False, f"the plan could not be started: {transfer.result.words}")

    def follow(self, event: CurrentItem | ItemReached) -> None:
        """Handles the autopilot's progress."""
        if not self._has_begun:
            return
        number = event.number + self._behind
        if isinstance(event, ItemReached):
            self.progress = self.progress._replace(reached=number)
        else:
            self.progress = self.progress._replace(current=number)

    def poll(self) -> FileProgress:
        """The progress, and whether the autopilot says now that all is done; an older report of the end does not count."""
        state = self._client.states.get(self._target, 0) if self._target is not None else 0
        self._was_active |= self._has_begun and state == ACTIVE
        return self.progress._replace(is_complete=self._was_active and state == COMPLETE)

    def _item_name(self, index: int) -> str:
        """An item with its number in the file."""
        return f"item {index + self._behind}, {command_name(self._items[index].command)}"

    def _is_same(self, held: Sequence[PlanItem]) -> bool:
        """Whether the autopilot holds these items; it has its own home, and rounds heights and parameters."""
        first = self._behind == 0
        return len(held) == len(self._items) and all(
            _is_same_item(one, sent) for one, sent in zip(held[first:], self._items[first:], strict=True)
        )


def _is_same_item(held: PlanItem, sent: PlanItem) -> bool:
    if held.command != sent.command:
        return False
    if not (sent.x or sent.y):
        return True
    is_near = abs(held.x - sent.x) <= SAME_PLACE and abs(held.y - sent.y) <= SAME_PLACE
    return is_near and abs(held.z - sent.z) <= SAME_HEIGHT_M


class FenceUpload(PlanUploader):
    """One fence at a time."""

    def __init__(self, client: MissionClient) -> None:
        super().__init__(client, PlanType.FENCE, "fence")
        self.is_set = False
        """Whether the latest one is a fence, and not the clearing of one."""

    def begin(self, ticket: int, areas: Sequence[FenceArea], target: Address, now_s: float) -> None:
        """Sends a fence; without areas the autopilot's fence is cleared."""
        self.is_set = bool(areas)
        self.send(ticket, fence_items(areas), target, now_s)


def fence_items(areas: Sequence[FenceArea]) -> tuple[PlanItem, ...]:
    """The areas as items of the mission protocol.

    Raises:
        Refused: a number does not fit the wire.
    """
    items = ForeignPlan(entries=(), fence=tuple(areas)).fence_items()
    return tuple(to_wire(item, f"fence item {number}") for number, item in enumerate(items))
