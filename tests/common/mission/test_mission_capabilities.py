"""What missions can ask for: kinds of arguments that packages register, rows of platforms, and what a command tells."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gloc3.errors import Gloc3Error, InputError, Misuse
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.model.arguments import Arguments, FollowWaypointsOrder, argument_kinds
from gloc3.mission.showing.capability_lines import capability_lines
from gloc3.mission.showing.cli import app
from gloc3.platform.platform import Platform
from gloc3.platform.reader import read_platform

Install = Callable[[dict[str, str]], None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Installs a package `reef` with kinds of arguments, as pip would."""

    def entries(points: dict[str, str]) -> None:
        info = tmp_path / "reef-1.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: reef\nVersion: 1\n")
        rows = "".join(f"{name} = {value}\n" for name, value in points.items())
        (info / "entry_points.txt").write_text(f"[gloc3.capabilities]\n{rows}")
        monkeypatch.syspath_prepend(tmp_path)
        argument_kinds.cache_clear()

    yield entries
    argument_kinds.cache_clear()


def test_the_example_of_every_kind_is_an_action_that_a_mission_may_hold() -> None:
    for line in capability_lines(None):
        text = f"mission: m\nframe: hold\ntasks: {{work: {{actions: {{step: {line.example}}}}}}}\n"
        report = check_text(text, line.name, Circumstances())
        assert report.mission is not None
        assert "step" in report.mission.tasks["work"].actions, report.findings


def test_what_moves_claims_motion_and_what_records_does_not() -> None:
    kinds = argument_kinds()
    assert (kinds["go_to"].claims(), kinds["record_images"].claims()) == (("motion",), ())


def test_a_row_that_does_not_claim_what_its_kind_needs_is_refused_with_what_to_write(platform_text: str) -> None:
    row = "hold: {arguments: hold, performed_by: flight, claims: [motion]"
    with pytest.raises(InputError) as caught:
        read_platform(platform_text.replace(row, row.replace("[motion]", "[lamp]")), "p")
    assert [str(finding) for finding in caught.value.findings] == [
        "p:11:3: hold does not claim motion, which hold always needs for itself (claims: [lamp, motion])"
    ]


def test_a_capability_with_the_name_of_a_key_of_actions_is_refused(platform_text: str) -> None:
    with pytest.raises(InputError, match=r"p:9:3: 'until' is a key of every action, not a capability"):
        read_platform(platform_text.replace("  take_off:", "  until:"), "p")


def test_what_a_device_draws_is_in_the_estimate_for_as_long_as_it_runs(
    pelican: Platform, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = """\
mission: m
frame: hold
tasks:
  up: {actions: {climb: {take_off: {height_m: 2}}}}
  look:
    after: [up]
    actions:
      stay: {hold: {duration_s: 90}}
      photos: {record_images: {camera: ground, every_s: 1}, until: stay}
  end: {after: [look], actions: {down: {land: {}}}}
"""

    def energy_wh() -> float:
        report = check_text(text, "m", Circumstances(platform=pelican))
        assert report.estimate is not None
        return report.estimate.energy_wh

    without_wh = energy_wh()
    monkeypatch.setattr(argument_kinds()["record_images"], "power_w", 40.0)
    assert energy_wh() - without_wh == pytest.approx(40.0 * 90.0 / 3600.0)


def test_what_a_moving_capability_says_that_it_needs_counts_beside_its_way(
    pelican: Platform, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = """\
mission: m
frame: hold
tasks:
  up: {actions: {climb: {take_off: {height_m: 2}}}}
  search: {after: [up], deadline_s: 30, actions: {look: {go_to: {position_m: [2, 0, 2]}}}}
  end: {after: [search], actions: {down: {land: {}}}}
"""
    plain = check_text(text, "m", Circumstances(platform=pelican))
    monkeypatch.setattr(FollowWaypointsOrder, "time_needed_s", lambda *_: 600.0)
    slow = check_text(text, "m", Circumstances(platform=pelican))
    assert plain.estimate is not None
    assert slow.estimate is not None
    assert slow.estimate.duration_s > 600.0 > plain.estimate.duration_s
    assert slow.estimate.energy_wh > plain.estimate.energy_wh + 10.0, "it hovers meanwhile"
    assert "about 600 s are needed, but deadline_s is 30" in str(slow.findings[0])


def test_kinds_that_are_none_are_told_with_the_entry_point(install: Install) -> None:
    install({"sink": "json:loads"})
    with pytest.raises(Misuse, match=r"entry point sink of gloc3\.capabilities is not a subclass of Arguments"):
        argument_kinds()


def test_a_kind_that_cannot_be_loaded_is_told_with_the_reason(install: Install) -> None:
    install({"sink": "nowhere:Sink"})
    with pytest.raises(Gloc3Error, match=r"entry point sink of gloc3\.capabilities cannot be loaded: No module"):
        argument_kinds()


def test_two_packages_may_not_bring_one_name(install: Install) -> None:
    install({"go_to": "gloc3.mission.model.arguments:Hold"})
    with pytest.raises(Misuse, match="two packages define arguments called 'go_to'"):
        argument_kinds()


def test_the_command_lists_the_capabilities_of_a_platform_with_who_performs_them(
    platform_text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "pelican.yaml"
    file.write_text(platform_text, encoding="utf-8")
    assert app(["capabilities", "--platform", str(file)], exit_on_error=False, result_action="return_value") == 0
    shown = capsys.readouterr().out
    assert "take_off           flight         motion" in shown
    assert "wait               the executor" in shown
    assert "\ndive" not in shown


def test_the_command_explains_one_with_units_bounds_what_is_possible_here_and_an_example(
    platform_text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "pelican.yaml"
    file.write_text(platform_text, encoding="utf-8")
    command = ["capabilities", "record_images", "--platform", str(file)]
    assert app(command, exit_on_error=False, result_action="return_value") == 0
    shown = capsys.readouterr().out
    assert "step: {record_images: {camera: ground, every_m: 0.5}}" in shown
    words = " ".join(shown.split())
    assert "camera ground (required)" in words
    assert "every_m m number, > 0, <= 1000" in words
    assert app([*command, "--json"], exit_on_error=False, result_action="return_value") == 0
    reported = json.loads(capsys.readouterr().out)
    assert [one["unit"] for one in reported["arguments"]] == ["", "m", "s", ""]
    assert reported["arguments"][0]["choices"] == ["ground"]


def test_a_name_that_there_is_not_comes_with_the_nearest() -> None:
    with pytest.raises(Gloc3Error, match=r"there is no capability 'got' \(did you mean 'go_to'\?\)"):
        app(["capabilities", "got"], exit_on_error=False, result_action="return_value")


def test_arguments_say_what_they_take_in_their_first_line() -> None:
    for name, kind in argument_kinds().items():
        assert issubclass(kind, Arguments)
        assert (kind.__doc__ or "").strip(), name
