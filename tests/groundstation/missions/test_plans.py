"""A mission is read and checked before it goes anywhere."""

from pathlib import Path

import pytest

from gloc3.errors import InputError
from gloc3_groundstation.missions.plans import read_plan, recheck


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
