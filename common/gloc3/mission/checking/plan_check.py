"""Checks another program's plan: the file itself, its places, and the mission that it becomes."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from gloc3.errors import InputError
from gloc3.messages.frames import GeoPoint
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.checking.parts_check import parts_findings
from gloc3.mission.checking.place_check import plan_place_findings
from gloc3.mission.formats import in_source, load_plan, to_mission
from gloc3.mission.formats.items import ForeignPlan


class PlanReport(NamedTuple):
    """The outcome of a check."""

    plan: ForeignPlan
    report: CheckReport
    """With the lines of the plan's file; without a mission where the file holds a fence or rally points alone."""
    text: str
    """The mission that it becomes; empty without one."""

    @property
    def is_parts_alone(self) -> bool:
        """Whether the file holds a fence or rally points, and no mission."""
        return not self.plan.items and bool(self.plan.fence or self.plan.rally)


def check_plan(path: Path, circumstances: Circumstances) -> PlanReport:
    """Checks a plan, and the mission that it becomes.

    Args:
        path: the plan.
        circumstances: of the flight.

    Raises:
        InputError: it cannot be read or become a mission; with everything that is wrong.
    """
    plan, file = load_plan(path), str(path)
    found = [*plan_place_findings(plan, file), *parts_findings(plan, file)]
    if not plan.items and (plan.fence or plan.rally):
        findings = tuple(sorted([*plan.findings, *found]))
        return PlanReport(plan, CheckReport(file=file, findings=findings), "")
    try:
        text, warnings = to_mission(plan, path.stem, file, circumstances.platform)
    except InputError as error:
        raise InputError(sorted([*error.findings, *found])) from None
    converted = f"{file} (converted)"
    checked = check_text(text, converted, circumstances)
    located = in_source(checked.findings, text, converted, file)
    findings = tuple(dict.fromkeys([*sorted(found), *warnings, *located]))
    return PlanReport(plan, replace(checked, file=file, findings=findings), text)


def planned_home(plan: ForeignPlan) -> GeoPoint | None:
    """The planned home of a plan; None where it names none."""
    return GeoPoint(*plan.home) if plan.home is not None and any(plan.home[:2]) else None
