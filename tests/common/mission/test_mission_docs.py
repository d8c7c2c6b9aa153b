"""Every example of the documentation of missions is fit to fly on the platform that its first line names."""

import re
from pathlib import Path

import pytest

from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.checking.contingency_check import ANSWERS
from gloc3.mission.formats import mission_text
from gloc3.mission.model.conditions import QUANTITIES
from gloc3.platform.reader import load_platform

PAGE = (Path(__file__).parents[3] / "docs" / "missions.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"```yaml\n# (\S+)(?: for (\S+))?\n(.*?)```", re.DOTALL)
FILES = {name: (platform, text) for name, platform, text in BLOCK.findall(PAGE)}


@pytest.mark.parametrize("name", [name for name, (platform, _) in FILES.items() if platform])
def test_an_example_is_fit_to_fly(name: str, tmp_path: Path) -> None:
    for file, (_, text) in FILES.items():
        (tmp_path / file).write_text(text, encoding="utf-8")
    _, text, _ = mission_text(str(tmp_path / name))
    report = check_text(text, name, Circumstances(platform=load_platform(FILES[name][0])))
    assert report.is_ok, report.findings


def test_the_page_names_every_quantity_and_every_policy_that_may_name_a_task() -> None:
    for word in (*QUANTITIES, *ANSWERS):
        assert f"`{word}`" in PAGE


def test_every_block_of_the_page_is_an_example_that_is_checked() -> None:
    assert PAGE.count("```yaml") == len(FILES) > 5
