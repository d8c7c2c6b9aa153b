"""The page about payload: its platform can be used, and its actions are fit for it."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.thorough  # other processes

PAGE = Path(__file__).parents[3] / "docs" / "payload.md"
GLOC3 = str(Path(sys.executable).with_name("gloc3"))


def checked(folder: Path, *arguments: str) -> str:
    run = subprocess.run([GLOC3, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


def test_the_platform_of_the_page_can_be_used_and_its_actions_are_fit(tmp_path: Path) -> None:
    _, platform, actions, *_ = (block.split("```")[0] for block in PAGE.read_text().split("```yaml\n"))
    (tmp_path / "carrier.yaml").write_text(platform)
    assert "can be used" in checked(tmp_path, "platform", "check", "carrier.yaml")
    head = "mission: page\nframe: hold\ntasks:\n  page:\n    actions:\n"
    rows = [
        "up: {take_off: {height_m: 2}}",
        *actions.strip().splitlines(),
        "back: {wait: {duration_s: 5}, after: [drop]}",
    ]
    order = {"grab": "up", "light": "grab", "aim": "grab", "lower": "aim"}
    for index, row in enumerate(rows):
        name = row.partition(":")[0]
        if name in order:
            body, _, comment = row.partition("  #")
            rows[index] = f"{body.rstrip().removesuffix('}')}, after: [{order[name]}]}}  #{comment}"
    (tmp_path / "page.yaml").write_text(
        head + "".join(f"      {row}\n" for row in rows) + "      down: {land: {}, after: [back]}\n"
    )
    assert "fit to fly" in checked(tmp_path, "mission", "check", "page.yaml", "--platform", "carrier.yaml")
