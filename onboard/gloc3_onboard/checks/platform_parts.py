"""Checks of what runs onboard, and of the mission that is to be started."""

from collections.abc import Iterator

from gloc3.messages.preflight import Check, Group, Verdict
from gloc3.messages.summaries import WELL, Health
from gloc3_onboard.checks.readings import Readings


def component_checks(readings: Readings) -> Iterator[Check]:
    """A line for all components together, and one for each that is not well."""
    if readings.components is None:
        return
    required = [one for one in readings.components if one.is_required]
    unwell = [one for one in readings.components if one.health not in (WELL if one.is_standby else (Health.WORKING,))]
    for one in unwell:
        verdict = Verdict.RED if one.is_required else Verdict.WARNING
        why = f": {one.cause}" if one.cause else ""
        advice = "read its error on the Health screen, then initialize and start it"
        yield Check(Group.COMPONENTS, one.name, verdict, f"{one.health}{why}", advice)
    well = len(readings.components) - len(unwell)
    if not any(one.is_required for one in unwell):
        finding = f"{well} of {len(readings.components)} work, with all {len(required)} that are required"
        yield Check(Group.COMPONENTS, "all", Verdict.OK, finding)


def mission_checks(readings: Readings) -> Iterator[Check]:
    """Whether there is something to start, and nobody else has the vehicle."""
    mission = readings.mission
    if readings.pilot_reason:
        advice = "resume gives the vehicle back to the mission, when the pilot agrees"
        yield Check(Group.MISSION, "control", Verdict.WARNING, f"a pilot has it: {readings.pilot_reason}", advice)
    if readings.components is None:
        return
    if mission is None:
        yield Check(Group.MISSION, "loaded", Verdict.UNKNOWN, "none is loaded", "stream one from a station")
        return
    yield Check(Group.MISSION, "loaded", Verdict.OK, f"{mission.name!r}, checked onboard")
    if readings.fence_problem:
        advice = "wait for the upload, or stream the mission again"
        yield Check(Group.MISSION, "fence", Verdict.RED, readings.fence_problem, advice)
