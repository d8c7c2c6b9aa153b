"""Whether the guards and loops of a mission can be judged on its platform, and come to an end."""

from collections.abc import Iterator

from gloc3.document import Document, Where
from gloc3.errors import Finding
from gloc3.mission.conditions import QUANTITIES, Condition
from gloc3.mission.model import ItemFile, Mission, where_of
from gloc3.platform import Platform


def guard_findings(mission: Mission, platform: Platform | None) -> Iterator[Finding]:
    """Waits without an end, words without a guard, and conditions on what nobody on the platform measures."""
    document = mission.document
    if document is None:
        return
    topics = None if platform is None or not platform.is_complete else platform.topics()
    for where, options in _items(mission):
        yield from _guard(document, where, options)
        if options.when is not None:
            yield from _measured(document, (*where, "when"), options.when, platform, topics)
    for name, task in mission.tasks.items():
        repeat = task.options.repeat
        if repeat is not None and repeat.until is not None:
            yield from _measured(document, (*where_of(name), "repeat", "until"), repeat.until, platform, topics)


def _items(mission: Mission) -> Iterator[tuple[Where, ItemFile]]:
    for name, task in mission.tasks.items():
        yield where_of(name), task.options
        for target, action in ((f"{name}.{one.name}", one) for one in task.actions.values()):
            yield where_of(target), action.options


def _guard(document: Document, where: Where, options: ItemFile) -> Iterator[Finding]:
    if options.when is None and "otherwise" in document.node(where).children:
        message, hint = "otherwise says what is done where when does not hold, and there is no when", "add when"
        yield document.finding((*where, "otherwise"), message, hint, at_key=True)
    elif options.when is not None and options.otherwise == "wait" and options.deadline_s is None:
        message, hint = "a wait that nothing may ever end", "give it deadline_s, which counts the wait too"
        yield document.finding((*where, "otherwise"), message, hint)


def _measured(
    document: Document, where: Where, condition: Condition, platform: Platform | None, topics: set[str] | None
) -> Iterator[Finding]:
    for name in sorted(condition.quantities):
        topic = QUANTITIES[name].topic
        if platform is not None and topics is not None and topic and topic not in topics:
            message = f"{QUANTITIES[name].words} is not known on {platform.platform}: nothing there tells {topic!r}"
            yield document.finding(where, message, "ask for something that it measures")
