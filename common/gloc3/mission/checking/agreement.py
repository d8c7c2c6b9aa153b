"""Checks a mission's policies and planned silences against the autopilot's own failsafes."""

from collections.abc import Iterator

from gloc3.errors import Finding
from gloc3.mission.checking.estimate import MissionEstimate
from gloc3.mission.model.model import Mission, answer, where_of
from gloc3.mission.model.policy import SEVERITY, Policy, resolved
from gloc3.platform.platform import Platform


def agreement_findings(mission: Mission, platform: Platform) -> list[Finding]:
    """Findings where the autopilot's failsafes override the mission, and policies that cannot be carried out."""
    return [*_link_loss(mission, platform), *_low_battery(mission, platform), *_pose_lost(mission, platform)]


def _link_loss(mission: Mission, platform: Platform) -> Iterator[Finding]:
    failsafe = platform.failsafes.link_loss
    if failsafe is None:
        return
    wanted, theirs = _policy(mission, "on_link_loss"), Policy(failsafe.action)
    after_s = mission.policies.link_loss_after_s
    if SEVERITY[theirs] > SEVERITY[wanted]:
        yield _finding(
            mission,
            "on_link_loss",
            f"on_link_loss is {wanted}, but after {failsafe.after_s:g} s the autopilot's failsafe is {theirs}",
            f"set the autopilot's failsafe to {wanted}, or on_link_loss to {theirs}",
        )
    elif theirs is not Policy.CONTINUE and theirs is not wanted and failsafe.after_s <= after_s:
        yield _finding(
            mission,
            "on_link_loss",
            f"the autopilot's {theirs} after {failsafe.after_s:g} s of link loss precedes {wanted} at {after_s:g} s",
            f"set link_loss_after_s below {failsafe.after_s:g}, or on_link_loss to {theirs}",
        )


def _low_battery(mission: Mission, platform: Platform) -> Iterator[Finding]:
    failsafe = platform.failsafes.low_battery
    if failsafe is None:
        return
    wanted, theirs = _policy(mission, "on_low_battery"), Policy(failsafe.action)
    low = platform.power.reserve if platform.power is not None else 0.0
    is_last = wanted is Policy.RETURN and failsafe.at < low  # what returns at the reserve may have to land in the end
    if SEVERITY[theirs] > SEVERITY[wanted] and not is_last:
        yield _finding(
            mission,
            "on_low_battery",
            f"on_low_battery is {wanted}, but at {100.0 * failsafe.at:.0f} % the autopilot's failsafe is {theirs}",
            f"set the autopilot's failsafe to {wanted}, or on_low_battery to {theirs}",
        )
    elif platform.power is not None and theirs not in (Policy.CONTINUE, wanted) and failsafe.at >= low:
        yield _finding(
            mission,
            "on_low_battery",
            f"the autopilot's {theirs} at {100.0 * failsafe.at:.0f} % battery precedes {wanted} at the reserve of "
            f"{100.0 * low:.0f} %",
            "raise the platform's reserve, or lower the autopilot's threshold",
        )


def _pose_lost(mission: Mission, platform: Platform) -> Iterator[Finding]:
    wanted = _policy(mission, "on_pose_lost")
    failsafe = platform.failsafes.pose_lost
    if failsafe is not None and SEVERITY[Policy(failsafe.action)] > SEVERITY[wanted]:
        yield _finding(
            mission,
            "on_pose_lost",
            f"on_pose_lost is {wanted}, but without a position the autopilot's failsafe is {failsafe.action}",
            f"set on_pose_lost: {failsafe.action}",
        )
    capability = {Policy.RETURN: "return_home", Policy.HOLD: "hold"}.get(wanted)
    row = platform.capabilities.get(capability) if capability is not None else None
    if row is not None and "pose" in row.needs:
        yield _finding(
            mission,
            "on_pose_lost",
            f"{capability} needs the pose and cannot be flown without it",
            "set on_pose_lost: land",
        )


def _policy(mission: Mission, key: str) -> Policy:
    return resolved(answer(getattr(mission.policies, key)), mission.policies.on_failure)


def _finding(mission: Mission, key: str, message: str, hint: str) -> Finding:
    if mission.document is None:
        return Finding(file=mission.name, message=message, hint=hint)
    return mission.document.finding((key,), message, hint)


def silence_findings(mission: Mission, figures: MissionEstimate, platform: Platform | None) -> Iterator[Finding]:
    """Planned silences that the autopilot would end, without an overdue policy, or too short for their task."""
    document, policies = mission.document, mission.policies
    if document is None:
        return
    failsafe = platform.failsafes.link_loss if platform is not None else None
    planned = {target: silence for target, silence, _ in _planned(mission, figures)}
    if policies.on_overdue is not None and not planned:
        hint = "set silence: {expected_s: ...} in the task that is out of contact"
        yield document.finding(("on_overdue",), "no task or action has a planned silence", hint, is_warning=True)
    for target, expected_s, duration_s in _planned(mission, figures):
        where = (*where_of(target), "silence", "expected_s")
        if failsafe is not None and Policy(failsafe.action) is not Policy.CONTINUE and failsafe.after_s < expected_s:
            yield document.finding(
                where,
                f"a silence of {expected_s:g} s is planned, but after {failsafe.after_s:g} s the autopilot's "
                f"failsafe is {failsafe.action}",
                "disable the autopilot's failsafe, or plan a shorter silence",
            )
        if expected_s <= policies.link_loss_after_s:
            message = f"a silence of {expected_s:g} s ends before link_loss_after_s ({policies.link_loss_after_s:g} s)"
            yield document.finding(where, message, "remove it, or state how long the vehicle is out of contact")
        if duration_s > expected_s:
            message = f"about {duration_s:.0f} s are needed, but contact is due after {expected_s:g} s"
            yield document.finding(where, message, "state a longer silence", is_warning=True)
    overdue = resolved(answer(policies.on_overdue or policies.on_link_loss), policies.on_failure)
    if planned and SEVERITY[overdue] <= SEVERITY[Policy.CONTINUE]:
        target = next(iter(planned))
        key = "on_overdue" if policies.on_overdue is not None else "on_link_loss"
        message = f"nothing is done onboard when contact is overdue ({key}: continue)"
        hint = "set on_overdue: return, land, hold or abort"
        yield document.finding((*where_of(target), "silence"), message, hint, at_key=True, is_warning=True)


def _planned(mission: Mission, figures: MissionEstimate) -> Iterator[tuple[str, float, float]]:
    """Every item that plans a silence: its target, the stated time, and how long it takes itself, in seconds."""
    for name, task in mission.tasks.items():
        if task.options.silence is not None and not task.is_elsewhere:
            start_s, end_s = figures.task_span(task)
            yield name, task.options.silence.expected_s, end_s - start_s
    for target, action in mission.actions().items():
        if action.options.silence is not None:
            part = figures.actions.get(target)
            yield target, action.options.silence.expected_s, part.end_s - part.start_s if part is not None else 0.0
