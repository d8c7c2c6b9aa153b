"""Platform files that extend others: what is merged how, where findings point, and what every installed one comes to."""

from pathlib import Path
from unittest.mock import Mock

import pytest

from gloc3.cli.program import run
from gloc3.documents.document import parse
from gloc3.errors import Finding, InputError
from gloc3.platform import bases
from gloc3.platform.bases import base_files, platform_files
from gloc3.platform.reader import check_platform, load_platform, read_document, read_platform, whole_text

GOLDEN = Path(__file__).parents[2] / "data" / "platforms"
BASE = """\
capabilities:
  land: {arguments: land, performed_by: first, claims: [motion]}
  wait: {arguments: wait, performed_by: ""}
components:
  - {name: first, class: "a:First", rate_hz: 5, ports: {pose: one, home: two}, log: [x, y]}
  - {name: second, class: "a:Second", rate_hz: 5}
"""
COMPLETE = BASE.replace(
    "  wait:",
    "  hold: {arguments: hold, performed_by: first, claims: [motion]}\n  return_home: {arguments: return_home, performed_by: first, claims: [motion]}\n  wait:",
)
OWN = """\
platform: heron
extends: base.yaml
vehicle: {type: boat, mass_kg: 8}
"""


def write(folder: Path, own: str = "", base: str = BASE) -> Path:
    (folder / "base.yaml").write_text(base)
    (folder / "heron.yaml").write_text(OWN + own)
    return folder / "heron.yaml"


def whole(folder: Path, own: str) -> dict[str, object]:
    file = write(folder, own)
    value = read_document(file.read_text(), str(file)).value
    assert parse(whole_text(str(file)), "w").value == value
    assert isinstance(value, dict)
    return value


def findings(folder: Path, own: str = "", base: str = BASE) -> list[str]:
    file = write(folder, own, base)
    with pytest.raises(InputError) as reported:
        load_platform(str(file))
    return [str(finding).replace(f"{folder}/", "") for finding in reported.value.findings]


def test_mappings_are_merged_lists_replaced_and_null_takes_out(tmp_path: Path) -> None:
    rows = "  - {name: first, rate_hz: 9, ports: {home: null, pose: other}, log: [z]}\n"
    found = whole(tmp_path, f"capabilities: {{wait: null, land: {{performed_by: second}}}}\ncomponents:\n{rows}")
    assert "extends" not in found
    assert found["capabilities"] == {"land": {"arguments": "land", "performed_by": "second", "claims": ["motion"]}}
    assert found["components"] == [
        {"name": "first", "class": "a:First", "rate_hz": 9, "ports": {"pose": "other"}, "log": ["z"]},
        {"name": "second", "class": "a:Second", "rate_hz": 5},
    ]


def test_a_null_where_the_base_says_nothing_is_a_value_like_any_other(tmp_path: Path) -> None:
    found = whole(tmp_path, "components: [{name: second, settings: {origin_geo: null}}]\n")
    assert found["components"][1]["settings"] == {"origin_geo": None}  # type: ignore[index]


@pytest.mark.parametrize(
    ("rows", "names"),
    [
        ("[{name: new, class: 'a:B'}]", ["first", "second", "new"]),
        (
            "[{name: first}, {name: new, class: 'a:B'}, {name: newer, class: 'a:B'}]",
            ["first", "new", "newer", "second"],
        ),
        ("[{name: first, class: null}]", ["second"]),
        ("[{name: second, class: 'a:Other'}]", ["first", "second"]),
    ],
)
def test_a_new_component_stands_behind_the_one_written_before_it(rows: str, names: list[str], tmp_path: Path) -> None:
    found = whole(tmp_path, f"components: {rows}\n")["components"]
    assert isinstance(found, list)
    assert [row["name"] for row in found] == names


@pytest.mark.parametrize(
    ("entries", "names"),
    [
        ("{circle: {}}", ["circle", "land", "wait"]),
        ("{land: {}, circle: {}, spiral: {}}", ["land", "circle", "spiral", "wait"]),
    ],
)
def test_a_new_entry_stands_behind_the_one_written_before_it_or_first(
    entries: str, names: list[str], tmp_path: Path
) -> None:
    assert list(whole(tmp_path, f"capabilities: {entries}\n")["capabilities"]) == names  # type: ignore[call-overload]


def test_findings_point_into_the_file_where_it_stands(tmp_path: Path) -> None:
    base = BASE.replace("rate_hz: 5}", "rate_hz: -5}")
    own = "limits: {speed_m_s: fast}\ncomponents:\n  - {name: first, rtae_hz: 1}\n"
    assert [line.partition(": ")[0] for line in findings(tmp_path, own, base)] == [
        "base.yaml:6:48",
        "heron.yaml:4:21",
        "heron.yaml:6:19",
    ]
    found = findings(tmp_path, base=BASE.replace("performed_by: first", "performed_by: fist"))
    assert "base.yaml:2:41: no component 'fist' (did you mean 'first'?)" in found


