"""Compares the autopilot's failsafes with the platform file, against which missions are checked."""

from collections.abc import Iterator
from typing import Final

from gloc3.messages.preflight import Check, Group, Verdict
from gloc3.messages.readiness import AutopilotSetup
from gloc3.mission.model.model import answer
from gloc3.mission.model.policy import SEVERITY, Policy, resolved
from gloc3_onboard.checks.parameters import CONTINUE, PILOT, Failsafe
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.checks.tables import table_of

GROUP = Group.FAILSAFES
NEAR_S: Final = 0.5
"""Times that differ by less are the same."""
NEAR_SHARE: Final = 0.01
"""The same of shares of the battery."""


def failsafe_checks(readings: Readings) -> Iterator[Check]:
    """A line for each failsafe."""
    setup, stated = readings.setup, readings.platform.failsafes
    if setup is None or setup.style is None or not setup.is_complete:
        return
    table = table_of(setup.style, setup.vehicle)
    link, battery = stated.link_loss, stated.low_battery
    wanted_s = None if link is None else link.after_s
    yield _compared(setup, "link loss", table.link_loss, link.action if link else CONTINUE, wanted_s, "s")
    wanted_share = None if battery is None else battery.at
    yield _compared(setup, "low battery", table.low_battery, battery.action if battery else CONTINUE, wanted_share, "")
    yield _pose_lost(readings, setup, table.pose_lost)
    yield _setpoints_lost(setup, table.setpoints_lost, has_pilot=readings.platform.pilot)
    for name, (value, what) in table.doubtful.items():
        if setup.parameters.get(name) == value:
            yield Check(GROUP, name, Verdict.WARNING, f"{value:g}: it {what}", f"set {name} to another value")
    wrong = {**table.hindering, **(table.ignoring_pilot if readings.platform.pilot else {})}
    for name, (values, what, right) in wrong.items():
        if (given := setup.parameters.get(name)) in values:
            yield Check(GROUP, name, Verdict.RED, f"{given:g}: it {what}", f"set {name} to {right:g}")


def action_of(setup: AutopilotSetup, failsafe: Failsafe) -> str | None:
    """What the autopilot would do while it follows our setpoints; None where that is not known."""
    if not failsafe.parameter:
        return failsafe.actions[0]
    if failsafe.enabled_by and setup.parameters.get(failsafe.enabled_by) == 0.0:
        return CONTINUE
    value = setup.parameters.get(failsafe.parameter)
    if value is None or (failsafe.enabled_by and failsafe.enabled_by not in setup.parameters):
        return None
    if _has_no_limit(setup, failsafe):
        return CONTINUE
    if failsafe.exempt is not None:
        name, bit = failsafe.exempt
        if int(setup.parameters.get(name, 0.0)) & bit:
            return CONTINUE
    return failsafe.actions.get(int(value), f"an unknown action ({failsafe.parameter} is {value:g})")


def _has_no_limit(setup: AutopilotSetup, failsafe: Failsafe) -> bool:
    """Whether neither a share of the charge nor a voltage brings it about."""
    is_off = failsafe.volts and setup.parameters.get(failsafe.volts) == 0.0
    return bool(is_off) and failsafe.limit(setup.parameters.get) == 0.0


