"""Uploads the items of another program's plan, and follows the autopilot's progress on them; no I/O."""

from collections.abc import Sequence
from typing import Final

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.mission_client import CurrentItem, ItemReached, MissionClient, Transfer
from gloc3.mavlink.services.plan import PlanItem, PlanResult, PlanType
from gloc3.messages.vehicle import Style
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.plan_wire import mission_to_wire
from gloc3_onboard.autopilot.plan_upload import SAME_HEIGHT_M, PlanUploader
from gloc3_onboard.sensors.devices import CommandAnswer, FileProgress

COMPLETE, ACTIVE = 5, 3
"""MISSION_STATE."""
SAME_PLACE: Final = 1
"""A unit of the wire's positions: about a centimetre."""


class FileUpload(PlanUploader):
    """Upload of the items of a plan, unchanged."""

    def __init__(self, client: MissionClient) -> None:
        super().__init__(client, PlanType.MISSION, "plan")
        self.progress = FileProgress()
        self._setting: Transfer | None = None
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
        self._setting = None
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
