"""Which modules construct a class."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = ("common", "onboard", "groundstation", "sitl")


def constructors_of(part: type) -> set[str]:
    """The modules of the source tree that call a class by its name."""
    found = set()
    for path in (path for folder in SOURCES for path in ROOT.glob(f"{folder}/**/*.py")):
        text = path.read_text(encoding="utf-8")
        if part.__name__ not in text:
            continue
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts[1:])
        tree = ast.parse(text)
        names = {
            alias.asname or alias.name
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module == part.__module__
            for alias in node.names
            if alias.name == part.__name__
        } | ({part.__name__} if module == part.__module__ else set())
        calls = (node.func for node in ast.walk(tree) if isinstance(node, ast.Call))
        if any(isinstance(called, ast.Name) and called.id in names for called in calls):
            found.add(module)
    return found