def _compared(
    setup: AutopilotSetup, name: str, failsafe: Failsafe, wanted: str, wanted_limit: float | None, unit: str
) -> Check:
    """Compares with the platform file, which says `wanted`, and when."""
    action = action_of(setup, failsafe)
    if action is None:
        return Check(GROUP, name, Verdict.UNKNOWN, f"{failsafe.parameter} could not be read")
    limit = failsafe.limit(setup.parameters.get)
    volts = setup.parameters.get(failsafe.volts, 0.0)
    decides = failsafe.parameter
    if failsafe.enabled_by and CONTINUE in (wanted, action) and setup.parameters.get(decides, 0.0) != 0.0:
        decides = failsafe.enabled_by
    when = _when(limit, unit) if limit or not volts else ""
    when += f"{' or' if when else ''} at {volts:g} V ({failsafe.volts})" if volts else ""
    if _has_no_limit(setup, failsafe):
        when = f": {' and '.join((failsafe.limit_parameters[0], failsafe.volts))} are 0"
    finding = f"{action}{when if action != CONTINUE or when[:1] == ':' else ''}"
    finding += f" ({decides} {setup.parameters.get(decides, 0.0):g})"
    if action != wanted:
        finding += f"; the platform file says {wanted}{_when(wanted_limit, unit)}"
        right = ", ".join(f"{number}" for number, meaning in failsafe.actions.items() if meaning == wanted)
        if decides == failsafe.enabled_by:
            right = "0" if wanted == CONTINUE else f"1, and {failsafe.parameter} to {right}"
        correct = "failsafes in the platform file"
        advice = f"set {decides} to {right}, or correct {correct}" if right else f"correct {correct}, and the missions"
        return Check(GROUP, name, Verdict.RED, finding, advice)
    if action == CONTINUE or limit is None or wanted_limit is None or (volts and not limit):
        return Check(GROUP, name, Verdict.OK, finding)
    near = NEAR_S if unit else NEAR_SHARE
    is_sooner = limit < wanted_limit - near if unit else limit > wanted_limit + near
    advice = f"correct {failsafe.limit_parameters[0]}, or failsafes in the platform file"
    if is_sooner:  # it would overrule missions that were found to agree with it
        finding += f"; the platform file says{_when(wanted_limit, unit)}"
        return Check(GROUP, name, Verdict.RED, finding, advice)
    if abs(limit - wanted_limit) > near:
        finding += f"; the platform file says{_when(wanted_limit, unit)}"
        return Check(GROUP, name, Verdict.WARNING, finding, advice)
    return Check(GROUP, name, Verdict.OK, finding)


def _when(limit: float | None, unit: str) -> str:
    if limit is None:
        return ""
    return f" after {limit:g} s" if unit else f" at {100.0 * limit:.0f} %"


def _pose_lost(readings: Readings, setup: AutopilotSetup, failsafe: Failsafe) -> Check:
    """Compares with the platform file, or where that says nothing with the loaded mission."""
    name, action = "position lost", action_of(setup, failsafe)
    if action is None:
        return Check(GROUP, name, Verdict.UNKNOWN, f"{failsafe.parameter} could not be read")
    source = f" ({failsafe.parameter} {setup.parameters[failsafe.parameter]:g})" if failsafe.parameter else ""
    stated, mission = readings.platform.failsafes.pose_lost, readings.mission
    if stated is not None and stated.action != action:
        finding = f"{action}{source}; the platform file says {stated.action}"
        return Check(GROUP, name, Verdict.RED, finding, "correct the parameter, or failsafes in the platform file")
    if action == PILOT:
        advice = f"without a pilot at the sticks set {failsafe.parameter} to 1 (land)"
        return Check(GROUP, name, Verdict.WARNING, f"{action}{source}", advice)
    if mission is not None and action in list(Policy):
        wanted = resolved(answer(mission.policies.on_pose_lost), mission.policies.on_failure)
        if SEVERITY[Policy(action)] > SEVERITY[wanted]:
            finding = f"{action}{source}; the mission says on_pose_lost: {wanted}"
            advice = f"the autopilot may overrule the mission: set on_pose_lost: {action}"
            return Check(GROUP, name, Verdict.WARNING, finding, advice)
    return Check(GROUP, name, Verdict.OK, f"{action}{source}")


def _setpoints_lost(setup: AutopilotSetup, failsafe: Failsafe, *, has_pilot: bool) -> Check:
    """What becomes of the vehicle when this computer dies in flight."""
    name, action = "setpoints lost", action_of(setup, failsafe)
    if action is None:
        return Check(GROUP, name, Verdict.UNKNOWN, f"{failsafe.parameter} could not be read")
    source = f" ({failsafe.parameter} {setup.parameters[failsafe.parameter]:g})" if failsafe.parameter else ""
    finding = f"{action}{_when(failsafe.limit(setup.parameters.get), 's')}{source}"
    if action in list(Policy):
        return Check(GROUP, name, Verdict.OK, finding)
    right = ", ".join(f"{number} ({what})" for number, what in failsafe.actions.items() if what in list(Policy))
    verdict = Verdict.WARNING if action == PILOT and has_pilot else Verdict.RED
    stands_by = ", or pilot: true in the platform file if one stands by" if action == PILOT and not has_pilot else ""
    return Check(GROUP, name, verdict, finding, f"set {failsafe.parameter} to one of {right}{stands_by}")