@pytest.mark.parametrize(
    ("own", "base", "told"),
    [
        ("", "extends: heron.yaml\n", "base.yaml:1:10: the files extend each other: heron.yaml -> base.yaml -> heron.yaml"),
        ("", "extends: multirotr\n", "base.yaml:1:10: no base or platform is called 'multirotr' (did you mean 'multirotor'?)"),
        ("", "extends: gone.yaml\n", "base.yaml:1:10: there is no file 'gone.yaml' beside this one"),
        ("", "- no\n- mapping\n", "heron.yaml:2:10: base.yaml is not a mapping"),
        ("", "extends: [a, b]\n", "base.yaml:1:10: extends needs the name of a base or platform, or a file"),
        (
            "components: [{name: frist, rate_hz: 1}]\n",
            BASE,
            "heron.yaml:4:14: there is no component 'frist' to change (did you mean 'first'?)",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_extended_is_said_with_its_place(own: str, base: str, told: str, tmp_path: Path) -> None:
    assert findings(tmp_path, own, base) == [told]


def test_a_name_that_is_given_twice_is_found_twice(tmp_path: Path) -> None:
    file = write(tmp_path, "components: [{name: first}, {name: first, class: 'a:B'}]\n")
    with pytest.raises(InputError, match="first"):
        check_platform(read_document(file.read_text(), str(file)))


def test_calibrations_and_keys_of_a_base_stay_beside_it(tmp_path: Path) -> None:
    (tmp_path / "bases").mkdir()
    (tmp_path / "bases" / "eyes.yaml").write_text(
        "cameras: {front: front.yaml#cam0, left: /etc/left.yaml}\nmembers: {anna: anna.key}\n"
    )
    file = tmp_path / "heron.yaml"
    file.write_text(OWN.replace("base.yaml", "bases/eyes.yaml"))
    assert load_platform(str(file)).cameras == {"front": "bases/front.yaml#cam0", "left": "/etc/left.yaml"}
    assert load_platform(str(file)).members == {"anna": "bases/anna.key"}


@pytest.mark.parametrize("name", sorted(platform_files()))
def test_what_the_installed_platforms_come_to(name: str) -> None:
    golden = read_platform((GOLDEN / f"{name}.yaml").read_text(encoding="utf-8"), name)
    found = load_platform(name)
    assert found == golden, f"if this is meant: gloc3 platform show --full {name}"
    assert list(found.capabilities) == list(golden.capabilities), "the first that fits flies a pattern"


def test_no_base_is_called_like_a_platform() -> None:
    names = base_files().keys() - platform_files().keys()
    assert {"vehicle", "multirotor", "underwater"} <= names
    assert all(file.parent.name != "bases" for file in platform_files().values())
    assert all(base_files()[name] == file for name, file in platform_files().items())


def test_a_package_brings_platforms_and_bases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "bases").mkdir()
    (tmp_path / "bases" / "wing.yaml").write_text("vehicle: {type: aircraft}\n")
    (tmp_path / "kite.yaml").write_text("platform: kite\nextends: wing\nvehicle: {mass_kg: 2}\n")
    point = Mock(load=lambda: Mock(__path__=[str(tmp_path)]))
    monkeypatch.setattr(bases, "installed_points", lambda group: [point] if group == "gloc3.platforms" else [])
    assert (list(platform_files()), list(base_files())) == (["kite"], ["kite", "wing"])
    vehicle = load_platform("kite").vehicle
    assert (vehicle.type, vehicle.mass_kg) == ("aircraft", 2.0)


def test_the_whole_of_a_platform_can_be_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.yaml").write_text("platform: mine\nextends: copter\nlimits: {height_max_m: 20}\n")
    assert run(["platform", "show", "--full", str(tmp_path / "mine.yaml")]) == 0
    text = capsys.readouterr().out
    assert "extends" not in text
    shown, copter = read_platform(text, "shown", is_loading_classes=True), load_platform("copter")
    assert (shown.platform, shown.limits.height_max_m) == ("mine", 20.0)
    assert shown.components == copter.components


def test_the_example_of_the_page_can_be_used(tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs" / "vehicles.md").read_text(encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(page.partition("```yaml\n")[2].partition("```")[0])
    platform = load_platform(str(tmp_path / "mine.yaml"), is_loading_classes=True)
    assert "fly_plan" not in platform.capabilities
    assert platform.component("autopilot_plan") is None


def test_a_platform_is_read_again_only_when_one_of_its_files_changes(tmp_path: Path) -> None:
    file = write(tmp_path, base=COMPLETE)
    loaded = load_platform(str(file))
    assert load_platform(str(file)) is loaded
    assert [row.rate_hz for row in loaded.components] == [5.0, 5.0]
    with pytest.raises(InputError):  # its classes do not exist
        load_platform(str(file), is_loading_classes=True)
    write(tmp_path, base=COMPLETE.replace("rate_hz: 5,", "rate_hz: 6,"))
    assert [row.rate_hz for row in load_platform(str(file)).components] == [6.0, 5.0]
    write(tmp_path, "components: [{name: second, rate_hz: 7}]\n", COMPLETE)
    assert [row.rate_hz for row in load_platform(str(file)).components] == [5.0, 7.0]
    (tmp_path / "base.yaml").unlink()
    with pytest.raises(InputError):
        load_platform(str(file))


def test_the_warnings_about_a_platform_come_with_every_reading(tmp_path: Path) -> None:
    file = write(tmp_path, "devices: {front: 'v4l2:///dev/video0'}\n", COMPLETE)
    for _ in range(2):
        warnings: list[Finding] = []
        load_platform(str(file), warn=warnings.append)
        assert [warning.message[:31] for warning in warnings] == ["no component uses a device 'fro"]
