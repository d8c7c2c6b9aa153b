"""`docs/reference/`: what is defined, from the code: commands, components, topics, messages, states, events, files, MAVLink…"""

import inspect
import pkgutil
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Final

from tests.house import events, file_formats, mavlink, state_tables
from tests.house.table import plain, table

import gloc3.messages as messages_package
from gloc3.cli.program import prepared
from gloc3.component.description import FieldLine, describe, fields_of, find_class, installed
from gloc3.installed import installed_points
from gloc3.messages.envelope import Message
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.topics import TopicTable
from gloc3.mission.model.arguments import argument_kinds
from gloc3_groundstation.reporting.outcomes import RunOutcome
from gloc3_sitl.proof.standard_invariants import STANDARD

FOLDER: Final = Path(__file__).parents[2] / "docs" / "reference"
MADE: Final = "This page is generated from the code by `make docs`; a test compares it.\n"
OWN: Final = "gloc3"
"""Beginning of our modules' names; packages that happen to be installed are left out."""
GROUPS: Final[Mapping[str, str]] = {
    "gloc3.commands": "a subcommand of `gloc3`: a cyclopts `App`",
    "gloc3.mission_commands": "a subcommand of `gloc3 mission`",
    "gloc3.log_commands": "a subcommand of `gloc3 log`",
    "gloc3.network_commands": "a subcommand of `gloc3 network`",
    "gloc3.components": "a component: a class",
    "gloc3.capabilities": "the arguments of a capability: a subclass of `Arguments`",
    "gloc3.topics": "rows of topics: a mapping from topic to `TopicRow`",
    "gloc3.devices": "a kind of device of components: a class",
    "gloc3.sensors": "kinds of sensors and sources: a module with `SENSORS` or `SOURCES`",
    "gloc3.platforms": "platform files: a package whose folder holds them",
    "gloc3.invariants": "an invariant of `gloc3 prove`: a subclass of `Invariant`",
    "gloc3.plan_formats": "a format of plan files: a `PlanFormat`",
    "gloc3.screens": "a screen of the station: a subclass of `PlugInScreen`",
    "gloc3.overview_lines": "a line of the station's overview: a function",
    "gloc3.alert_rules": "a rule of alerts: a function",
}


def pages() -> dict[Path, Callable[[], str]]:
    """Every page with what makes its text."""
    made: dict[str, tuple[str, Callable[[], Iterable[str]]]] = {
        "commands": ("Commands", commands),
        "components": ("Components", components),
        "topics": ("Topics", topics),
        "messages": ("Messages", messages),
        "capabilities": ("Capabilities", capabilities),
        "states": ("State tables", state_tables.lines),
        "events": ("Events and alerts", events.lines),
        "mission-file": ("Fields of mission files", file_formats.mission),
        "platform-file": ("Fields of platform files", file_formats.platform),
        "station-lines": ("JSON lines of the station", file_formats.station_lines),
        "invariants": ("Invariants", invariants),
        "mavlink": ("MAVLink messages and commands", mavlink.lines),
        "entry-points": ("Entry points", entries),
    }
    return {FOLDER / f"{name}.md": partial(_text, title, lines) for name, (title, lines) in made.items()}


def _text(title: str, lines: Callable[[], Iterable[str]]) -> str:
    return "\n".join([f"# {title}\n", MADE, *lines()]).rstrip() + "\n"


def commands() -> Iterator[str]:
    """Commands with their options, and exit codes."""
    yield "Exit codes of all commands: 0 done, 1 failed, 2 wrong use, 130 interrupted. `gloc3 station --headless` has more:\n"
    yield from table(("code", "outcome"), ((str(one.exit_code), one.value.replace("_", " ")) for one in RunOutcome))
    for point in sorted(installed_points("gloc3.commands"), key=lambda point: point.name):
        if not point.value.startswith(OWN):
            continue
        text = prepared(point.load()).generate_docs(heading_level=2, usage_name="gloc3")
        text = re.sub(r"^#+ Table of Contents\n(\n|\s+- .*\n)*", "", text, flags=re.MULTILINE)
        text = re.sub(r"\[(`[^`]+`)\]\(#[\w-]+\)", r"\1", text)
        yield "\n".join(_command_lines(text, point.name)).rstrip() + "\n"


