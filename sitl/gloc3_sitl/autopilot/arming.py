"""Arming checks: the reasons against arming, in words and by the PX4 event that reports each."""

from collections.abc import Iterator
from enum import IntFlag
from math import degrees, hypot
from typing import NamedTuple

from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.modes import POSITIONED, Behaviour


class Check(IntFlag):
    """Groups of pre-arm checks that can be disabled."""

    ATTITUDE = 1
    HEADING = 2
    HEIGHT = 4
    POSITION = 8
    BATTERY = 16
    PILOT = 32
    FENCE = 64
    HEALTH = 128
    MODE = 256


class ArmingProblem(NamedTuple):
    """A reason against arming."""

    check: Check
    text: str
    event: str = ""
    """Name of PX4's event; empty where PX4 has none."""


def vehicle_problems(craft: Craft, behaviour: Behaviour, battery_share: float) -> Iterator[ArmingProblem]:
    """Yields the reasons against arming in a mode, worst first."""
    estimator, now_s = craft.estimator, craft.now_s
    if not estimator.is_aligned:
        yield ArmingProblem(Check.ATTITUDE, "attitude is still aligning", "check_modes_attitude")
        return
    roll, pitch, _ = estimator.euler_rad
    if hypot(roll, pitch) > 0.4:
        text = f"tilted by {degrees(hypot(roll, pitch)):.0f} degrees"
        yield ArmingProblem(Check.ATTITUDE, text, "check_failure_detector_roll")
    if not estimator.is_height_good(now_s):
        yield ArmingProblem(Check.HEIGHT, "no height: barometer failed", "check_modes_local_alt")
    if not estimator.is_heading_good(now_s):
        yield ArmingProblem(Check.HEADING, "no heading: compass failed", "check_estimator_heading_not_stable")
    needs_position = craft.tuning.needs_position_to_arm or behaviour in POSITIONED
    if needs_position and not estimator.is_position_good(now_s):
        yield ArmingProblem(Check.POSITION, "no position: waiting for a fix or odometry", "check_modes_local_pos")
    if needs_position and estimator.origin is None:
        yield ArmingProblem(Check.POSITION, "no global origin", "check_modes_global_pos")
    if battery_share < craft.tuning.battery_low:
        yield ArmingProblem(Check.BATTERY, f"battery low: {100.0 * battery_share:.0f} %", "check_battery_low")
    if craft.tuning.pilot_required and now_s - craft.pilot.last_seen_s > craft.tuning.pilot_timeout_s:
        yield ArmingProblem(Check.PILOT, "no transmitter", "check_modes_manual_control")
    if craft.is_leaking:
        yield ArmingProblem(Check.HEALTH, "leak detected")
    if craft.fault:
        yield ArmingProblem(Check.HEALTH, craft.fault)
