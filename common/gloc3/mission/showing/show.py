"""Draws a mission: its partial order with times and claims as text for a terminal, and as a Mermaid diagram."""

from collections.abc import Iterator, Mapping
from textwrap import wrap
from typing import Final

import msgspec

from gloc3.cli.counting import counted
from gloc3.messages.units import split_unit
from gloc3.mission.checking.checker import CheckReport
from gloc3.mission.checking.estimate import about
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.model.arguments import Arguments
from gloc3.mission.model.model import Action, ItemFile, Mission, Policies, Task, TaskOptions
from gloc3.mission.showing.ground_lines import ground_lines
from gloc3.platform.platform import Capability, Platform

WIDTH: Final = 80
_BAR: Final = 22
_LISTS: Final = {"area": "corners", "wall": "ends", "to": "places"}
"""Kind of an argument's entries, where its name does not say it."""
_LEFT: Final = WIDTH - _BAR - 1


def drawing(report: CheckReport, capabilities: Mapping[str, Capability], platform: Platform | None = None) -> str:
    """The partial order of a checked mission, 80 columns wide.

    An entry below another one comes after it; entries joined to the line by `├─` may run at the same time. The bars
    show when each action runs, by the estimate.

    Args:
        report: of the mission; it must hold one.
        capabilities: resources claimed by the actions.
        platform: for the available energy.
    """
    mission = report.flyable()
    lines = [*_head(mission, report, platform), ""]
    total_s = report.estimate.duration_s if report.estimate is not None else 0.0
    if total_s > 0.0:
        lines.append(" " * _LEFT + f" 0{f'{total_s:.0f} s':>{_BAR - 1}}")
    lines += _tasks(mission.tasks, report, capabilities, total_s)
    if mission.contingencies:
        lines += ["", "failsafe policies:"]
        lines += _tasks(mission.contingencies, report, capabilities, 0.0)
    if report.profile is not None:
        lines += ["", *ground_lines(mission, report.profile, WIDTH)]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _tasks(
    tasks: Mapping[str, Task], report: CheckReport, capabilities: Mapping[str, Capability], total_s: float
) -> Iterator[str]:
    for name, mark, below in _layered({name: task.options.after for name, task in tasks.items()}, "●", "│"):
        yield from _item(mark, below, name, "", _relations(tasks[name].options), "")
        yield from _actions(tasks[name], below, report, capabilities, total_s)


def _head(mission: Mission, report: CheckReport, platform: Platform | None) -> Iterator[str]:
    policies = mission.policies
    yield _cut(f"{mission.name}   (frame {mission.frame})", WIDTH)
    figures = report.estimate
    if figures is not None:
        power = platform.power if platform is not None else None
        yield about(figures, power.usable_wh if power is not None else 0.0)
    yield from wrap(", ".join(answers(policies)), WIDTH)


def answers(policies: Policies) -> list[str]:
    """The mission's failsafe policies, in words."""
    reported = [f"on failure {policies.on_failure}", f"link loss {policies.on_link_loss}"]
    reported += [f"overdue {policies.on_overdue}"] if policies.on_overdue is not None else []
    reported += [f"low battery {policies.on_low_battery}", f"pose lost {policies.on_pose_lost}"]
    reported += [f"obstacle {policies.on_obstacle}"] if policies.on_obstacle != "continue" else []
    reported += [f"component fault {policies.on_component_fault}"] if policies.on_component_fault != "continue" else []
    return reported


def _actions(
    task: Task, prefix: str, report: CheckReport, capabilities: Mapping[str, Capability], total_s: float
) -> Iterator[str]:
    order = {name: action.options.after for name, action in task.actions.items()}
    for name, mark, below in _layered(order, "○", "│"):
        action = task.actions[name]
        claims = capabilities[action.ability].claims if action.ability in capabilities else ()
        relations = [*([f"until {action.options.until}"] if action.options.until else []), *_relations(action.options)]
        relations += [f"claims {', '.join(claims)}"] if claims else []
        bar = ""
        if report.estimate is not None and total_s > 0.0:
            part = report.estimate.actions.get(f"{task.name}.{name}")
            bar = _bar(part.start_s / total_s, part.end_s / total_s) if part is not None else ""
        yield from _item(prefix + mark, prefix + below, name, summary(action), relations, bar)


def _item(mark: str, below: str, name: str, what: str, relations: list[str], bar: str) -> Iterator[str]:
    """An item's line, and its relations, beside its name or in a second line."""
    text = f"{mark} {name}" + (f"  {what}" if what else "")
    beside = f"{text}  ({'; '.join(relations)})" if relations else text
    if len(beside) <= _LEFT:
        yield f"{beside:<{_LEFT}} {bar}"
        return
    yield f"{_cut(text, _LEFT):<{_LEFT}} {bar}"
    if relations:
        begin = f"{below}   "
        reported = f"({'; '.join(relations)})"
        yield from (begin + line for line in wrap(reported, WIDTH - len(begin), break_on_hyphens=False))


