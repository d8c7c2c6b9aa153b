"""The partial order of a mission: its references and cycles, and which actions can overlap."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from gloc3.documents.document import Document, Where
from gloc3.errors import Finding, nearest
from gloc3.mission.model.model import ActionFile, ItemFile, Mission, Task, TaskOptions, where_of

MAX_ACTIONS: Final = 500


@dataclass(frozen=True, kw_only=True, slots=True)
class Tasks:
    """The tasks of a mission, or its contingencies."""

    document: Document
    """The document that contains them under `tasks`."""
    read: dict[str, Task]
    """Lack the actions that are not usable."""
    skeleton: dict[str, TaskOptions]
    """As written."""
    actions: dict[str, ActionFile]
    """What each `TASK.ACTION` takes beside its capability, also of actions that are not usable."""


def structure_findings(reading: Tasks) -> list[Finding]:
    """Unknown names in `after` and `until`, cycles, and too many actions."""
    document = reading.document
    if len(reading.actions) > MAX_ACTIONS:
        return [document.finding(("tasks",), f"more than {MAX_ACTIONS} actions", "split the mission", at_key=True)]
    found = list(_without_platform(reading.skeleton, document))
    for where, name, siblings in _references(reading.skeleton, reading.actions):
        if name not in siblings:
            found.append(document.finding(where, f"no {_kind(where)} {name!r} here", nearest(name, siblings)))
    for cycle in _cycles(_edges(reading.skeleton, reading.actions)):
        shown = " -> ".join([*cycle, cycle[0]])
        hint = "one of them must come first"
        found.append(document.finding(where_of(cycle[0]), f"these wait for each other: {shown}", hint, at_key=True))
    return found


def _without_platform(tasks: Mapping[str, TaskOptions], document: Document) -> Iterator[Finding]:
    """Findings for tasks without a platform: in a mission for several platforms each task names one."""
    named = [task for task in tasks.values() if task.platform is not None]
    example = min((task.performer for task in named if task.performer), default="any")
    for name, task in tasks.items():
        if named and task.platform is None:
            hint = f"add platform: {example}"
            message = f"task {name!r} names no platform, and others do"
            yield document.finding(where_of(name), message, hint, at_key=True)


def _kind(where: Where) -> str:
    return "action" if "actions" in where else "task"


def _siblings(target: str, actions: Mapping[str, ActionFile]) -> list[str]:
    task = target.partition(".")[0] + "."
    return [name.removeprefix(task) for name in actions if name.startswith(task)]


def _references(
    tasks: Mapping[str, ItemFile], actions: Mapping[str, ActionFile]
) -> Iterator[tuple[Where, str, list[str]]]:
    """Every name in an `after` or `until`, with its place and the names that are possible."""
    for task, item in tasks.items():
        others = [name for name in tasks if name != task]
        for index, name in enumerate(item.after):
            yield (*where_of(task), "after", index), name, others
    for target, action in actions.items():
        own = target.partition(".")[2]
        others = [name for name in _siblings(target, actions) if name != own]
        for index, name in enumerate(action.after):
            yield (*where_of(target), "after", index), name, others
        if action.until is not None:
            yield (*where_of(target), "until"), action.until, others


Graph = dict[str, list[str]]
"""Event (`start TARGET` or `end TARGET`) to the events that come before it."""


def _edges(tasks: Mapping[str, ItemFile], actions: Mapping[str, ActionFile]) -> Graph:
    graph: Graph = {}
    for task, item in tasks.items():
        graph[f"start {task}"] = [f"end {name}" for name in item.after if name in tasks and name != task]
        graph[f"end {task}"] = [f"start {task}"]
    for target, action in actions.items():
        task = target.partition(".")[0]
        known = [name for name in _siblings(target, actions) if f"{task}.{name}" != target]
        graph[f"start {target}"] = [f"start {task}", *(f"end {task}.{name}" for name in action.after if name in known)]
        graph[f"end {target}"] = [f"start {target}"]
        if action.until in known:
            graph[f"end {target}"].append(f"end {task}.{action.until}")
        graph.setdefault(f"end {task}", []).append(f"end {target}")
    return graph


def sorted_events(graph: Graph) -> tuple[list[str], Graph]:
    """Events in a possible order, and the rest that is part of cycles."""
    followers: Graph = {event: [] for event in graph}
    missing = dict.fromkeys(graph, 0)
    for event, before in graph.items():
        for earlier in before:
            followers[earlier].append(event)
            missing[event] += 1
    ready = [event for event in graph if missing[event] == 0]
    done: list[str] = []
    for event in ready:
        done.append(event)
        for later in followers[event]:
            missing[later] -= 1
            if missing[later] == 0:
                ready.append(later)
    left = {event for event in graph if missing[event] > 0}
    return done, {event: [e for e in graph[event] if e in left] for event in graph if event in left}


def _cycles(graph: Graph) -> Iterator[list[str]]:
    """The targets of each cycle, in the order in which they wait for each other; disjoint ones only."""
    _, left = sorted_events(graph)
    while left:
        path: list[str] = []
        event = next(iter(left))
        while event not in path:
            path.append(event)
            event = left[event][0]
        cycle = path[path.index(event) :]
        targets = list(dict.fromkeys(event.partition(" ")[2] for event in reversed(cycle)))
        actions = [target for target in targets if "." in target]
        yield [target for target in targets if not any(action.startswith(target + ".") for action in actions)]
        _, left = sorted_events(
            {e: [b for b in before if b not in cycle] for e, before in left.items() if e not in cycle}
        )


@dataclass(frozen=True, slots=True)
class PartialOrder:
    """Order in which a mission's actions run, as far as it is fixed."""

    targets: tuple[str, ...]
    """The actions, `TASK.ACTION`, in an order in which they can run."""
    ended: Mapping[str, frozenset[str]]
    """Action to the actions that have ended when it starts."""

    @classmethod
    def of(cls, mission: Mission) -> "PartialOrder":
        """The order of a mission that has no cycles."""
        actions = {target: action.options for target, action in mission.actions().items()}
        tasks = {name: task.options for name, task in mission.tasks.items()}
        events, _ = sorted_events(_edges(tasks, actions))
        targets = tuple(e.removeprefix("start ") for e in events if e.startswith("start ") and "." in e)
        ends_with: dict[str, list[str]] = {}
        for target, action in actions.items():
            if action.until is not None:
                ends_with.setdefault(f"{target.partition('.')[0]}.{action.until}", []).append(target)
        of_task: dict[str, frozenset[str]] = {}
        for event in events:
            name = event.removeprefix("end ")
            if event.startswith("end ") and name in tasks:
                before = [of_task[other] for other in tasks[name].after]
                own = frozenset(t for t in targets if t.startswith(name + "."))
                of_task[name] = own.union(*before)
        ended: dict[str, frozenset[str]] = {}
        for target in targets:
            task = target.partition(".")[0]
            found = set[str]().union(*(of_task[other] for other in tasks[task].after))
            for other in actions[target].after:
                # an action that is not usable itself has findings of its own, and is not in the mission
                found |= {f"{task}.{other}"} | ended.get(f"{task}.{other}", frozenset())
            waiting = list(found)
            while waiting:
                for companion in ends_with.get(waiting.pop(), ()):
                    if companion not in found:
                        found.add(companion)
                        waiting.append(companion)
            ended[target] = frozenset(found)
        return cls(targets, ended)

    def may_overlap(self, one: str, other: str) -> bool:
        """Whether two actions can run at the same time."""
        return one not in self.ended[other] and other not in self.ended[one]
