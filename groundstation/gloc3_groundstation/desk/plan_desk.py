"""Plans on the desk: download, open a file, upload, verify, save, clear."""

from pathlib import Path

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.codec import enum_name
from gloc3.mission.formats.items import ForeignPlan
from gloc3_groundstation.desk.service_jobs import JobStarter, ServiceKind
from gloc3_groundstation.services.plan_items import PlanDifference
from gloc3_groundstation.services.plans import PlanService, VehiclePlan
from gloc3_groundstation.services.progress import OnProgress


class PlanFile(msgspec.Struct, frozen=True, kw_only=True):
    """A plan that was opened."""

    name: str
    plan: ForeignPlan


class PlanDesk:
    """Plans of one vehicle on the desk.

    Args:
        begin: begins what takes time.
        service: of the vehicle.
    """

    def __init__(self, begin: JobStarter, service: PlanService) -> None:
        self.found: VehiclePlan | None = None
        """The plan found on the vehicle at the last download."""
        self.file: PlanFile | None = None
        """The plan that is to be uploaded or compared."""
        self.differences: tuple[PlanDifference, ...] | None = None
        """Between file and vehicle; empty where they are the same, None while that is not known."""
        self._begin = begin
        self._service = service

    def download(self) -> None:
        """Gets mission, fence and rally points."""

        async def work(report: OnProgress) -> str:
            self.found = await self._service.download(report)
            return f"on the vehicle: {self.found.summary}"

        self._begin(ServiceKind.PLANS, "downloading the plan", work)

    def open(self, file: Path) -> None:
        """Opens a `.plan` or a file of waypoints."""

        async def work(report: OnProgress) -> str:
            del report
            plan = self._service.read(file)
            self.file, self.differences = PlanFile(name=file.name, plan=plan), None
            return f"{file.name}: {VehiclePlan.summary_of(plan)}"

        self._begin(ServiceKind.PLANS, f"opening {file.name}", work)

    def upload(self) -> None:
        """Uploads the selected plan to the vehicle, reads it back and compares."""
        file = self.file
        if file is None:
            return

        async def work(report: OnProgress) -> str:
            self.found, self.differences = None, None
            self.differences = await self._service.upload(file.plan, report)
            if self.differences:
                raise Refused(f"{file.name} was uploaded, but {len(self.differences)} items differ")
            return f"{file.name} is on the vehicle, read back and compared"

        self._begin(ServiceKind.PLANS, f"uploading {file.name}", work, is_change=True)

    def verify(self) -> None:
        """Compares the vehicle's plan with the selected one."""
        file = self.file
        if file is None:
            return

        async def work(report: OnProgress) -> str:
            self.differences = None
            self.differences = await self._service.verify(file.plan, report)
            if self.differences:
                raise Refused(f"the vehicle's plan differs from {file.name}: {len(self.differences)} differences")
            return f"the vehicle has {file.name}"

        self._begin(ServiceKind.PLANS, f"comparing with {file.name}", work)

    def save(self, file: Path) -> None:
        """Saves the downloaded plan."""
        found = self.found

        async def work(report: OnProgress) -> str:
            found_now = found or await self._service.download(report)
            self.found = found_now
            self._service.save(found_now, file)
            return f"{found_now.summary}, in {file}"

        self._begin(ServiceKind.PLANS, f"saving {file.name}", work)

    def clear(self) -> None:
        """Takes mission, fence and rally points off the vehicle."""

        async def work(report: OnProgress) -> str:
            self.found, self.differences = None, None
            if await self._service.upload(ForeignPlan(entries=(), raw={}), report):
                raise Refused("the plan was not cleared: some items are left")
            return "mission, fence and rally points are cleared"

        self._begin(ServiceKind.PLANS, "clearing the plan", work, is_change=True)


def command_name(command: int) -> str:
    """A mission item's command as a person reads it: `nav waypoint`."""
    name = enum_name("MAV_CMD", command)
    return f"command {command}" if name.isdigit() else name.removeprefix("MAV_CMD_").lower().replace("_", " ")