def _relations(options: ItemFile) -> list[str]:
    found = [f"after {', '.join(options.after)}"] if options.after else []
    found += terms(options)
    return found


def terms(options: ItemFile) -> list[str]:
    """The options of a task or action besides its order, in words."""
    found: list[str] = []
    if isinstance(options, TaskOptions) and options.platform is not None:
        wanted = options.platform
        found.append(f"on {wanted if isinstance(wanted, str) else ' or '.join(wanted)}")
    if isinstance(options, TaskOptions) and options.repeat is not None:
        until = f", until {options.repeat.until}" if options.repeat.until is not None else ""
        found.append(f"up to {options.repeat.times} times{until}" if until else f"{options.repeat.times} times")
    if isinstance(options, TaskOptions) and options.flown_by == "autopilot":
        found.append("flown by the autopilot")
    if options.when is not None:
        found.append(f"when {options.when}, else {options.otherwise}")
    if options.deadline_s is not None:
        found.append(f"deadline {options.deadline_s:g} s")
    if options.silence is not None:
        found.append(f"silent for {options.silence.expected_s:g} s")
    if options.on_failure is not None:
        found.append(f"on failure {options.on_failure}")
    if options.retries:
        found.append(f"retries {options.retries}")
    return found


def _layered(after: Mapping[str, tuple[str, ...]], dot: str, rail: str) -> Iterator[tuple[str, str, str]]:
    """Names by depth in the order, each with the prefix drawn before it and before the lines below it."""
    depth: dict[str, int] = {}
    while len(depth) < len(after):
        for name, earlier in after.items():
            if name not in depth and all(one in depth for one in earlier):
                depth[name] = 1 + max((depth[one] for one in earlier), default=0)
    last = max(depth.values(), default=0)
    for level in range(1, last + 1):
        names = [name for name in after if depth[name] == level]
        for index, name in enumerate(names):
            goes_on = level < last or index + 1 < len(names)
            line = rail if goes_on else " "
            if len(names) == 1:
                yield name, dot, f"{line} "
            else:
                yield name, f"{'├' if goes_on else '╰'}─{dot}", f"{line}   "


def _bar(start: float, end: float) -> str:
    first = min(_BAR - 1, int(start * _BAR))
    length = max(1, round(end * _BAR) - first)
    return " " * first + "━" * min(length, _BAR - first)


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 1] + "…"


def summary(action: Action) -> str:
    """An action's capability and arguments in a few words."""
    return " ".join([action.capability, *_words(action.arguments)])


def _words(arguments: Arguments) -> Iterator[str]:
    if isinstance(arguments, FlyFileOrder):
        yield f"{arguments.file}, {counted(len(arguments.items), 'item')}"
        return
    entries = msgspec.to_builtins(arguments).items()
    for key, value in sorted(entries, key=lambda entry: not isinstance(entry[1], list | tuple)):
        word, unit = split_unit(key)
        if isinstance(value, list | tuple):
            named = _LISTS.get(word, word)
            yield f"{len(value)} {named}" if value and isinstance(value[0], list | tuple) else named
        elif isinstance(value, dict):
            yield f"{word} {next(iter(value), '')}"
        elif isinstance(value, float | int) and not isinstance(value, bool):
            yield f"{word} {value:g} {unit}".rstrip()
        elif key == "camera":
            yield str(value)
        else:
            yield f"{word} {value}"


def mermaid(mission: Mission) -> str:
    """The partial order as a Mermaid flowchart: tasks as boxes of actions, `until` as dotted arrows."""
    lines = ["flowchart LR"]
    for task in (*mission.tasks.values(), *mission.contingencies.values()):
        reported = "".join(f"<br/>{term}" for term in terms(task.options))
        reported += "<br/>failsafe policies" if task.name in mission.contingencies else ""
        lines.append(
            f'    subgraph {_id(task.name)}["{task.name}{reported}"]'
            if reported
            else f"    subgraph {_id(task.name)}[{task.name}]"
        )
        lines += [
            f'        {_id(task.name, action.name)}["{action.name}<br/>{summary(action)}"]'
            for action in task.actions.values()
        ]
        for action in task.actions.values():
            here = _id(task.name, action.name)
            lines += [f"        {_id(task.name, name)} --> {here}" for name in action.options.after]
            if action.options.until is not None:
                lines.append(f"        {here} -. until .-> {_id(task.name, action.options.until)}")
        lines.append("    end")
    for task in mission.tasks.values():
        lines += [f"    {_id(name)} --> {_id(task.name)}" for name in task.options.after]
    return "\n".join(lines) + "\n"


def _id(*names: str) -> str:
    return "t_" + "__".join(name.replace("-", "_") for name in names)
