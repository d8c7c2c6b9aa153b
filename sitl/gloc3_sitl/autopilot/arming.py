"""Whether the vehicle may be armed, with the reason in words."""

from collections.abc import Iterator
from enum import IntFlag
from math import degrees, hypot

from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.modes import POSITIONED, Behaviour


class Check(IntFlag):
    """Groups of checks that can be switched off."""

    ATTITUDE = 1
    HEADING = 2
    HEIGHT = 4
    POSITION = 8
    BATTERY = 16
    PILOT = 32
    FENCE = 64
    HEALTH = 128


def arming_problems(craft: Craft, behaviour: Behaviour, battery_share: float) -> Iterator[tuple[Check, str]]:
    """Everything that speaks against arming in a mode, worst first."""
    estimator, now_s = craft.estimator, craft.now_s
    if not estimator.is_aligned:
        yield Check.ATTITUDE, "attitude is still being found"
        return
    roll, pitch, _ = estimator.euler_rad
    if hypot(roll, pitch) > 0.4:
        yield Check.ATTITUDE, f"leaning by {degrees(hypot(roll, pitch)):.0f} degrees"
    if not estimator.is_height_good(now_s):
        yield Check.HEIGHT, "no height: barometer fails"
    if not estimator.is_heading_good(now_s):
        yield Check.HEADING, "no heading: compass fails"
    needs_position = craft.tuning.needs_position_to_arm or behaviour in POSITIONED
    if needs_position and not estimator.is_position_good(now_s):
        yield Check.POSITION, "no position: waiting for a fix or odometry"
    if needs_position and estimator.origin is None:
        yield Check.POSITION, "no global origin"
    if battery_share < craft.tuning.battery_low:
        yield Check.BATTERY, f"battery low: {100.0 * battery_share:.0f} %"
    if craft.tuning.pilot_required and now_s - craft.pilot.last_seen_s > craft.tuning.pilot_timeout_s:
        yield Check.PILOT, "no transmitter"
    if craft.is_leaking:
        yield Check.HEALTH, "leak detected"
    if craft.fault:
        yield Check.HEALTH, craft.fault
