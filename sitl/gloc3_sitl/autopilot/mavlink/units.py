"""Units and times as MAVLink messages carry them."""

from typing import TYPE_CHECKING

from gloc3.messages.frames import GRAVITY_M_S2

if TYPE_CHECKING:
    from gloc3_sitl.autopilot.autopilot import Autopilot


def boot_ms(autopilot: "Autopilot") -> int:
    """Milliseconds since boot, as most messages carry them."""
    return int(autopilot.craft.now_s * 1000.0) & 0xFFFFFFFF


def microseconds(autopilot: "Autopilot") -> int:
    """Microseconds since boot."""
    return int(autopilot.craft.now_s * 1e6)


def short(value: float) -> int:
    """Rounded, and held inside 16 bits."""
    return max(-32768, min(32767, round(value)))


def milli_g(acceleration_m_s2: float) -> int:
    """In thousandths of standard gravity, rounded, and held inside 16 bits."""
    return short(1e3 * acceleration_m_s2 / GRAVITY_M_S2)
