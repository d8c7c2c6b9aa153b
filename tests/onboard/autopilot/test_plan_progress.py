"""Progress on an uploaded plan: what the autopilot says before the plan's first item is set is of the plan before."""

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.mission_client import CurrentItem, ItemReached, MissionClient, Transfer
from gloc3.mavlink.services.plan import PlanResult
from gloc3.messages.frames import GeoPoint
from gloc3.messages.vehicle import Style
from gloc3_onboard.autopilot.plan_upload import PlanUpload
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
    plan.begin(7, WAY, Style.PX4, AUTOPILOT, 0.0)
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
