"""Whether the silences that a mission plans fit its policies, its own length, and what the autopilot does by itself."""

from collections.abc import Iterator

from gloc3.errors import Finding
from gloc3.mission.estimate import Estimate
from gloc3.mission.model import Mission, answer, where_of
from gloc3.mission.policy import SEVERITY, Policy, resolved
from gloc3.platform import Platform


def silence_findings(mission: Mission, figures: Estimate, platform: Platform | None) -> Iterator[Finding]:
    """Silences that the autopilot would end, that no policy watches over, or that are too short for what is done in them."""
    document, policies = mission.document, mission.policies
    if document is None:
        return
    failsafe = platform.failsafes.link_loss if platform is not None else None
    planned = {target: silence for target, silence, _ in _planned(mission, figures)}
    if policies.on_overdue is not None and not planned:
        hint = "say silence: {expected_s: ...} in the task that is out of contact"
        yield document.finding(("on_overdue",), "no task or action plans a silence", hint, is_warning=True)
    for target, expected_s, takes_s in _planned(mission, figures):
        where = (*where_of(target), "silence", "expected_s")
        if failsafe is not None and Policy(failsafe.action) is not Policy.CONTINUE and failsafe.after_s < expected_s:
            yield document.finding(
                where,
                f"{expected_s:g} s of silence are planned, but {failsafe.after_s:g} s without a station the autopilot does "
                f"{failsafe.action} by itself",
                "switch that failsafe of the autopilot off, or plan a shorter silence",
            )
        if expected_s <= policies.link_loss_after_s:
            message = f"a silence of {expected_s:g} s ends before link_loss_after_s ({policies.link_loss_after_s:g} s)"
            yield document.finding(where, message, "leave it out, or state how long the vehicle is out of contact")
        if takes_s > expected_s:
            message = f"about {takes_s:.0f} s are needed, but contact is due after {expected_s:g} s"
            yield document.finding(where, message, "state a longer silence", is_warning=True)
    overdue = resolved(answer(policies.on_overdue or policies.on_link_loss), policies.on_failure)
    if planned and SEVERITY[overdue] <= SEVERITY[Policy.CONTINUE]:
        target = next(iter(planned))
        key = "on_overdue" if policies.on_overdue is not None else "on_link_loss"
        message = f"nothing is done onboard when contact is overdue ({key}: continue)"
        hint = "say on_overdue: return, land, hold or abort"
        yield document.finding((*where_of(target), "silence"), message, hint, at_key=True, is_warning=True)


def _planned(mission: Mission, figures: Estimate) -> Iterator[tuple[str, float, float]]:
    """Every item that plans a silence: its target, the stated time, and how long it takes itself, in seconds."""
    for name, task in mission.tasks.items():
        if task.options.silence is not None and not task.is_elsewhere:
            start_s, end_s = figures.task_span(task)
            yield name, task.options.silence.expected_s, end_s - start_s
    for target, action in mission.actions().items():
        if action.options.silence is not None:
            part = figures.actions.get(target)
            yield target, action.options.silence.expected_s, part.end_s - part.start_s if part is not None else 0.0
