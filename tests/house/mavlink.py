"""`docs/reference/mavlink.md`: MAVLink messages and commands that each side handles."""

import ast
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Final

from tests.house.table import table

from gloc3.errors import Misuse
from gloc3.mavlink import codec
from gloc3.mavlink.codec import enum_name
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.calibration_ardupilot import ACCELEROMETER_POSITION
from gloc3_groundstation.station import readings
from gloc3_onboard.autopilot.arm_authority import ARM_AUTHORIZATION_REQUEST
from gloc3_onboard.companion import cameras, commands, gimbal
from gloc3_sitl.autopilot.mavlink.commands import HANDLERS
from gloc3_sitl.autopilot.mavlink.listeners import LISTENERS

ROOT: Final = Path(__file__).parents[2]
SIDES: Final = {
    "Common services": ("common/gloc3",),
    "The onboard computer": ("onboard/gloc3_onboard",),
    "The ground station": ("groundstation/gloc3_groundstation",),
    "The embedded autopilot and simulated devices": (
        "sitl/gloc3_sitl/autopilot",
        "sitl/gloc3_sitl/sensors",
        "sitl/gloc3_sitl/vehicles",
    ),
}
TABLES: Final[Mapping[str, Collection[str]]] = {
    "gloc3_sitl.autopilot.mavlink.listeners": LISTENERS,
    "gloc3_groundstation.station.readings": readings.MESSAGES,
}
"""Modules with a table of the messages that they handle."""
NAMES: Final = {611: "DO_SET_GLOBAL_ORIGIN", 32100: "REQUEST_OPERATOR_CONTROL"}
"""Commands that the dialect in use does not have."""
COMMANDS: Final[Mapping[str, Collection[int]]] = {
    "onboard computer (component 191)": commands.HANDLED,
    "its cameras (components 100 to 105)": cameras.HANDLED,
    "its gimbal manager": (gimbal.CONFIGURE, gimbal.PITCH_YAW, gimbal.POINT_AT, gimbal.POINT_NOWHERE),
    "its driver, asked by the autopilot": frozenset({ARM_AUTHORIZATION_REQUEST}),
    "ground station, asked by the autopilot": frozenset({ACCELEROMETER_POSITION}),
    "embedded autopilot": HANDLERS,
}


def lines() -> Iterator[str]:
    """The page."""
    yield (
        "Messages by the module that handles them, read from the source. The common services run on both sides: clients at "
        "the station and onboard, servers onboard and in the [embedded autopilot](../embedded-autopilot.md).\n"
    )
    for title, folders in SIDES.items():
        found: dict[str, list[str]] = {}
        for folder in folders:
            package = ROOT / folder
            for file in sorted(package.rglob("*.py")):
                module = ".".join(file.relative_to(ROOT).with_suffix("").parts[1:]).removesuffix(".__init__")
                if names := handled(module, file.read_text(encoding="utf-8")):
                    found[f"`{module}`"] = sorted(names)
        yield f"## {title}\n"
        yield from table(("module", "messages"), ((module, ", ".join(names)) for module, names in found.items()))
    yield "## Commands\n"
    yield (
        "`MAV_CMD` in `COMMAND_LONG` and `COMMAND_INT`. What the onboard computer does with each: "
        "[companion-services.md](../companion-services.md#commands). The embedded autopilot answers some as unsupported, by "
        "its style and vehicle.\n"
    )
    rows = ((side, ", ".join(_command(number) for number in sorted(numbers))) for side, numbers in COMMANDS.items())
    yield from table(("side", "commands"), rows)


def handled(module: str, source: str) -> set[str]:
    """Names of the messages that a module handles.

    Microservices declare them; another module names them in a `case`, compares them with a message's name, keeps their
    numbers, or has a table of them.
    """
    if "handles" in source:
        kinds = [one for one in vars(import_module(module)).values() if isinstance(one, type)]
        own = [one for one in kinds if issubclass(one, Microservice) and one.__module__ == module]
        if declared := {name for one in own for name in one.handles}:
            return declared
    found = set(TABLES.get(module, ()))
    for node in ast.walk(ast.parse(source)) if re.search(r"\.(name|id)\b", source) else ():
        match node:
            case ast.Match(subject=ast.Attribute(attr="name")):
                patterns = [value for case in node.cases for value in ast.walk(case.pattern)]
                found.update(_texts(one.value for one in patterns if isinstance(one, ast.MatchValue)))
            case ast.Compare(left=ast.Attribute(attr="name"), ops=[ast.Eq() | ast.In()]):
                found.update(_texts(ast.walk(node.comparators[0])))
            case ast.Assign(value=value):
                found.update(_number_of(value))
    return {name for name in found if _is_message(name)}


def _texts(nodes: Iterable[ast.AST]) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def _number_of(value: ast.expr) -> Iterator[str]:
    """The messages whose numbers are kept under a name: `shape("HEARTBEAT").id`."""
    for one in value.elts if isinstance(value, ast.Tuple) else (value,):
        if isinstance(one, ast.Attribute) and one.attr == "id" and isinstance(one.value, ast.Call):
            yield from _texts(one.value.args)


def _is_message(name: str) -> bool:
    try:
        codec.shape(name)
    except Misuse:
        return False
    return True


def _command(number: int) -> str:
    name = NAMES.get(number) or enum_name("MAV_CMD", number).removeprefix("MAV_CMD_")
    return f"{name} ({number})"
