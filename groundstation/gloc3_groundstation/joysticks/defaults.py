"""Default mappings: any pad of SDL's database, and common pads on Linux's joystick interface.

The left stick is heave and yaw, the right one surge and sway, as usual for ROVs and multirotors (mode 2); a shoulder
button is the dead-man's key.
"""

import re
from collections.abc import Mapping
from typing import Final

from gloc3_groundstation.joysticks.device import JoystickDevice
from gloc3_groundstation.joysticks.mapping import AxisMapping, JoystickButton, JoystickMapping, StickAxis

AXES: Final[Mapping[StickAxis, tuple[str, bool]]] = {
    StickAxis.SURGE: ("righty", True),
    StickAxis.SWAY: ("rightx", False),
    StickAxis.HEAVE: ("lefty", True),
    StickAxis.YAW: ("leftx", False),
}
"""Standard control of each axis, and whether it counts against it: sticks count towards the operator."""
BUTTONS: Final[Mapping[JoystickButton, tuple[str, ...]]] = {
    JoystickButton.DEAD_MAN: ("leftshoulder", "rightshoulder"),
    JoystickButton.HOLD: ("b",),
    JoystickButton.ARM: ("start",),
    JoystickButton.DISARM: ("back",),
    JoystickButton.MODE: ("y",),
    JoystickButton.LIGHTS_UP: ("dpup",),
    JoystickButton.LIGHTS_DOWN: ("dpdown",),
    JoystickButton.GAIN_UP: ("dpright",),
    JoystickButton.GAIN_DOWN: ("dpleft",),
}
_AXIS: Final = re.compile(r"a(\d+)(~?)")
_BUTTON: Final = re.compile(r"b(\d+)|([+-])a(\d+)|h0\.([1248])")
_HAT: Final = {"1": (1, "-"), "2": (0, "+"), "4": (1, "+"), "8": (0, "-")}
"""Direction of a hat: which of its two axes, and towards which end."""

_STICKS: Final = {"leftx": "a0", "lefty": "a1", "rightx": "a3", "righty": "a4"}
_SHOULDERS: Final = {"leftshoulder": "b4", "rightshoulder": "b5"}
_CROSS: Final = {"dpup": "-a7", "dpdown": "+a7", "dpleft": "-a6", "dpright": "+a6"}
XBOX: Final = {**_STICKS, **_SHOULDERS, **_CROSS, "b": "b1", "y": "b3", "back": "b6", "start": "b7"}
"""Numbers of the driver `xpad`."""
PLAYSTATION: Final = {**_STICKS, **_SHOULDERS, **_CROSS, "b": "b1", "y": "b2", "back": "b8", "start": "b9"}
"""Numbers of the driver `hid-playstation`."""
LINUX_PADS: Final = (
    (re.compile(r"", re.IGNORECASE), XBOX),
    (re.compile(r".*(x-?box|xinput|gamepad f\d10).*", re.IGNORECASE), XBOX),
    (re.compile(r".*(sony|dualsense|dualshock|playstation|wireless controller).*", re.IGNORECASE), PLAYSTATION),
)
"""Standard controls on Linux's joystick interface by the kernel's name; a FIFO has none, and counts as an Xbox pad."""


def linux_controls(name: str) -> Mapping[str, str]:
    """Standard controls of a pad on Linux's joystick interface; empty where they are not known."""
    return next((controls for pattern, controls in LINUX_PADS if pattern.fullmatch(name)), {})


def sdl_controls(line: str) -> Mapping[str, str]:
    """Standard controls of a line of SDL's database: `GUID,name,leftx:a0,…`."""
    return dict(part.partition(":")[::2] for part in line.split(",")[2:] if ":" in part)


def default_mapping(device: JoystickDevice) -> JoystickMapping | None:
    """The mapping of a pad with known controls; None for a device that has to be mapped first."""
    controls = device.controls
    found = {name: row for name in StickAxis if (row := _axis(controls.get(AXES[name][0], ""), AXES[name][1]))}
    buttons = {
        button: inputs
        for button, names in BUTTONS.items()
        if (inputs := tuple(one for name in names if (one := _button(controls.get(name, ""), device.axes))))
    }
    mapping = JoystickMapping(name=device.name, axes=found, buttons=buttons)
    return None if mapping.problem else mapping


def _axis(control: str, is_reversed: bool) -> AxisMapping | None:
    found = _AXIS.fullmatch(control)
    if found is None:
        return None
    end = -1.0 if is_reversed is not bool(found[2]) else 1.0
    return AxisMapping(axis=int(found[1]), low=-end, high=end)


def _button(control: str, axes: int) -> str:
    found = _BUTTON.fullmatch(control)
    if found is None:
        return ""
    if found[1]:
        return f"button {found[1]}"
    if found[2]:
        return f"axis {found[3]}{found[2]}"
    axis, end = _HAT[found[4]]
    return f"axis {axes + axis}{end}"
