"""Brings a fence to the autopilot and reads it back: a pure machine on top of the mission protocol."""

from collections.abc import Sequence

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.mission_client import MissionClient
from gloc3.mavlink.services.plan import PlanItem, PlanType
from gloc3.mission.formats.items import FenceArea, Plan
from gloc3.plan_wire import to_wire
from gloc3_onboard.autopilot.plan_upload import Upload


class FenceUpload(Upload):
    """One fence at a time."""

    def __init__(self, client: MissionClient) -> None:
        super().__init__(client, PlanType.FENCE, "fence")

    def begin(self, ticket: int, areas: Sequence[FenceArea], target: Address, now_s: float) -> None:
        """Sends a fence; without areas the autopilot's fence is cleared."""
        self.send(ticket, fence_items(areas), target, now_s)


def fence_items(areas: Sequence[FenceArea]) -> tuple[PlanItem, ...]:
    """The areas as items of the mission protocol.

    Raises:
        Refused: a number does not fit the wire.
    """
    items = Plan(entries=(), fence=tuple(areas)).fence_items()
    return tuple(to_wire(item, f"fence item {number}") for number, item in enumerate(items))
