"""Description of a component class as data: ports, settings, functions, loggable items."""

import inspect
import types
import typing
from enum import Enum
from importlib import import_module
from typing import Any, Final

import msgspec

from gloc3.component.component import Component, FunctionEntry
from gloc3.component.deployment import COMPONENTS
from gloc3.component.functions import GENERIC
from gloc3.component.ports import Input, Port
from gloc3.component.settings import field_docs
from gloc3.errors import Gloc3Error, nearest
from gloc3.installed import installed_points
from gloc3.messages.envelope import Kind
from gloc3.messages.topics import TopicTable

KIND_NAMES: Final = {
    Kind.SAMPLER: "sensor sampler",
    Kind.PROCESSOR: "data processor",
    Kind.CONTROLLER: "controller",
    Kind.DRIVER: "actuator driver",
    Kind.COMMAND_INTERFACE: "command interface",
}


class FieldLine(msgspec.Struct, frozen=True, kw_only=True):
    """One setting, or one argument or result of a function."""

    name: str
    type: str
    default: Any = None
    """None where a value is required."""
    is_required: bool = False
    bounds: str = ""
    doc: str = ""


class PortLine(msgspec.Struct, frozen=True, kw_only=True):
    """One input or output."""

    name: str
    message: str
    topics: tuple[str, ...]
    """Topics it is bound to; without a deployment, its own name."""
    rate_hz: float | None
    """Nominal rate of the first topic; 0 for an event topic, None for an unknown one."""
    frame: str = ""
    queue: str = ""
    """Of an input: what its bounded queue keeps."""


class FunctionLine(msgspec.Struct, frozen=True, kw_only=True):
    """One function message that it answers."""

    name: str
    doc: str
    arguments: tuple[FieldLine, ...]
    results: tuple[FieldLine, ...]


class Description(msgspec.Struct, frozen=True, kw_only=True):
    """A component's class."""

    class_path: str
    kind: Kind
    doc: str
    inputs: tuple[PortLine, ...]
    outputs: tuple[PortLine, ...]
    devices: tuple[str, ...]
    settings: tuple[FieldLine, ...]
    functions: tuple[FunctionLine, ...]
    loggable: tuple[str, ...]


def installed() -> dict[str, str]:
    """The component classes of all installed packages: name to `package.module:Class`."""
    return {point.name: point.value for point in installed_points(COMPONENTS)}


def find_class(name: str) -> type[Component[Any]]:
    """The class of an installed component's name, or of `package.module:Class`.

    Raises:
        Gloc3Error: there is none.
    """
    known = installed()
    path = known.get(name, name)
    module_name, colon, class_name = path.partition(":")
    if not colon:
        hint = nearest(name, list(known)) if known else "give package.module:Class"
        raise Gloc3Error(f"no installed component is called {name!r} ({hint})")
    try:
        found = getattr(import_module(module_name), class_name)
    except (ImportError, AttributeError, ValueError) as error:
        raise Gloc3Error(f"cannot load {path!r}: {error}") from error
    if not (isinstance(found, type) and issubclass(found, Component)):
        raise Gloc3Error(f"{path!r} is not a component class")
    if inspect.isabstract(found) or not hasattr(found, "settings_type"):
        raise Gloc3Error(f"{path!r} is a base of components, not one itself")
    return found


def describe(
    component: type[Component[Any]], topics: TopicTable, bound: typing.Mapping[str, typing.Sequence[str]] | None = None
) -> Description:
    """Describes a class.

    Args:
        component: the class.
        topics: the topics that are known, for the rates.
        bound: port to topics, as a deployment binds them.
    """

    def line(port: Port[Any]) -> PortLine:
        names = tuple((bound or {}).get(port.name, (port.name,)))
        row = topics.row(f"platform/{names[0]}") if names else None
        return PortLine(
            name=port.name,
            message=port.message.__name__,
            topics=names,
            rate_hz=row.rate_hz if row is not None else None,
            frame=getattr(port, "frame", ""),
            queue=f"{port.keep}, {port.depth}" if isinstance(port, Input) else "",
        )

    return Description(
        class_path=f"{component.__module__}:{component.__qualname__}",
        kind=component.kind,
        doc=inspect.getdoc(component) or "",
        inputs=tuple(line(port) for port in component.inputs.values()),
        outputs=tuple(line(port) for port in component.outputs.values()),
        devices=tuple(inspect.signature(component).parameters),
        settings=fields_of(component.settings_type),
        functions=tuple(_function(entry) for entry in (*component.functions.values(), *GENERIC.values())),
        loggable=component.loggable,
    )


def _function(entry: FunctionEntry) -> FunctionLine:
    doc = inspect.cleandoc(entry.doc).partition("\n\n")[0]
    return FunctionLine(name=entry.name, doc=doc, arguments=fields_of(entry.request), results=fields_of(entry.reply))


def fields_of(struct: type[msgspec.Struct]) -> tuple[FieldLine, ...]:
    """A structure's fields with types, bounds, defaults and the text under each."""
    docs = field_docs(struct)
    lines = []
    for field in msgspec.structs.fields(struct):
        default = field.default
        if field.default_factory is not msgspec.NODEFAULT:
            default = field.default_factory()
        lines.append(
            FieldLine(
                name=field.encode_name,
                type=spell(field.type),
                default=None if field.required else msgspec.to_builtins(default),
                is_required=field.required,
                bounds=bounds_of(field.type),
                doc=" ".join(docs.get(field.name, "").split()),
            )
        )
    return tuple(lines)


def spell(annotation: Any) -> str:
    """A type as an integrator would write it."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return spell(arguments[0])
    if origin in (typing.Union, types.UnionType):
        return " | ".join(spell(argument) for argument in arguments)
    if origin is typing.Literal:
        return " | ".join(repr(argument) for argument in arguments)
    if origin is not None:
        inner = ", ".join("..." if argument is Ellipsis else spell(argument) for argument in arguments)
        return f"{origin.__name__}[{inner}]"
    if annotation in (None, type(None)):
        return "None"
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return " | ".join(str(member.value) for member in annotation)
    return getattr(annotation, "__name__", str(annotation))


def bounds_of(annotation: Any) -> str:
    """The range that an annotation allows; of a list, that of its items."""
    if typing.get_origin(annotation) is not typing.Annotated:
        found = {bounds_of(argument) for argument in typing.get_args(annotation)} - {""}
        return found.pop() if len(found) == 1 else ""
    limits = []
    for meta in annotation.__metadata__:
        if isinstance(meta, msgspec.Meta):
            limits += [
                f"{sign} {value:g}"
                for sign, value in ((">=", meta.ge), (">", meta.gt), ("<=", meta.le), ("<", meta.lt))
                if value is not None
            ]
    return ", ".join(limits)
