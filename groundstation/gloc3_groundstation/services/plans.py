"""Plans on the autopilot: download, upload from `.plan` and WPL files, read back and compare, clear."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

from gloc3.cli.counting import counted
from gloc3.errors import Refused
from gloc3.mavlink.services.mission_client import MissionClient, Transfer
from gloc3.mavlink.services.plan import PlanItem, PlanResult, PlanType
from gloc3.mavlink.services.version import ProtocolCapability
from gloc3.mission.formats import load_plan, plan_text
from gloc3.mission.formats.commands import command_name
from gloc3.mission.formats.items import ForeignPlan
from gloc3_groundstation.services.machines import Machines
from gloc3_groundstation.services.plan_items import PlanDifference, PlanParts, differences, from_wire, to_wire
from gloc3_groundstation.services.progress import OnProgress, Quietly
from gloc3_groundstation.services.snapshot import Firmware, ServicesSnapshot, SnapshotService

KINDS: Final = (PlanType.MISSION, PlanType.FENCE, PlanType.RALLY)
_NAMES: Final = {PlanType.MISSION: "mission", PlanType.FENCE: "fence", PlanType.RALLY: "rally points"}
_NEEDED: Final = {PlanType.FENCE: ProtocolCapability.MISSION_FENCE, PlanType.RALLY: ProtocolCapability.MISSION_RALLY}


class VehiclePlan(msgspec.Struct, frozen=True, kw_only=True):
    """The plan on the vehicle."""

    plan: ForeignPlan
    """As a file has it."""
    parts: PlanParts
    """As it came."""

    @property
    def summary(self) -> str:
        """For a person, as "12 items, 2 fence areas, 1 rally point"."""
        return self.summary_of(self.plan)

    @staticmethod
    def summary_of(plan: ForeignPlan) -> str:
        """The same of any plan."""
        counts = (
            (len(plan.items), "item"),
            (len(plan.fence), "fence area"),
            (len(plan.rally), "rally point"),
        )
        return ", ".join(counted(count, name) for count, name in counts)


class PlanService:
    """Transfers plans, and compares them."""

    def __init__(self, machines: Machines, client: MissionClient, snapshot: SnapshotService) -> None:
        self._machines = machines
        self._client = client
        self._snapshot = snapshot

    async def download(self, on_progress: OnProgress | None = None, kinds: Sequence[PlanType] = KINDS) -> VehiclePlan:
        """Downloads mission, fence and rally points, or only some of these `kinds`.

        Raises:
            Refused: the vehicle does not answer, or its plan cannot be parsed.
        """
        snapshot = await self._snapshot.learn(self._machines)
        found: dict[PlanType, tuple[PlanItem, ...]] = {}
        report = Quietly(on_progress)
        for number, kind in enumerate(kinds):
            report(f"downloading the {_NAMES[kind]}", number / len(kinds))
            found[kind] = await self._get(kind) if _can(snapshot, kind) else ()
        mission, fence, rally = (found.get(kind, ()) for kind in KINDS)
        parts = PlanParts(mission=mission, fence=fence, rally=rally)
        return VehiclePlan(plan=from_wire(parts, snapshot.firmware, snapshot.vehicle_type), parts=parts)

    async def upload(
        self, plan: ForeignPlan, on_progress: OnProgress | None = None, kinds: Sequence[PlanType] | None = None
    ) -> tuple[PlanDifference, ...]:
        """Uploads a plan to the vehicle, reads it back and compares.

        Types that are empty in a `.plan` with a mission are cleared on the vehicle: afterwards it has this plan and
        nothing else. Files of waypoints, fences and rally points replace what they contain, and nothing else.

        Args:
            plan: from `read` or `download`.
            on_progress: called with the progress.
            kinds: only these of mission, fence and rally points; None for all that the plan's file can contain.

        Returns:
            Differences between the vehicle's plan and the uploaded one; empty for none.

        Raises:
            Refused: the vehicle rejects it, or does not answer; the parts uploaded before stay.
        """
        snapshot = await self._snapshot.learn(self._machines)
        parts, report = to_wire(plan, snapshot.firmware), Quietly(on_progress)
        kinds = kinds_of(plan) if kinds is None else kinds
        for kind in kinds:
            items = parts.of(kind)
            if not _can(snapshot, kind):
                if items:
                    raise Refused(f"the vehicle does not support {_NAMES[kind]}")
                continue
            what = f"uploading the {_NAMES[kind]}"
            report(what, 0.0, counted(len(items), "item"))
            if items:
                upload = self._client.upload(snapshot.address, items, now_s=self._machines.now_s, kind=kind)
                await self._finish(upload, "uploaded", partial(_report_progress, report, what, upload))
            else:
                await self.clear(kind)
        return await self._differences(parts, snapshot, kinds, report)

    async def verify(self, plan: ForeignPlan, on_progress: OnProgress | None = None) -> tuple[PlanDifference, ...]:
        """Reads the vehicle's plan and compares it with another one.

        Returns:
            Where they differ; empty when they are the same.

        Raises:
            Refused: the vehicle does not answer.
        """
        snapshot = await self._snapshot.learn(self._machines)
        parts = to_wire(plan, snapshot.firmware)
        return await self._differences(parts, snapshot, kinds_of(plan), Quietly(on_progress))

    async def clear(self, kind: PlanType) -> None:
        """Takes one part of the plan off the vehicle.

        Raises:
            Refused: the vehicle does not do so, or does not answer.
        """
        target = self._snapshot.snapshot.address
        await self._finish(self._client.clear(target, now_s=self._machines.now_s, kind=kind), "cleared")

    @staticmethod
    def read(path: Path) -> ForeignPlan:
        """Reads a `.plan` or a file of waypoints.

        Raises:
            InputError: with everything that is wrong in it.
        """
        return load_plan(path)

    @staticmethod
    def save(found: VehiclePlan, path: Path) -> None:
        """Saves downloaded plans in the format of the suffix: `.plan`, or others, which cannot hold everything.

        Raises:
            InputError: the suffix is unknown, or its format cannot hold the plan.
            Refused: the file cannot be written.
        """
        text, _ = plan_text(found.plan, path.suffix, path.name)
        try:
            path.write_text(text)
        except OSError as error:
            raise Refused(f"{path} cannot be written: {error.strerror or error}") from error

    async def _get(self, kind: PlanType) -> tuple[PlanItem, ...]:
        target = self._snapshot.snapshot.address
        download = self._client.download(target, now_s=self._machines.now_s, kind=kind)
        await self._finish(download, "downloaded")
        return download.items

    async def _finish(self, transfer: Transfer, done: str, poll: Callable[[], None] | None = None) -> None:
        """Waits for the end of a transfer; one that is cancelled is cancelled on the vehicle, too.

        Raises:
            Refused: the vehicle does not do so, or does not answer; with the reason.
        """
        try:
            await self._machines.until(lambda: transfer.result is not None, poll)
        finally:
            self._client.cancel(transfer, self._machines.now_s)
            self._machines.settle()
        if transfer.result is not PlanResult.ACCEPTED:
            reason = transfer.result.words if transfer.result is not None else "cancelled"
            raise Refused(
                f"the {_NAMES[PlanType(transfer.kind)]} was not {done}: {self._refused_item(transfer)}{reason}"
            )

    def _refused_item(self, transfer: Transfer) -> str:
        """The item of an upload that the vehicle does not take, with its number in the plan."""
        index = transfer.refused_index
        if index is None:
            return ""
        is_behind_home = transfer.kind == PlanType.MISSION and self._snapshot.snapshot.firmware is Firmware.ARDUPILOT
        return f"item {index + (not is_behind_home)}, {command_name(transfer.items[index].command)}: "

    async def _differences(
        self, parts: PlanParts, snapshot: ServicesSnapshot, kinds: Sequence[PlanType], report: Quietly
    ) -> tuple[PlanDifference, ...]:
        rows: list[PlanDifference] = []
        for number, kind in enumerate(kinds):
            report(f"reading the {_NAMES[kind]} back", number / len(kinds))
            found = await self._get(kind) if _can(snapshot, kind) else ()
            rows += differences(parts.of(kind), found, kind, snapshot.firmware)
        return tuple(rows)


def _report_progress(report: Quietly, what: str, transfer: Transfer) -> None:
    report(what, transfer.progress)


def kinds_of(plan: ForeignPlan) -> tuple[PlanType, ...]:
    """What a plan's file is about: a file of waypoints of what it has, a file without a mission not of the mission."""
    parts = {PlanType.MISSION: plan.items, PlanType.FENCE: plan.fence, PlanType.RALLY: plan.rally}
    there = tuple(kind for kind in KINDS if parts[kind])
    return KINDS if plan.items and not plan.is_from_waypoints else there or (PlanType.MISSION,)


def _can(snapshot: ServicesSnapshot, kind: PlanType) -> bool:
    """Whether the vehicle supports this type of plan; one that reports no capabilities is queried."""
    needed = _NEEDED.get(kind)
    return needed is None or snapshot.version is None or needed in snapshot.version.capabilities
