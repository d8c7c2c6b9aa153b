"""Brings a fence to the autopilot and reads it back: a pure machine on top of the mission protocol."""

from collections.abc import Sequence

from gloc3.link.message import Address
from gloc3.link.mission_client import MissionClient, Transfer
from gloc3.link.plan import PlanItem, PlanResult, PlanType
from gloc3.mission.formats.items import FenceArea, Plan
from gloc3.plan_wire import to_wire
from gloc3_onboard.devices import Answer

_FENCE = PlanType.FENCE


class FenceUpload:
    """One fence at a time; a newer one takes the place of one that is under way."""

    def __init__(self, client: MissionClient) -> None:
        self._client = client
        self._items: tuple[PlanItem, ...] = ()
        self._ticket = 0
        self._transfer: Transfer | None = None
        self._is_reading = False

    def begin(self, ticket: int, areas: Sequence[FenceArea], target: Address, now_s: float) -> None:
        """Sends a fence; without areas the autopilot's fence is cleared."""
        if self._transfer is not None and self._transfer.result is None:
            self._client.cancel(self._transfer, now_s)
        self._items = fence_items(areas)
        self._ticket, self._is_reading = ticket, False
        if self._items:
            self._transfer = self._client.upload(target, self._items, now_s=now_s, kind=_FENCE)
        else:
            self._transfer = self._client.clear(target, now_s=now_s, kind=_FENCE)

    def heard(self, transfer: Transfer, now_s: float) -> tuple[int, Answer] | None:
        """A transfer has ended: the ticket and its answer once the fence is read back, or could not be sent."""
        if transfer is not self._transfer or transfer.result is None:
            return None
        if transfer.result is not PlanResult.ACCEPTED:
            doing = "read back" if self._is_reading else "uploaded"
            return self._ticket, Answer(False, f"the fence could not be {doing}: {transfer.result.words}")
        if not self._is_reading:
            self._is_reading = True
            self._transfer = self._client.download(transfer.target, now_s=now_s, kind=_FENCE)
            return None
        if [_essence(item) for item in transfer.items] != [_essence(item) for item in self._items]:
            return self._ticket, Answer(False, "the autopilot holds another fence than the one that was sent")
        return self._ticket, Answer(True, "")


def fence_items(areas: Sequence[FenceArea]) -> tuple[PlanItem, ...]:
    """The areas as items of the mission protocol.

    Raises:
        Refused: a number does not fit the wire.
    """
    items = Plan(entries=(), fence=tuple(areas)).fence_items()
    return tuple(to_wire(item, f"fence item {number}") for number, item in enumerate(items))


def _essence(item: PlanItem) -> tuple[int, float, int, int]:
    """What must be the same: an autopilot may change frame and flags."""
    return item.command, item.param1, item.x, item.y
