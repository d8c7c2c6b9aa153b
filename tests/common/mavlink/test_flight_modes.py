"""Modes as a person knows them, by firmware and type of vehicle."""

import pytest

from gloc3.mavlink.flight_modes import autopilot_name, mode_name, mode_words, type_name


@pytest.mark.parametrize(
    ("autopilot", "kind", "number", "name"),
    [
        (12, 2, 4 << 16 | 4 << 24, "AUTO.MISSION"),
        (12, 2, 3 << 16 | 7 << 24, "POSCTL"),
        (12, 2, 10 << 16, "TERMINATION"),
        (12, 2, 99 << 16, f"mode {99 << 16}"),
        (3, 2, 17, "BRAKE"),
        (3, 1, 5, "FLY_BY_WIRE_A"),
        (3, 10, 4, "HOLD"),
        (3, 12, 19, "MANUAL"),
        (3, 2, 99, "mode 99"),
        (3, 2, 29, "mode 29"),
        (18, 2, 3, "mode 3"),
    ],
)
def test_a_mode_has_the_name_that_its_firmware_gives_it(autopilot: int, kind: int, number: int, name: str) -> None:
    assert mode_name(autopilot, kind, number) == name


@pytest.mark.parametrize(
    ("raw", "autopilot", "words"),
    [
        ("AUTO.LOITER", "", "Hold"),
        ("AUTO.RTL", "PX4", "Return"),
        ("AUTO.MISSION, on wings", "PX4", "Mission, on wings"),
        ("POSCTL", "", "Position"),
        ("OFFBOARD", "PX4", "Offboard"),
        ("MANUAL", "PX4", "Manual"),
        ("MANUAL", "ArduPilot", "MANUAL"),
        ("MANUAL", "", "MANUAL"),
        ("GUIDED", "", "GUIDED"),
        ("mode 99", "PX4", "mode 99"),
    ],
)
def test_px4s_modes_have_the_names_of_its_documents_and_ardupilots_their_own(
    raw: str, autopilot: str, words: str
) -> None:
    assert mode_words(raw, autopilot) == words


def test_autopilots_and_vehicles_have_names() -> None:
    assert [autopilot_name(n) for n in (3, 12, 18, 99)] == ["ArduPilot", "PX4", "smartap", "number 99"]
    assert [type_name(n) for n in (0, 2, 10, 199)] == ["", "quadrotor", "ground rover", "type 199"]
