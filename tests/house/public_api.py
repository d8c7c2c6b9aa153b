"""`docs/public-api.md`: the Python names that scripts and packages of others may use, with their signatures."""

import ast
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from tests.house.measure import Module, read_modules

from gloc3_groundstation import api

Named = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef

ROOT: Final = Path(__file__).parents[2]
PAGE: Final = ROOT / "docs" / "public-api.md"
HEAD: Final = """\
# Public Python names

Scripts and packages of your own can rely on the names below; [stability.md](stability.md) says how one of them ends. This
page is generated from the source: `make docs` writes it, and a test compares it, so that no signature changes unnoticed.
Message types (`gloc3.messages`) are public as well; `gloc3 component describe` prints those of a component's ports.
"""
PUBLIC: Final[Mapping[str, tuple[str, ...]]] = {
    "gloc3.component.action": ("ActionPerformer",),
    "gloc3.component.component": (
        "Component",
        "SensorSampler",
        "DataProcessor",
        "Controller",
        "ActuatorDriver",
        "function",
    ),
    "gloc3.component.deployment": ("ComponentRow",),
    "gloc3.component.lci": ("State",),
    "gloc3.component.ports": ("Input", "Output", "PortGroup", "PortReport", "Actuation", "Inbox", "Result"),
    "gloc3.component.settings": ("Bounds", "NoSettings", "Settings"),
    "gloc3.component.test_bench": ("Bench",),
    "gloc3.errors": ("Finding", "Gloc3Error", "InputError", "Refused"),
    "gloc3.messages.envelope": ("Message", "Severity"),
    "gloc3.messages.topics": ("TopicRow",),
    "gloc3.mission.formats.items": ("ForeignPlan", "MavItem", "PlanEntry"),
    "gloc3.mission.formats.plan_format": ("PlanFormat",),
    "gloc3.mission.model.arguments": ("Arguments",),
    "gloc3.mission.model.legs": ("Budget",),
    "gloc3.mission.model.states": ("ActionState",),
    "gloc3_groundstation.api": tuple(api.__all__),
    "gloc3_groundstation.plug_ins": ("PlugInScreen",),
    "gloc3_groundstation.station.alerts": ("AlertCause",),
    "gloc3_groundstation.station.snapshots": ("Fleet", "PlatformSnapshot"),
    "gloc3_onboard.algorithms.fusion.pose_fusion": ("PoseFusion",),
    "gloc3_onboard.algorithms.fusion.settings": ("FusionSettings",),
}
"""Modules with their public names; message types are public as well."""
MESSAGES: Final = "gloc3.messages."
"""The message types below it are guarded by their hashes (`tests/compatibility`), not by the page."""


def page() -> str:
    """The page for this tree, its code as the formatter lays it out."""
    modules = read_modules(ROOT)
    text = "\n".join([HEAD, *(line for name in PUBLIC for line in _module_lines(modules[name]))])
    formatter = [sys.executable, "-m", "ruff", "format", "--stdin-filename", str(PAGE), "-"]
    return subprocess.run(formatter, cwd=ROOT, input=text, capture_output=True, text=True, check=True).stdout


def _module_lines(module: Module) -> Iterator[str]:
    yield f"## `{module.name}`\n"
    yield f"{(ast.get_docstring(module.tree) or '').partition(chr(10))[0]}\n"
    defined = {name: each for each in module.tree.body for name in _names_of(each)}
    others = [f"`{name}`" for name in PUBLIC[module.name] if name not in defined]
    if others:
        yield f"Imported from other modules: {', '.join(others)}.\n"
    for name in PUBLIC[module.name]:
        if (node := defined.get(name)) is None:
            continue
        yield f"### `{name}`\n"
        if isinstance(node, Named):
            yield f"{(ast.get_docstring(node) or '').partition(chr(10))[0]}\n"
        yield "\n".join(["```python", *_declared(node), "```", ""])


def _names_of(node: ast.stmt) -> Iterator[str]:
    match node:
        case ast.ClassDef(name=name) | ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
            yield name
        case ast.Assign(targets=[ast.Name(id=name)]):
            yield name


def _declared(node: ast.stmt) -> Iterator[str]:
    """The signature of a function; a class's fields and public methods."""
    match node:
        case ast.ClassDef():
            bases = ", ".join(map(ast.unparse, [*node.bases, *node.keywords]))
            yield f"class {node.name}({bases}):" if bases else f"class {node.name}:"
            inside = [line for each in node.body for line in _declared(each)]
            yield from (f"    {line}" for line in inside or ["..."])
        case ast.FunctionDef() | ast.AsyncFunctionDef() if node.name == "__init__" or not node.name.startswith("_"):
            yield from (f"@{ast.unparse(each)}" for each in node.decorator_list)
            word = "async def" if isinstance(node, ast.AsyncFunctionDef) else "def"
            result = f" -> {ast.unparse(node.returns)}" if node.returns else ""
            yield f"{word} {node.name}({ast.unparse(node.args)}){result}: ..."
        case ast.AnnAssign() | ast.Assign() if not ast.unparse(node).startswith("_"):
            yield ast.unparse(node)
        case _:
            return
