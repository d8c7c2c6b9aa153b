"""The architecture's import contracts: static, by import-linter, and at run time, in a fresh interpreter."""

import importlib
import json
import pkgutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

from gloc3.component.component import Component

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[2]

HEAVY = ("textual", "jsbsim", "matplotlib", "cv2", "mavsdk", "scipy", "pytest")
"""What may only be loaded where it is used."""

# Programs are left out.
LOADER = """
import importlib, json, pkgutil, sys
for name in sys.argv[1:]:
    package = importlib.import_module(name)
    for module in pkgutil.walk_packages(getattr(package, "__path__", []), name + "."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""


def loaded_by(*modules: str) -> set[str]:
    """The top-level packages that are loaded after importing modules, and everything in them, in a fresh interpreter."""
    paths = [str(ROOT / folder) for folder in ("common", "onboard", "groundstation", "sitl")]
    code = f"import sys; sys.path[:0] = {paths!r}\n{LOADER}"
    done = subprocess.run([sys.executable, "-c", code, *modules], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


def test_the_import_contracts_are_kept(capsys: pytest.CaptureFixture[str]) -> None:
    assert lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True) == 0, capsys.readouterr().out


def test_the_contract_that_keeps_components_apart_names_every_component() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    (apart,) = [contract["modules"] for contract in contracts if contract["type"] == "independence"]
    import gloc3_onboard

    defining = set[str]()
    for found in pkgutil.walk_packages(gloc3_onboard.__path__, "gloc3_onboard."):
        module = importlib.import_module(found.name)
        if any(_is_component_of(thing, found.name) for thing in vars(module).values()):
            defining.add(found.name)
    missing = {name for name in defining if not any(name == item or name.startswith(f"{item}.") for item in apart)}
    assert missing == set()


def _is_component_of(thing: object, module: str) -> bool:
    return isinstance(thing, type) and issubclass(thing, Component) and thing.__module__ == module


def test_the_vehicle_loads_nothing_that_only_the_ground_or_the_simulation_needs() -> None:
    assert loaded_by("gloc3", "gloc3_onboard").isdisjoint(HEAVY)


def test_the_generic_component_loads_no_mavlink_no_log_format_and_no_command_line() -> None:
    loaded = loaded_by(
        "gloc3.component.host",
        "gloc3.component.supervision",
        "gloc3.component.test_bench",
        "gloc3.messages.standard_topics",
    )
    assert loaded.isdisjoint({*HEAVY, "pymavlink", "mcap", "rich", "cyclopts", "serial", "numpy"})
