"""Forms for single actions: units, bounds and defaults of the arguments, and what was typed as values."""

import pytest

from gloc3_groundstation.missions.forms import FormError, arguments_of, capabilities, form_for
from gloc3_groundstation.missions.plans import known_platform

ROWS = capabilities(known_platform("pelican_rtk"))


def test_a_form_has_unit_bounds_default_and_choices_and_asks_first_for_what_is_needed() -> None:
    go_to = form_for("go_to", ROWS["go_to"], is_geo=False)
    names = ["position_m", "speed_m_s", "heading", "acceptance_m", "hold_s", "altitude_m"]
    assert [field.name for field in go_to.fields if field.name in names] == names
    speed = go_to.fields[1]
    assert (speed.label, speed.unit, speed.hint, speed.default) == ("speed", "m/s", "> 0, ≤ 50", "")
    assert form_for("go_to", ROWS["go_to"], is_geo=True).fields[0].name == "position"
    camera = form_for("record_images", ROWS["record_images"], is_geo=False).fields[0]
    assert (camera.choices, camera.default) == (("ground",), "ground")
    assert go_to.claims == ("motion",)
    assert set(capabilities(None)) >= {"take_off", "land", "go_to"}


def test_what_was_typed_becomes_the_arguments_of_a_mission_file() -> None:
    row = ROWS["follow_waypoints"]
    form = form_for("follow_waypoints", row, is_geo=False)
    typed = {"waypoints_m": "1, 2, 3; 4 5 6", "speed_m_s": "0.5", "heading": "{look_at: [0, 0, 1]}", "hold_s": ""}
    assert arguments_of(form, row, typed) == {
        "waypoints_m": [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
        "speed_m_s": 0.5,
        "heading": {"look_at": [0, 0, 1]},
    }
    row = capabilities(None)["survey"]
    typed = {"area_m": "0 0; 4 0; 4 4", "spacing_m": "2"}
    found = arguments_of(form_for("survey", row, is_geo=False), row, typed)
    assert found == {"area_m": [[0, 0], [4, 0], [4, 4]], "spacing_m": 2}


@pytest.mark.parametrize(
    ("capability", "typed", "field", "reason"),
    [
        ("go_to", {}, "position_m", "position must be given"),
        ("go_to", {"position_m": "1 2"}, "position_m", "2 numbers where 3 are needed"),
        ("go_to", {"position_m": "here"}, "position_m", "no position"),
        ("go_to", {"position_m": "1 2 3", "speed_m_s": "fast"}, "speed_m_s", "expected a number"),
        ("go_to", {"position_m": "1 2 3", "speed_m_s": "90"}, "speed_m_s", "<= 50"),
        ("go_to", {"position_m": "1 2 3", "heading": "{look_at: ["}, "heading", ""),
        ("go_to", {"position_m": "1 2 nan"}, "position_m", ""),
        ("take_off", {"height_m": "0"}, "height_m", "> 0"),
        ("record_images", {"camera": "ground"}, "", "every_m or every_s must be given"),
    ],
)
def test_what_does_not_fit_is_told_at_its_field(
    capability: str, typed: dict[str, str], field: str, reason: str
) -> None:
    form = form_for(capability, ROWS[capability], is_geo=False)
    with pytest.raises(FormError) as caught:
        arguments_of(form, ROWS[capability], typed)
    assert caught.value.field == field
    assert reason in str(caught.value)
