"""Mappings of joysticks, pure: ranges, dead zones, buttons on triggers and hats, defaults of common pads."""

import msgspec
import pytest

from gloc3_groundstation.joysticks.defaults import XBOX, default_mapping, linux_controls, sdl_controls
from gloc3_groundstation.joysticks.device import JoystickDevice, JoystickReading, StickDemand
from gloc3_groundstation.joysticks.mapping import (
    AxisMapping,
    JoystickButton,
    JoystickMapping,
    StickAxis,
    is_pressed,
)

XBOX_ONE = (
    "030000005e040000ea02000008040000,Xbox One Controller,a:b0,b:b1,back:b6,dpdown:h0.4,dpleft:h0.8,dpright:h0.2,"
    "dpup:h0.1,leftshoulder:b4,lefttrigger:a2,leftx:a0,lefty:a1,rightshoulder:b5,rightx:a3,righty:a4,start:b7,y:b3,"
)


def test_an_axis_has_its_own_ends_centre_direction_and_dead_zone() -> None:
    axis = AxisMapping(axis=0, low=-0.8, centre=0.1, high=0.9, dead_zone=0.1)
    assert axis.demand(0.9) == pytest.approx(1.0)
    assert axis.demand(-0.8) == pytest.approx(-1.0)
    assert axis.demand(-1.0) == pytest.approx(-1.0), "never more than full"
    assert axis.demand(0.1 + 0.8 * 0.1) == pytest.approx(0.0, abs=1e-9), "no step at the edge of the dead zone"
    assert axis.demand(0.1 + 0.8 * 0.55) == pytest.approx(0.5)
    against = AxisMapping(axis=0, low=1.0, high=-1.0, dead_zone=0.0)
    assert (against.demand(-0.5), against.demand(0.25), against.demand(0.0)) == (0.5, -0.25, 0.0)
    one_sided = AxisMapping(axis=0, low=-1.0, centre=-1.0, high=1.0, dead_zone=0.0)
    assert (one_sided.demand(-1.0), one_sided.demand(0.0), one_sided.demand(1.0)) == (0.0, 0.5, 1.0)


def test_buttons_are_buttons_triggers_or_directions_of_a_hat() -> None:
    reading = JoystickReading((0.0, 0.9, -0.7), frozenset({3}))
    names = ("button 3", "button 4", "axis 1+", "axis 1-", "axis 2-", "axis 2+", "axis 9+", "trigger")
    assert [is_pressed(name, reading) for name in names] == [True, False, True, False, True, False, False, False]


def test_pads_of_sdls_database_are_mapped_by_it() -> None:
    device = JoystickDevice(key="03", name="Xbox One Controller", axes=6, controls=sdl_controls(XBOX_ONE))
    mapping = default_mapping(device)
    assert mapping is not None
    pulled = JoystickReading((0.5, 1.0, -1.0, -1.0, -1.0, -1.0, 0.0, -1.0), frozenset({4, 6}))
    assert mapping.sticks(pulled) == pytest.approx((1.0, -1.0, -1.0, 0.4565), abs=1e-3)
    assert mapping.pressed(pulled) == {JoystickButton.DEAD_MAN, JoystickButton.DISARM, JoystickButton.LIGHTS_UP}
    right = JoystickReading((0.0,) * 6 + (1.0, 0.0))
    assert mapping.pressed(right) == {JoystickButton.GAIN_UP}


def test_an_axis_that_the_database_inverts_counts_the_other_way() -> None:
    controls = {"leftshoulder": "b0", "righty": "a1~"}
    mapping = default_mapping(JoystickDevice(key="x", name="x", axes=2, controls=controls))
    assert mapping is not None
    assert mapping.sticks(JoystickReading((0.0, 1.0))).surge == 1.0


def test_on_linux_pads_are_known_by_the_kernels_name_and_others_are_mapped_first() -> None:
    assert linux_controls("") == linux_controls("Microsoft X-Box 360 pad") == XBOX
    assert linux_controls("Logitech Gamepad F310") == XBOX
    assert linux_controls("Sony Interactive Entertainment DualSense Wireless Controller")["start"] == "b9"
    assert linux_controls("Saitek X52 Pro Flight Control System") == {}
    assert default_mapping(JoystickDevice(key="x", name="x")) is None


def test_a_mapping_without_a_dead_mans_key_steers_nothing_and_says_so() -> None:
    surge = {StickAxis.SURGE: AxisMapping(axis=0)}
    assert "no dead-man's key" in JoystickMapping(axes=surge).problem
    key = {JoystickButton.DEAD_MAN: ("button 0",)}
    assert "no axis" in JoystickMapping(buttons=key).problem
    assert not JoystickMapping(axes=surge, buttons=key).problem
    assert JoystickMapping(axes=surge, buttons=key).sticks(JoystickReading()) == StickDemand(), "axes may be missing"


@pytest.mark.parametrize(
    "text",
    ['{"axes":{"surge":{"axis":99}}}', '{"axes":{"up":{"axis":1}}}', '{"buttons":{"hold":["knob 1"]}}', '{"keys":1}'],
)
def test_what_is_no_mapping_is_refused(text: str) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(text, type=JoystickMapping)
