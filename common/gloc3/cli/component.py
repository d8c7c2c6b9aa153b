"""`gloc3 component`: list components and describe them."""

from collections.abc import Iterable, Sequence
from typing import Annotated, Any

import msgspec
from cyclopts import App, Parameter

from gloc3.cli.tables import console, default_text, print_json, print_table, value_text
from gloc3.component.deployment import ComponentRow
from gloc3.component.description import KIND_NAMES, Description, FieldLine, PortLine, describe, find_class, installed
from gloc3.errors import Gloc3Error, nearest
from gloc3.messages.topics import TopicTable
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform

app = App(
    name="gloc3 component",
    help="""List components and describe them.

    For example:

    - `gloc3 component list --platform pelican`: what runs on a platform, at which rate, and as whose standby
    - `gloc3 component describe stereo_odometry`: its ports, settings with their units and bounds, functions
    - `gloc3 component describe my_package.wind:WindSampler`: a class of your own""",
    help_format="markdown",
    version_flags=[],
)

OnPlatform = Annotated[str | None, Parameter(help="A platform file, or the name of an installed platform.")]
AsJson = Annotated[bool, Parameter(name="--json", help="Print JSON instead of tables.")]


@app.command(name="list")
def list_components(*, platform: OnPlatform = None, json_output: AsJson = False) -> int:
    """List the installed component classes, or the components of a platform.

    Args:
        platform: The platform whose components are listed.
        json_output: Print JSON.
    """
    rows = _installed_rows() if platform is None else _platform_rows(load_platform(platform))
    if json_output:
        print_json(rows)
    elif not rows:
        console().print("no component is installed; packages provide them as gloc3.components entry points")
    else:
        shown = [{**row, "class": row["class"].rpartition(":")[2]} for row in rows] if platform else rows
        print_table(list(rows[0]), [[value_text(value) for value in row.values()] for row in shown])
    return 0


@app.command(name="describe")
def describe_component(name: str, /, *, platform: OnPlatform = None, json_output: AsJson = False) -> int:
    """Describe a component: ports, settings with units, functions, loggable items.

    Args:
        name: Of an installed component, of a component of the platform, or `package.module:Class`.
        platform: The deployment that binds the ports and sets the settings.
        json_output: Print JSON.
    """
    topics = TopicTable.installed()
    if platform is None:
        row, found = None, describe(find_class(name), topics)
    else:
        row = _row_of(load_platform(platform), name)
        cls = row.load_class()
        bound = {port: row.topics(port) for port in (*cls.inputs, *cls.outputs)}
        found = describe(cls, topics, bound)
    if json_output:
        print_json({**msgspec.to_builtins(found), "row": row})
    else:
        _print_description(found, row)
    return 0


def _row_of(platform: Platform, name: str) -> ComponentRow:
    row = platform.component(name)
    if row is None:
        hint = nearest(name, [row.name for row in platform.components])
        raise Gloc3Error(f"platform {platform.platform} has no component {name!r} ({hint})")
    return row


def _installed_rows() -> list[dict[str, Any]]:
    rows = []
    for name, path in installed().items():
        try:
            cls = find_class(path)
        except Gloc3Error as error:
            rows.append({"name": name, "kind": "?", "class": path, "what it does": str(error)})
        else:
            first = (cls.__doc__ or "").strip().partition("\n")[0]
            rows.append({"name": name, "kind": cls.kind, "class": path, "what it does": first})
    return rows


def _platform_rows(platform: Platform) -> list[dict[str, Any]]:
    return [
        {
            "name": row.name,
            "kind": row.load_class().kind,
            "class": row.class_name,
            "rate_hz": row.rate_hz,
            "trigger": row.trigger,
            "begin": row.begin,
            "required": row.required,
            "standby_for": row.standby_for,
        }
        for row in platform.components
    ]


# --- what is shown ---


def _print_description(found: Description, row: ComponentRow | None) -> None:
    to = console()
    to.print(f"[bold]{found.class_path}[/bold]  {found.kind}, {KIND_NAMES[found.kind]}", highlight=False)
    to.print(found.doc, markup=False)
    if row is not None:
        cycles = [f"{row.rate_hz:g} Hz"] if row.rate_hz else []
        cycles += [f"triggered by {', '.join(row.triggers)}"] if row.triggers else []
        to.print(f"\nhere: {row.name}, {', '.join(cycles)}, begins {row.begin}", markup=False)
    if found.devices:
        to.print(f"\ndevices: {', '.join(found.devices)}", markup=False)
    _print_ports("inputs", found.inputs)
    _print_ports("outputs", found.outputs)
    given = row.settings if row is not None else {}
    _print_fields("settings", found.settings, given)
    if found.functions:
        print_table(
            ["functions", "arguments", "reply", ""],
            [[f.name, _signature(f.arguments), _signature(f.results), f.doc] for f in found.functions],
        )
    if found.loggable:
        to.print(f"\nloggable: {', '.join(found.loggable)}", markup=False)


def _print_ports(title: str, ports: Sequence[PortLine]) -> None:
    if ports:
        print_table(
            [title, "message", "topics", "rate", "frame" if title == "outputs" else "keeps"],
            [[p.name, p.message, ", ".join(p.topics), _rate(p.rate_hz), p.frame or p.queue] for p in ports],
        )


def _print_fields(title: str, fields: Sequence[FieldLine], given: dict[str, Any]) -> None:
    if not fields:
        return
    columns = [title, "type", "bounds", "default", *(["here"] if given else []), ""]
    lines = []
    for field in fields:
        here = [value_text(given[field.name]) if field.name in given else ""] if given else []
        lines.append([field.name, field.type, field.bounds, default_text(field), *here, field.doc])
    print_table(columns, lines)


def _signature(fields: Iterable[FieldLine]) -> str:
    return ", ".join(
        f"{f.name}: {f.type}" + (f" ({f.bounds})" if f.bounds else "") + ("" if f.is_required else " ?") for f in fields
    )


def _rate(rate_hz: float | None) -> str:
    if rate_hz is None:
        return ""
    return f"{rate_hz:g} Hz" if rate_hz else "on events"
