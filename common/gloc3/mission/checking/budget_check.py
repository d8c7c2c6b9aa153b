"""Deadlines that cannot be kept, actions without an end, and more energy than the battery has."""

from collections.abc import Iterator

from gloc3.amounts import beside
from gloc3.documents.document import Document, Where
from gloc3.errors import Finding
from gloc3.mission.checking.estimate import MissionEstimate, may_vary
from gloc3.mission.checking.space_check import name_of, place_of
from gloc3.mission.model.model import Mission, Task, answer, where_of
from gloc3.platform.platform import Platform


def budget_findings(mission: Mission, figures: MissionEstimate, platform: Platform | None) -> list[Finding]:
    """Deadlines that cannot be kept, actions without an end, and more energy than the battery has."""
    document = mission.document
    if document is None:
        return []
    return [*time_findings(mission, figures), *_energy(mission, figures, platform, document)]


def time_findings(mission: Mission, figures: MissionEstimate) -> Iterator[Finding]:
    """Deadlines that cannot be kept, and actions without an end."""
    document = mission.document
    if document is None:
        return
    for target, part in figures.actions.items():
        if part.is_endless:
            hint = "set until, or a duration or count"
            yield document.finding(where_of(target), f"{target} never ends", hint, at_key=True)
        deadline_s = mission.actions()[target].options.deadline_s
        yield from _late(document, where_of(target), deadline_s, part.once_s, part.once_s)
    least = figures.least or figures
    for name, task in mission.tasks.items():
        most_s, least_s = _lasts(figures, task), _lasts(least, task)
        is_certain = not may_vary(task, is_begun=True)  # its own guard may leave it out, and not make it shorter
        yield from _late(document, where_of(name), task.options.deadline_s, most_s, most_s if is_certain else least_s)
    yield from _late(document, (), mission.deadline_s, figures.duration_s, least.duration_s)


def _lasts(figures: MissionEstimate, task: Task) -> float:
    start_s, end_s = figures.task_span(task)
    return end_s - start_s


def _late(
    document: Document, where: Where, deadline_s: float | None, most_s: float, least_s: float
) -> Iterator[Finding]:
    """A deadline that cannot be kept, or (a warning) not where no guard leaves anything out and no loop ends early."""
    if deadline_s is not None and most_s > deadline_s:
        is_certain = least_s > deadline_s
        needed = f"about {least_s:.0f} s are needed" if is_certain else f"up to {most_s:.0f} s may be needed"
        hint = "fly faster, shorten the mission, or raise deadline_s"
        message = f"{needed}, but deadline_s is {deadline_s:g}"
        yield document.finding((*where, "deadline_s"), message, hint, is_warning=not is_certain)


def _energy(
    mission: Mission, figures: MissionEstimate, platform: Platform | None, document: Document
) -> Iterator[Finding]:
    power = platform.power if platform is not None else None
    if power is None:
        return
    least_wh = (figures.least or figures).energy_wh
    usable_wh = power.usable_wh
    if figures.energy_wh > usable_wh:
        is_certain = least_wh > usable_wh
        needed = (
            f"about {beside(least_wh, usable_wh)} Wh are needed"
            if is_certain
            else f"up to {beside(figures.energy_wh, usable_wh)} Wh may be needed"
        )
        yield document.finding(
            ("mission",),
            f"{needed}, but only {usable_wh:.1f} Wh of {power.battery_wh:g} Wh "
            f"may be used (reserve {100.0 * power.reserve:.0f} %)",
            "shorten the mission, or split it into several",
            is_warning=not is_certain,
        )
    reserve_wh = power.battery_wh * power.reserve
    if answer(mission.policies.on_low_battery) == "return" and figures.return_wh > reserve_wh:
        place = ""
        if figures.return_from is not None:
            target, leg = figures.return_from
            action = mission.actions()[target]
            place = f", {name_of(place_of((*where_of(target), action.capability), action, leg, document))},"
        yield document.finding(
            ("on_low_battery",),
            f"the return from the farthest place{place} takes {beside(figures.return_wh, reserve_wh)} Wh, more than the "
            f"reserve of {reserve_wh:.1f} Wh",
            "set on_low_battery: land, or a larger reserve",
        )
