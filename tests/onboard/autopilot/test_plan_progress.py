"""Progress on an uploaded plan: what the autopilot says before the plan's first item is set is of the plan before."""

from typing import Any

import pytest

from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.mission_client import CurrentItem, ItemReached, MissionClient, Transfer, Work
from gloc3.mavlink.services.plan import PlanResult
from gloc3.messages.frames import GeoPoint
from gloc3.messages.vehicle import Style
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.formats.items import MavItem
from gloc3_onboard.autopilot.plan_upload import FileUpload, PlanUpload
from gloc3_onboard.sensors.devices import GeoPath

AUTOPILOT = Address(1, 1)
WAY = GeoPath((GeoPoint(47.0, 8.0, 500.0), GeoPoint(47.001, 8.0, 500.0)), 5.0, 2.0, 0.0, None)


def ended(plan: PlanUpload, transfer: Transfer | None) -> Transfer:
    """The transfer under way, ended well."""
    assert transfer is not None
    transfer.result = PlanResult.ACCEPTED
    plan.received(transfer, 1.0)
    return transfer


def test_reports_of_the_plan_before_are_no_progress_on_this_one() -> None:
    plan = PlanUpload(MissionClient(Address(1, 191)))
    plan.begin(7, path=WAY, style=Style.PX4, target=AUTOPILOT, now_s=0.0)
    ended(plan, plan._transfer)
    assert plan._transfer is not None
    plan._transfer.items = plan._items
    clamped = CurrentItem(AUTOPILOT, 2)
    plan.follow(clamped)
    ended(plan, plan._transfer)
    plan.follow(clamped)
    plan.follow(ItemReached(AUTOPILOT, 2))
    assert plan.reached == 0
    ended(plan, plan._setting)
    plan.follow(CurrentItem(AUTOPILOT, 2))
    assert plan.reached == 1
    plan.follow(ItemReached(AUTOPILOT, 2))
    assert plan.reached == 2


@pytest.mark.parametrize("kind", [PlanUpload, FileUpload])
@pytest.mark.parametrize("comes", ["before the next plan begins", "after it has begun"])
def test_that_the_plan_before_has_been_started_is_no_answer_for_this_one(
    kind: type[PlanUpload | FileUpload], comes: str
) -> None:
    client = MissionClient(Address(1, 191))
    plan = kind(client)

    def begin(ticket: int) -> None:
        if isinstance(plan, PlanUpload):
            plan.begin(ticket, path=WAY, style=Style.PX4, target=AUTOPILOT, now_s=0.0)
        else:
            plan.begin(ticket, order=ORDER, continue_at=0, style=Style.PX4, target=AUTOPILOT, now_s=0.0)

    def receive(name: str, **fields: Any) -> None:
        client.receive(message(name, **fields), AUTOPILOT, 0.1)

    def give() -> None:
        """Receives the whole plan, and sends it back."""
        for number in range(len(plan._items)):
            receive("MISSION_REQUEST_INT", seq=number, target_system=1, target_component=191)
        receive("MISSION_ACK", target_system=1, target_component=191)
        assert answers() == []
        receive("MISSION_COUNT", count=len(plan._items), target_system=1, target_component=191)
        for number, item in enumerate(plan._items):
            client.receive(item.message(number, 0, Address(1, 191)), AUTOPILOT, 0.1)
        assert answers() == []

    def answers() -> list[int]:
        found = (plan.received(event, 0.1) for event in client.events() if isinstance(event, Transfer))
        return [ended[0] for ended in found if ended is not None]

    begin(1)
    give()
    if comes == "after it has begun":
        begin(2)
    receive("MISSION_CURRENT", seq=0)
    if comes == "before the next plan begins":
        begin(2)
    assert answers() == [], "it is of the first plan"
    give()
    receive("MISSION_CURRENT", seq=0)
    assert answers() == [2]


ORDER = FlyFileOrder(
    items=(
        MavItem(command=22, frame=3, z=10.0),
        MavItem(command=16, frame=3, x=47.0, y=8.0, z=10.0),
        MavItem(command=177, frame=2, params=(2.0, 1.0, 0.0, 0.0)),
    ),
    home=(47.0, 8.0, 400.0),
)


def begun(style: Style, continue_at: int = 0) -> FileUpload:
    plan = FileUpload(MissionClient(Address(1, 191)))
    plan.begin(7, order=ORDER, continue_at=continue_at, style=style, target=AUTOPILOT, now_s=0.0)
    return plan


def jump_target(plan: FileUpload) -> float:
    return next(item.param1 for item in plan._items if item.command == 177)


def test_items_go_to_either_family_with_its_own_numbers() -> None:
    assert [item.command for item in begun(Style.ARDUPILOT)._items] == [16, 22, 16, 177]
    assert [item.command for item in begun(Style.PX4)._items] == [22, 16, 177]
    assert (jump_target(begun(Style.ARDUPILOT)), jump_target(begun(Style.PX4))) == (2.0, 1.0)


def test_items_that_the_autopilot_holds_are_continued_and_others_sent_again_at_the_same_item() -> None:
    plan = begun(Style.PX4, continue_at=2)
    assert plan._transfer is not None
    assert plan._transfer.work is Work.DOWNLOAD
    plan._transfer.items, plan._transfer.result = plan._items, PlanResult.ACCEPTED
    answer = plan.received(plan._transfer, 1.0)
    assert answer is not None
    assert answer[1].is_accepted
    plan.follow(CurrentItem(AUTOPILOT, 1))
    assert plan.poll().current == 2

    other = begun(Style.PX4, continue_at=2)
    assert other._transfer is not None
    other._transfer.items, other._transfer.result = other._items[:1], PlanResult.ACCEPTED
    assert other.received(other._transfer, 1.0) is None
    assert other._transfer.work is Work.UPLOAD
    other._transfer.result = PlanResult.ACCEPTED
    assert other.received(other._transfer, 2.0) is None
    other._transfer.items, other._transfer.result = other._items, PlanResult.ACCEPTED
    assert other.received(other._transfer, 3.0) is None
    assert other._setting is not None
    assert (other._setting.work, other._setting.number) == (Work.SET_CURRENT, 1)


def test_the_end_of_the_plan_before_is_not_the_end_of_this_one() -> None:
    client = MissionClient(Address(1, 191))
    plan = FileUpload(client)
    client.states[AUTOPILOT] = 5
    plan.begin(7, order=ORDER, continue_at=0, style=Style.PX4, target=AUTOPILOT, now_s=0.0)
    plan._has_begun = True
    assert not plan.poll().is_complete
    client.states[AUTOPILOT] = 3
    assert not plan.poll().is_complete
    client.states[AUTOPILOT] = 5
    assert plan.poll().is_complete
