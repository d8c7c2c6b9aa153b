"""The platforms that were chosen for tasks which several may perform: `assigned` in a mission file."""

from collections.abc import Collection, Iterator, Mapping, Sequence

from msgspec import structs

from gloc3.documents.document import Document
from gloc3.errors import Finding, nearest
from gloc3.mission.model.model import EACH, TaskOptions


def with_platforms(tasks: Mapping[str, TaskOptions], assigned: Mapping[str, Sequence[str]]) -> dict[str, TaskOptions]:
    """The tasks with their platforms, each after the one before it in its platform's list; unknown names are ignored."""
    found = dict(tasks)
    for platform, names in assigned.items():
        before: tuple[str, ...] = ()
        for name in names:
            if name not in tasks or not tasks[name].is_for(platform):
                continue
            options = found[name]
            more = tuple(one for one in before if one not in options.after)
            chosen = options.platform if options.platform == EACH else platform
            found[name] = structs.replace(options, platform=chosen, after=(*options.after, *more))
            before = (name,)
    return found


def without_others(options: TaskOptions, own: Collection[str]) -> TaskOptions:
    """A task of each platform waits for that platform's own tasks alone."""
    if options.platform != EACH:
        return options
    return structs.replace(options, after=tuple(name for name in options.after if name in own))


def assignment_findings(
    document: Document, tasks: Mapping[str, TaskOptions], assigned: Mapping[str, Sequence[str]]
) -> Iterator[Finding]:
    """Tasks that are not there, that are assigned twice, and platforms that do not perform them."""
    whose: dict[str, str] = {}
    for platform, names in assigned.items():
        for index, name in enumerate(names):
            where = ("assigned", platform, index)
            if name not in tasks:
                yield document.finding(where, f"no task {name!r} here", nearest(name, list(tasks)))
                continue
            wanted = tasks[name].platform
            if not tasks[name].is_for(platform):
                message = f"{name} is not for {platform}"
                stated = ", ".join(wanted) if isinstance(wanted, tuple) else wanted or "the mission's own platform"
                yield document.finding(where, message, f"its platform: {stated}")
            elif wanted != EACH and name in whose:
                message = f"{name} is assigned to {whose[name]} already"
                yield document.finding(where, message, "remove it from one of the lists")
            whose.setdefault(name, platform)