def _command_lines(text: str, name: str) -> Iterator[str]:
    """Lines of help, with headings by their depth; a usage begins with the command of its heading."""
    command = f"gloc3 {name}"
    for line in text.splitlines():
        if heading := re.fullmatch(r"#+ (.*)", line):
            command = " ".join(["gloc3", *heading[1].removeprefix("gloc3").split()])
            yield f"{'#' * len(command.split())} `{command}`"
        elif line.startswith("gloc3 "):
            taken = re.search(r"(?= (\[|[A-Z]|--))", line)
            yield command + (line[taken.start() :] if taken else "")
        else:
            yield line


def components() -> Iterator[str]:
    """Components with ports and settings."""
    known = TopicTable.installed()
    for name, path in sorted((name, path) for name, path in installed().items() if path.startswith(OWN)):
        found = describe(find_class(path), known)
        yield f"## {name}\n"
        yield f"{found.kind.value}, `{found.class_path}`: {plain(found.doc)}\n"
        ports = [("input", port) for port in found.inputs] + [("output", port) for port in found.outputs]
        if ports:
            rows = (
                (way, f"`{port.name}`", f"[{port.message}](messages.md#{port.message.lower()})", port.queue)
                for way, port in ports
            )
            yield from table(("port", "name", "message", "keeps"), rows)
        if found.settings:
            yield from table(("setting", "type", "bounds", "default", "meaning"), map(_setting, found.settings))


def topics() -> Iterator[str]:
    """Topics of the exchanger."""
    yield "Names are relative to the platform. A topic without a rate carries events.\n"
    rows = (
        (
            f"`{name}`",
            f"[{row.message.__name__}](messages.md#{row.message.__name__.lower()})",
            f"{row.rate_hz:g} Hz" if row.rate_hz else "",
            row.travels.value,
            "yes" if row.is_logged else "no",
        )
        for name, row in TOPICS.items()
    )
    yield from table(("topic", "message", "rate", "travels as", "logged"), rows)


def messages() -> Iterator[str]:
    """Message types with their fields."""
    for name, kind in sorted(_messages().items()):
        yield f"## {name}\n"
        yield f"{plain(inspect.getdoc(kind) or '')}\n"
        rows = ((f"`{field.name}`", f"`{field.type}`", _default(field), field.doc) for field in fields_of(kind))
        yield from table(("field", "type", "default", "meaning"), rows)


def capabilities() -> Iterator[str]:
    """Capabilities with their arguments."""
    yield "A platform file says which of them a vehicle has, and which component performs each.\n"
    for name, kind in sorted(
        (name, kind) for name, kind in argument_kinds().items() if kind.__module__.startswith(OWN)
    ):
        yield f"## {name}\n"
        yield f"{plain(inspect.getdoc(kind) or '')}\n"
        fields = fields_of(kind)
        if fields:
            yield from table(("argument", "type", "bounds", "default", "meaning"), map(_setting, fields))


def invariants() -> Iterator[str]:
    """What `gloc3 prove` judges flights by."""
    yield from table(("name", "what must hold"), ((f"`{one.name}`", one.sentence) for one in STANDARD))


def entries() -> Iterator[str]:
    """Groups of entry points, by which other packages add to GLOC3."""
    rows = []
    for group, what in GROUPS.items():
        own = sorted(point.name for point in entry_points(group=group) if point.value.startswith(OWN))
        rows.append((f"`{group}`", what, ", ".join(own)))
    yield from table(("group", "what it names", "GLOC3's own"), rows)


def _messages() -> dict[str, type[Message]]:
    """Those of `gloc3.messages`, of topics and of our components' ports."""
    names = [module.name for module in pkgutil.iter_modules(messages_package.__path__, "gloc3.messages.")]
    kinds = [kind for name in names for kind in vars(import_module(name)).values()]
    kinds += [row.message for row in TOPICS.values()]
    for path in installed().values():
        if path.startswith(OWN):
            component = find_class(path)
            kinds += [port.message for port in (*component.inputs.values(), *component.outputs.values())]
    return {
        kind.__name__: kind
        for kind in kinds
        if isinstance(kind, type) and issubclass(kind, Message) and kind is not Message
    }


def _setting(field: FieldLine) -> Sequence[str]:
    return f"`{field.name}`", f"`{field.type}`", field.bounds, _default(field), field.doc


def _default(field: FieldLine) -> str:
    return "required" if field.is_required else f"`{field.default!r}`"
