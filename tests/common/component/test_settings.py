"""Settings: typed, bounded, documented; everything that is wrong is found at once."""

import math
from typing import Annotated, Any, Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from tests.common.any_message import PLAIN

from gloc3.component.settings import Bounds, NoSettings, Settings, field_docs, load_settings, not_finite
from gloc3.errors import InputError


class CameraSettings(Settings, frozen=True, kw_only=True):
    """What a camera can be set to."""

    name: str
    """Which camera."""
    exposure_s: Annotated[float, Bounds(0.0, 1.0)] = 0.01
    """Time that the shutter is open, in seconds."""
    gain: Annotated[int, Bounds(1, 16)] = 1
    window: tuple[int, int] = (640, 480)
    mode: Literal["mono", "colour"] = "mono"


class NightSettings(CameraSettings, frozen=True, kw_only=True):
    """What a camera for the night can be set to."""

    lamp_w: float = 5.0
    """Power of the lamp, in watts."""


def findings(values: dict[str, Any]) -> list[str]:
    """What is wrong with some values."""
    with pytest.raises(InputError) as error:
        load_settings(CameraSettings, values, "camera")
    return [str(finding) for finding in error.value.findings]


def test_values_that_fit_are_taken_and_the_rest_are_defaults() -> None:
    loaded = load_settings(CameraSettings, {"name": "front", "exposure_s": 1, "window": [320, 240]}, "camera")
    assert loaded == CameraSettings(name="front", exposure_s=1.0, window=(320, 240))


def test_everything_that_is_wrong_is_found_at_once_and_an_unknown_name_comes_with_the_nearest() -> None:
    assert findings({"exposure": 0.1, "exposure_s": 2.0, "gain": 1.5, "mode": "grey", "window": [1, "x"]}) == [
        "camera: unknown setting 'exposure' (did you mean 'exposure_s'?)",
        "camera: exposure_s: Expected `float` <= 1.0",
        "camera: gain: Expected `int`, got `float`",
        "camera: mode: Invalid enum value 'grey'",
        "camera: window[1]: Expected `int`, got `str`",
        "camera: name is missing",
    ]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_refused_wherever_they_stand(value: float) -> None:
    assert "camera: exposure_s is not a finite number" in findings({"name": "front", "exposure_s": value})
    assert list(not_finite({"a": [1.0, {"b": value}], "c": 1})) == ["a[1].b"]


def test_what_a_settings_type_checks_itself_is_a_finding() -> None:
    class Range(Settings, frozen=True):
        low: float = 0.0
        high: float = 1.0

        def __post_init__(self) -> None:
            if self.low > self.high:
                raise ValueError("low is above high")

    with pytest.raises(InputError, match="range: low is above high"):
        load_settings(Range, {"low": 2.0}, "range")


def test_a_component_without_settings_takes_none() -> None:
    assert load_settings(NoSettings, {}, "plain") == NoSettings()
    with pytest.raises(InputError, match=r"unknown setting 'x' \(none is known\)"):
        load_settings(NoSettings, {"x": 1}, "plain")


@hypothesis_settings(max_examples=30)
@given(st.dictionaries(st.sampled_from(["name", "exposure_s", "gain", "window", "mode", "other"]) | st.text(), PLAIN))
def test_any_values_are_taken_or_refused(values: dict[str, Any]) -> None:
    try:
        loaded = load_settings(CameraSettings, values, "camera")
    except InputError:
        return
    assert set(values) <= {field.name for field in msgspec.structs.fields(loaded)}


@hypothesis_settings(max_examples=30)
@given(st.floats(-0.5, 1.5), st.integers(-2, 20))
def test_what_is_within_its_bounds_is_taken_and_nothing_else(exposure_s: float, gain: int) -> None:
    values = {"name": "front", "exposure_s": exposure_s, "gain": gain}
    if 0.0 <= exposure_s <= 1.0 and 1 <= gain <= 16:
        loaded = load_settings(CameraSettings, values, "camera")
        assert (loaded.exposure_s, loaded.gain) == (exposure_s, gain)
    else:
        assert findings(values)


def test_the_text_under_a_field_is_its_documentation_the_bases_too() -> None:
    assert field_docs(NightSettings) == {
        "name": "Which camera.",
        "exposure_s": "Time that the shutter is open, in seconds.",
        "lamp_w": "Power of the lamp, in watts.",
    }


def test_a_type_without_source_has_no_documentation() -> None:
    assert field_docs(msgspec.defstruct("Made", [("x", float)])) == {}
