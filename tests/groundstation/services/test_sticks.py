"""MANUAL_CONTROL, pure: axes and ranges of each kind of vehicle, the autopilot's own buttons, and who is not flown so."""

import pytest

from gloc3.mavlink.message import Address
from gloc3_groundstation.joysticks.device import StickDemand
from gloc3_groundstation.joysticks.mapping import JoystickButton
from gloc3_groundstation.services.snapshot import Firmware, ServicesSnapshot
from gloc3_groundstation.services.sticks import (
    COPTER,
    PX4_DRIVING,
    PX4_FLYING,
    ROVER,
    SUB,
    StickFamily,
    manual_control,
    stick_family,
)

PUSHED = StickDemand(surge=1.0, sway=-0.5, heave=0.2, yaw=-1.0)
CENTRED = StickDemand()


def sent(sticks: StickDemand, family: StickFamily) -> tuple[int, int, int, int]:
    message = manual_control(sticks, family, 7)
    assert (message.name, message.target, message.buttons) == ("MANUAL_CONTROL", 7, 0)
    return message.x, message.y, message.z, message.r


@pytest.mark.parametrize("family", [PX4_FLYING, COPTER, SUB])
def test_what_climbs_takes_a_throttle_from_0_to_1000_whose_middle_is_rest(family: StickFamily) -> None:
    assert sent(PUSHED, family) == (1000, -500, 600, -1000)
    assert sent(CENTRED, family) == (0, 0, 500, 0)
    assert sent(StickDemand(heave=-1.0), family)[2] == 0


def test_what_drives_has_its_throttle_on_z_and_steers_by_y() -> None:
    assert sent(PUSHED, ROVER) == (1000, -1000, 1000, -1000)
    assert sent(CENTRED, ROVER) == (0, 0, 0, 0)
    assert sent(StickDemand(surge=-1.0), ROVER)[2] == -1000
    assert sent(StickDemand(surge=-1.0), PX4_DRIVING)[2] == 0
    assert sent(CENTRED, PX4_DRIVING) == (0, 0, 500, 0)


def test_lights_and_gain_are_the_autopilots_own_buttons_and_no_other_is_sent() -> None:
    held = frozenset({JoystickButton.LIGHTS_UP, JoystickButton.GAIN_DOWN, JoystickButton.DEAD_MAN, JoystickButton.ARM})
    assert manual_control(CENTRED, SUB, 1, held).buttons == 1 << 14 | 1 << 12
    assert manual_control(CENTRED, COPTER, 1, held).buttons == 0


@pytest.mark.parametrize(
    ("firmware", "kind", "family"),
    [
        (Firmware.PX4, 2, PX4_FLYING),
        (Firmware.PX4, 10, PX4_DRIVING),
        (Firmware.PX4, 1, None),
        (Firmware.PX4, 22, None),
        (Firmware.PX4, 12, None),
        (Firmware.ARDUPILOT, 13, COPTER),
        (Firmware.ARDUPILOT, 11, ROVER),
        (Firmware.ARDUPILOT, 12, SUB),
        (Firmware.ARDUPILOT, 20, None),
        (Firmware.ARDUPILOT, 0, None),
        (Firmware.OTHER, 2, None),
    ],
)
def test_a_vehicle_with_wings_or_an_unknown_one_is_not_flown_by_sticks(
    firmware: Firmware, kind: int, family: StickFamily | None
) -> None:
    assert stick_family(ServicesSnapshot(address=Address(1, 1), firmware=firmware, vehicle_type=kind)) is family
