"""Files and parts of files that pages show are read by what reads them: nothing in them is unknown or misspelt.

Tutorials and the pages on missions, components and capabilities have tests of their own, which do what they say.
"""

import ast
import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from gloc3.errors import InputError
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.model.arguments import argument_kinds
from gloc3.mission.reading.reader import read_mission
from gloc3.network.access import MemberRole
from gloc3.network.rights_file import read_rights
from gloc3.platform.reader import load_platform
from gloc3_groundstation.store.configuration import ConfigurationFile
from gloc3_onboard.autopilot.presets.files import load_preset
from gloc3_sitl.world import World

pytestmark = pytest.mark.thorough

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```(yaml|toml|json|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
DONE_ELSEWHERE = ("add-a-component.md", "add-a-capability.md", "missions.md", "public-api.md")
OF_OTHERS = frozenset({"scrape_configs"})
"""Keys by which other programs' files are known."""
BLOCKS = [
    (page.name, kind, text)
    for page in sorted(DOCS.glob("*.md"))
    if page.name not in DONE_ELSEWHERE
    for kind, text in BLOCK.findall(page.read_text(encoding="utf-8"))
]


def read_yaml(text: str, folder: Path) -> None:
    """Reads a block as what its keys say it is."""
    root = yaml.safe_load(text)
    file = folder / "page.yaml"
    file.write_text(text, encoding="utf-8")
    named = re.match(r"# \S+ for (\S+)\n", text)
    if isinstance(root, list):
        read_yaml("components:\n" + text, folder)
    elif "preset" in root:
        load_preset(str(file))
    elif "world" in root:
        World.load(str(file))
    elif "rights" in root:
        read_rights(file, {row["member"]: MemberRole.OPERATOR for row in root["rights"]})
    elif "tasks" in root and "mission" in root and named is not None:
        report = check_text(text, file.name, Circumstances(platform=load_platform(named[1])))
        assert report.is_ok, report.findings
    elif "tasks" in root and "mission" in root:
        read_mission(text, file.name)
    elif "platform" in root:
        load_platform(str(file), is_loading_classes=True)
    elif are_actions(root):
        indented = "".join(f"      {line}\n" for line in text.splitlines())
        others = {after for row in root.values() for after in (*row.get("after", []), row.get("until"))} - {*root, None}
        waits = "".join(f"      {name}: {{wait: {{duration_s: 1}}}}\n" for name in sorted(others))
        read_mission(f"mission: page\nframe: hold\ntasks:\n  page:\n    actions:\n{indented}{waits}", file.name)
    elif not OF_OTHERS & {*root}:
        read_yaml("platform: page\nextends: pelican\n" + text, folder)


def are_actions(root: Mapping[str, Any]) -> bool:
    return all(isinstance(row, dict) and {*argument_kinds()} & {*row} for row in root.values())


@pytest.mark.parametrize(("page", "kind", "text"), BLOCKS, ids=[f"{page}-{kind}" for page, kind, _ in BLOCKS])
def test_a_file_that_a_page_shows_can_be_read(page: str, kind: str, text: str, tmp_path: Path) -> None:
    match kind:
        case "python":
            ast.parse(text)
        case "json":
            json.loads(text)
        case "toml" if "[project" not in text:
            (tmp_path / "station.toml").write_text(text, encoding="utf-8")
            ConfigurationFile(tmp_path / "station.toml").read()
        case "toml":
            tomllib.loads(text)
        case _ if "…}" not in text and "..." not in text:
            read_yaml(text, tmp_path)
        case _:
            yaml.safe_load(text)


@pytest.mark.parametrize(
    "text",
    [
        "grab: {grip: {griper: claw, action: grab}}",
        "- {name: obstacles, class: 'gloc3_onboard.components.processors.obstacles:Obstacles', rate_hz: 5}",
        "- {name: waypoints, settings: {acceleration: 1.2}}",
        "limits: {speed: 4}",
        "preset: mine\nstyle: px4\nparameters: {A: {valu: 1}}",
    ],
)
def test_a_misspelt_word_would_be_found(text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read_yaml(text, tmp_path)
