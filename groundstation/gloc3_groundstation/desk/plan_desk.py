"""Plans on the desk: download, open a file, upload, verify, save, clear."""

from pathlib import Path
from typing import TypeAlias

import msgspec

from gloc3.cli.counting import counted
from gloc3.errors import Refused
from gloc3.mavlink.codec import enum_name
from gloc3.mavlink.services.plan import PlanType
from gloc3.mission.formats.items import ForeignPlan
from gloc3_groundstation.desk.service_jobs import JobStarter, ServiceKind
from gloc3_groundstation.services.plan_items import PlanDifference
from gloc3_groundstation.services.plans import KINDS, PlanService, VehiclePlan
from gloc3_groundstation.services.progress import OnProgress

RallyPoint: TypeAlias = tuple[float, float, float]
"""Latitude and longitude in degrees, height above home in m."""


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
        self.rally: tuple[RallyPoint, ...] | None = None
        """The rally points found on the vehicle at the last download; None before it."""
        self._begin, self._service = begin, service

    def download(self) -> None:
        """Gets mission, fence and rally points."""

        async def work(report: OnProgress) -> str:
            self.found = await self._service.download(report)
            self.rally = self.found.plan.rally
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
            self.found, self.rally, self.differences = None, None, None
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
            self.found, self.rally, self.differences = None, None, None
            if await self._service.upload(ForeignPlan(entries=(), raw={}), report, KINDS):
                raise Refused("the plan was not cleared: some items are left")
            return "mission, fence and rally points are cleared"

        self._begin(ServiceKind.PLANS, "clearing the plan", work, is_change=True)

    # --- rally points alone ---

    def read_rally(self) -> None:
        """Gets the rally points."""

        async def work(report: OnProgress) -> str:
            self.rally = (await self._service.download(report, (PlanType.RALLY,))).plan.rally
            return f"on the vehicle: {counted(len(self.rally), 'rally point')}"

        self._begin(ServiceKind.PLANS, "reading the rally points", work)

    def upload_rally(self, points: tuple[RallyPoint, ...]) -> None:
        """Replaces the rally points of the vehicle, reads them back and compares; its mission and fence stay."""

        async def work(report: OnProgress) -> str:
            self.found, self.rally = None, None
            differences = await self._service.upload(ForeignPlan(rally=points), report, (PlanType.RALLY,))
            if differences:
                raise Refused(f"the rally points were uploaded, but the vehicle's differ: {differences[0]}")
            self.rally = points
            return f"{counted(len(points), 'rally point')} on the vehicle, read back and compared"

        self._begin(ServiceKind.PLANS, "uploading the rally points", work, is_change=True)


def command_name(command: int) -> str:
    """A mission item's command as a person reads it: `nav waypoint`."""
    name = enum_name("MAV_CMD", command)
    return f"command {command}" if name.isdigit() else name.removeprefix("MAV_CMD_").lower().replace("_", " ")
