"""A mission is read and checked before it goes anywhere."""

from pathlib import Path

import msgspec
import pytest

from gloc3.errors import InputError
from gloc3.platform.reader import load_platform, whole_text
from gloc3_groundstation.missions.plans import OTHER_FILE, known_platform, read_plan, recheck


def test_an_example_goes_by_its_name() -> None:
    plan = read_plan("hop")
    assert (plan.name, plan.title) == ("hop.yaml", "hop")
    assert "take_off" in plan.text


def test_what_is_wrong_in_a_file_is_found_at_its_place(tmp_path: Path) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text("mission: x\nframe: hold\ntasks:\n  a:\n    actions:\n      up: {take_of: {}}\n")
    with pytest.raises(InputError, match=r"bad\.yaml:6:12: .*take_of"):
        read_plan(str(file))


def test_a_platform_that_is_not_installed_here_does_not_stop_a_mission() -> None:
    assert read_plan("hop", "unheard_of").title == "hop"


def test_a_mission_that_is_not_there_names_the_nearest() -> None:
    with pytest.raises(InputError, match="no such mission"):
        read_plan("hopp")


def test_a_plan_of_another_program_is_converted_at_the_speed_of_its_platform(tmp_path: Path) -> None:
    file = tmp_path / "square.waypoints"
    lines = [
        "QGC WPL 110",
        "0\t1\t0\t16\t0\t0\t0\t0\t39.5528\t2.6285\t2\t1",
        "1\t0\t3\t22\t0\t0\t0\t0\t0\t0\t5\t1",
        "2\t0\t3\t16\t0\t0\t0\t0\t39.5529\t2.6285\t5\t1",
        "3\t0\t3\t21\t0\t0\t0\t0\t0\t0\t0\t1",
    ]
    file.write_text("\n".join(lines) + "\n")
    plan = read_plan(str(file))
    assert plan.converted_from == str(file)
    assert "speed_m_s: 5" in plan.text
    assert "speed_m_s: 3" in recheck(plan, "pelican").text


def copied(folder: Path, previous: str = "", new: str = "") -> Path:
    """A copy of an installed platform file that keeps its name, with other words in it."""
    file = folder / "ours.yaml"
    file.write_text(whole_text("pelican_rtk").replace(previous, new))
    return file


SLOW = ("  speed_m_s: 3.0", "  speed_m_s: 1.0")
FAST_MISSION = "mission: fast\nframe: hold\ntasks: {a: {actions: {up: {take_off: {height_m: 2}}, out: {follow_waypoints: {waypoints_m: [[3, 0, 2]], speed_m_s: 2}, after: [up]}, down: {land: {}, after: [out]}}}}\n"


def names_of(file: str | Path) -> list[str]:
    return [row.name for row in load_platform(str(file)).components]


def test_a_copied_platform_file_is_known_by_its_own_content_although_it_keeps_the_name(tmp_path: Path) -> None:
    file = copied(tmp_path, *SLOW)
    own = load_platform(str(file))
    names = names_of(file)
    installed = known_platform("pelican", names)
    assert installed is not None
    assert (installed.limits.speed_m_s, own.limits.speed_m_s) == (3.0, 1.0)
    assert known_platform("pelican", names, own.digest()) is None, "the installed file is not the vehicle's"
    assert known_platform("pelican", names, own.digest(), str(file)) == own
    assert known_platform("pelican", names, installed.digest(), str(file)) == installed


def test_a_mission_is_checked_by_the_file_that_the_vehicle_has(tmp_path: Path) -> None:
    file, mission = copied(tmp_path, *SLOW), tmp_path / "fast.yaml"
    mission.write_text(FAST_MISSION)
    own = load_platform(str(file))
    plan = read_plan(str(mission), "pelican_rtk")
    rechecked = recheck(plan, "pelican", names_of(file), own.digest())
    assert rechecked.warnings == (OTHER_FILE.format("pelican", "the one installed here"),)
    with pytest.raises(InputError, match="exceeds the platform's limit"):
        read_plan(str(mission), str(file))
    slow = msgspec.structs.replace(plan, platform_file=str(file))
    with pytest.raises(InputError, match="exceeds the platform's limit"):
        recheck(slow, "pelican", names_of(file), own.digest())


def test_a_digest_follows_what_missions_are_checked_against_and_nothing_else(tmp_path: Path) -> None:
    installed = load_platform("pelican_rtk")
    assert load_platform(str(copied(tmp_path))).digest() == installed.digest()
    assert load_platform(str(copied(tmp_path, *SLOW))).digest() != installed.digest()
