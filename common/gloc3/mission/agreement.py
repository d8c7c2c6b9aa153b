"""Whether a mission's policies agree with what the platform's autopilot is set to do by itself."""

from collections.abc import Iterator

from gloc3.errors import Finding
from gloc3.mission.model import Mission, answer
from gloc3.mission.policy import SEVERITY, Policy, resolved
from gloc3.platform import Platform


def agreement_findings(mission: Mission, platform: Platform) -> list[Finding]:
    """Where the autopilot would overrule the mission, and policies that cannot be carried out."""
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
            f"on_link_loss is {wanted}, but {failsafe.after_s:g} s without a station the autopilot does {theirs} by itself",
            f"set the autopilot's failsafe to {wanted}, or say on_link_loss: {theirs}",
        )
    elif theirs is not Policy.CONTINUE and theirs is not wanted and failsafe.after_s <= after_s:
        yield _finding(
            mission,
            "on_link_loss",
            f"the autopilot does {theirs} after {failsafe.after_s:g} s without a station, before {wanted} at {after_s:g} s",
            f"give link_loss_after_s less than {failsafe.after_s:g}, or say on_link_loss: {theirs}",
        )


def _low_battery(mission: Mission, platform: Platform) -> Iterator[Finding]:
    failsafe = platform.failsafes.low_battery
    if failsafe is None:
        return
    wanted, theirs = _policy(mission, "on_low_battery"), Policy(failsafe.action)
    low = platform.power.reserve if platform.power is not None else 0.0
    if SEVERITY[theirs] > SEVERITY[wanted]:
        yield _finding(
            mission,
            "on_low_battery",
            f"on_low_battery is {wanted}, but at {100.0 * failsafe.at:.0f} % the autopilot does {theirs} by itself",
            f"set the autopilot's failsafe to {wanted}, or say on_low_battery: {theirs}",
        )
    elif platform.power is not None and theirs not in (Policy.CONTINUE, wanted) and failsafe.at >= low:
        yield _finding(
            mission,
            "on_low_battery",
            f"the autopilot does {theirs} at {100.0 * failsafe.at:.0f} % of the battery, before {wanted} at the reserve of "
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
            f"on_pose_lost is {wanted}, but without a position the autopilot does {failsafe.action} by itself",
            f"say on_pose_lost: {failsafe.action}",
        )
    capability = {Policy.RETURN: "return_home", Policy.HOLD: "hold"}.get(wanted)
    row = platform.capabilities.get(capability) if capability is not None else None
    if row is not None and "pose" in row.needs:
        yield _finding(
            mission,
            "on_pose_lost",
            f"{capability} needs the pose, and cannot be flown when that is lost",
            "say on_pose_lost: land",
        )


def _policy(mission: Mission, key: str) -> Policy:
    return resolved(answer(getattr(mission.policies, key)), mission.policies.on_failure)


def _finding(mission: Mission, key: str, message: str, hint: str) -> Finding:
    if mission.document is None:
        return Finding(file=mission.name, message=message, hint=hint)
    return mission.document.finding((key,), message, hint)
