"""Failsafes: conditions watched in flight, and which of their actions wins."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gloc3.messages.envelope import Severity
from gloc3_sitl.autopilot.commander import Commander
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.modes import POSITIONED, Behaviour
from gloc3_sitl.autopilot.tuning import Exempt, FailsafeAction, Tuning
from gloc3_sitl.autopilot.verdict import Author

_EXEMPT: Final = {
    Behaviour.MISSION: Exempt.MISSION,
    Behaviour.HOLD: Exempt.HOLD,
    Behaviour.BRAKE: Exempt.HOLD,
    Behaviour.STOP: Exempt.HOLD,
    Behaviour.STREAMED: Exempt.STREAMED,
    Behaviour.LAND: Exempt.LANDING,
    Behaviour.STABILIZE: Exempt.PILOT,
    Behaviour.ALTITUDE: Exempt.PILOT,
    Behaviour.POSITION: Exempt.PILOT,
    Behaviour.DIRECT: Exempt.PILOT,
    Behaviour.STEER: Exempt.PILOT,
    Behaviour.Q_STABILIZE: Exempt.PILOT,
    Behaviour.Q_ALTITUDE: Exempt.PILOT,
}


_PERIOD_S: Final = 0.1
_ATTITUDE_LOST_S: Final = 1.0
"""Silence of the inertial unit after which nothing can be flown any more: so does PX4; ArduPilot's watchdog waits 2 s."""
_STREAM_BACK_S: Final = 1.0
"""Time of steady setpoints after which a loss has ended, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FailsafeRow:
    """One row: a condition, and the action that the tuning assigns to it."""

    name: str
    condition: Callable[["FailsafeMonitor"], str]
    """What is wrong, in words; empty while all is well."""
    action: Callable[[Tuning], FailsafeAction]
    exempt: Callable[[Tuning], int] = lambda _: 0
    is_delayed: bool = False
    """Whether a hold comes first, to give people time."""
    resumes: bool = False
    """Whether the intended mode is entered again when the condition ends, unless something else acts."""


@dataclass(slots=True)
class _Alarm:
    since_s: float
    changes: int
    """Number of mode changes when the alarm rose; a higher number means a later change."""
    is_acted: bool = False


class FailsafeMonitor:
    """Checks every row ten times a second; an action is carried out once, when its condition begins."""

    def __init__(self, commander: Commander) -> None:
        self.commander: Final = commander
        self.craft: Final[Craft] = commander.craft
        self.station_seen_s: float | None = None
        """Last heartbeat of a ground station that counts."""
        self.acting: FailsafeAction = FailsafeAction.NONE
        """The most severe action under way."""
        self.cause = ""
        """Its cause, in a word."""
        self._alarms: dict[str, _Alarm] = {}
        self._undervoltage_since_s: dict[str, float] = {}
        self._changes = 0
        self._polled_s = -_PERIOD_S

    @property
    def is_acting(self) -> bool:
        """Whether the vehicle does something because of a failsafe."""
        return self.acting > FailsafeAction.WARN

    def is_standing(self, name: str) -> bool:
        """Whether the alarm of a row has risen and not been cleared."""
        return name in self._alarms

    def undervoltage_s(self, name: str, least_v: float) -> float:
        """Returns how long the battery has been below a voltage, in seconds; 0 while it is not."""
        now_s = self.craft.now_s
        if self.commander.battery_v < least_v:
            return now_s - self._undervoltage_since_s.setdefault(name, now_s)
        self._undervoltage_since_s.pop(name, None)
        return 0.0

    def station_contact(self, system: int) -> None:
        """A heartbeat of a ground station came in."""
        wanted = self.craft.tuning.station_system
        if wanted in (0, system):
            self.station_seen_s = self.craft.now_s

    def tick(self) -> None:
        """Raises, acts and clears alarms, where it is time."""
        craft, commander = self.craft, self.commander
        if craft.now_s - self._polled_s < _PERIOD_S - 1e-6:
            return
        self._polled_s = craft.now_s
        if not craft.is_armed:
            self._alarms.clear()
            self._undervoltage_since_s.clear()
            self.acting, self.cause = FailsafeAction.NONE, ""
            return
        if commander.mode_changes != self._changes:
            # Somebody chose another mode: what was done before is no longer under way.
            self._changes = commander.mode_changes
            self.acting, self.cause = FailsafeAction.NONE, ""
        for watch in WATCHES:
            text = watch.condition(self)
            alarm = self._alarms.get(watch.name)
            if not text:
                if alarm is not None:
                    del self._alarms[watch.name]
                    craft.send_text(Severity.INFO, f"Failsafe cleared: {watch.name}")
                    if watch.resumes and self.cause == watch.name:
                        self.acting, self.cause = FailsafeAction.NONE, ""
                        commander.set_mode(commander.intended.custom_mode, Author.SELF)
                        self._changes = commander.mode_changes
                continue
            action = watch.action(craft.tuning)
            if action is FailsafeAction.NONE:
                continue
            if alarm is None and _EXEMPT.get(commander.mode.behaviour, 0) & watch.exempt(craft.tuning):
                continue
            if alarm is None:
                alarm = self._alarms[watch.name] = _Alarm(craft.now_s, commander.mode_changes)
                craft.send_text(Severity.CRITICAL, f"Failsafe: {text}")
                if watch.is_delayed and action > FailsafeAction.HOLD and craft.tuning.action_delay_s > 0.0:
                    if not craft.is_landed and self.acting < FailsafeAction.HOLD:
                        self._act(FailsafeAction.HOLD, watch.name)
                        alarm.changes = commander.mode_changes
                    continue
            if alarm.is_acted:
                continue
            waits = watch.is_delayed and action > FailsafeAction.HOLD and craft.tuning.action_delay_s > 0.0
            if waits and craft.now_s - alarm.since_s < craft.tuning.action_delay_s:
                continue
            alarm.is_acted = True
            if (
                waits
                and commander.mode_changes != alarm.changes
                and self.cause != watch.name
                and self.acting < FailsafeAction.HOLD
            ):
                continue  # an operator or the pilot acted within the delay
            if action > self.acting:
                self._act(action, watch.name)

    def _act(self, action: FailsafeAction, cause: str) -> None:
        craft, commander = self.craft, self.commander
        style = commander.style
        if action is FailsafeAction.WARN:
            return
        if craft.is_landed and action < FailsafeAction.DISARM:
            if not commander.has_flown or action in (FailsafeAction.RETURN, FailsafeAction.LAND):
                commander.disarm(Author.FAILSAFE)
            return
        wanted = {
            FailsafeAction.HOLD: style.hold_mode,
            FailsafeAction.BRAKE: style.brake_mode,
            FailsafeAction.POSITION: style.position_mode,
            FailsafeAction.RETURN: style.return_mode,
            FailsafeAction.LAND: style.land_mode,
        }
        match action:
            case FailsafeAction.DISARM:
                commander.disarm(Author.FAILSAFE, is_forced=True)
            case FailsafeAction.TERMINATE:
                commander.terminate()
            case _:
                custom = wanted[action]
                if action is FailsafeAction.POSITION and not commander.has_pilot:
                    custom = style.hold_mode
                mode = style.mode(custom)
                assert mode is not None
                if commander.mode.behaviour is Behaviour.LAND:
                    custom = style.land_mode  # a landing is never broken off for something milder
                elif commander.cannot_fly(mode):
                    custom = (
                        style.altitude_mode
                        if commander.has_pilot and action is FailsafeAction.POSITION
                        else style.land_mode
                    )
                if commander.mode.custom_mode != custom:
                    commander.set_mode(custom, Author.FAILSAFE)
        self.acting, self.cause = action, cause
        self._changes = commander.mode_changes


# -- conditions ---------------------------------------------------------------------------------------------------


def _station_lost(safes: FailsafeMonitor) -> str:
    seen, tuning = safes.station_seen_s, safes.craft.tuning
    if seen is None or safes.craft.now_s - seen <= tuning.station_timeout_s:
        return ""
    return "ground station lost"


def _pilot_lost(safes: FailsafeMonitor) -> str:
    pilot, craft = safes.craft.pilot, safes.craft
    if pilot.last_seen_s < 0.0 or safes.commander.has_pilot:
        return ""
    return "transmitter lost" if craft.now_s - pilot.last_seen_s > craft.tuning.pilot_timeout_s else ""


def _stream_lost(safes: FailsafeMonitor) -> str:
    commander, craft = safes.commander, safes.craft
    if commander.intended.behaviour is not Behaviour.STREAMED or not commander.style.streamed_needs_stream:
        return ""
    if not craft.stream.is_fresh(craft.now_s, craft.tuning.stream_timeout_s):
        return "setpoints lost"
    is_young = craft.now_s - craft.stream.since_s < _STREAM_BACK_S
    return "setpoints lost" if safes.is_standing("setpoints") and is_young else ""


def _battery(
    level: Callable[[Tuning], float], word: str, least_v: Callable[[Tuning], float] = lambda _: 0.0
) -> Callable[[FailsafeMonitor], str]:
    def condition(safes: FailsafeMonitor) -> str:
        share, tuning = safes.commander.battery_share, safes.craft.tuning
        if share < level(tuning):
            return f"battery {word} ({100.0 * share:.0f} %)"
        if safes.undervoltage_s(word, least_v(tuning)) > tuning.battery_wait_s:
            return f"battery {word} ({safes.commander.battery_v:.1f} V)"
        return ""

    return condition


def _position_lost(safes: FailsafeMonitor) -> str:
    commander, craft = safes.commander, safes.craft
    estimator, now_s = craft.estimator, craft.now_s
    needs = commander.mode.behaviour in POSITIONED
    standing = safes.is_standing("position")
    if not (needs or standing) or estimator.is_position_good(now_s):
        return ""
    last = max(estimator.fix_state.accepted_s, estimator.external_state.accepted_s)
    return "position lost" if standing or now_s - last > craft.tuning.position_lost_s else ""


def _attitude_lost(safes: FailsafeMonitor) -> str:
    silent_s = safes.craft.now_s - safes.craft.estimator.inertial.t_s
    return "attitude lost" if silent_s > _ATTITUDE_LOST_S else ""


def _fence_broken(safes: FailsafeMonitor) -> str:
    if safes.craft.is_landed:
        return ""
    return safes.commander.fence.watch(safes.craft)


WATCHES: Final = (
    FailsafeRow(
        name="setpoints", condition=_stream_lost, action=lambda tuning: tuning.stream_lost_action, resumes=True
    ),
    FailsafeRow(
        name="station",
        condition=_station_lost,
        action=lambda tuning: tuning.station_lost_action,
        exempt=lambda tuning: tuning.station_lost_exempt,
        is_delayed=True,
    ),
    FailsafeRow(
        name="transmitter",
        condition=_pilot_lost,
        action=lambda tuning: tuning.pilot_lost_action,
        exempt=lambda tuning: tuning.pilot_lost_exempt,
        is_delayed=True,
    ),
    FailsafeRow(
        name="low battery",
        condition=_battery(lambda tuning: tuning.battery_low, "low", lambda tuning: tuning.battery_low_v),
        action=lambda tuning: tuning.battery_low_action,
        is_delayed=True,
    ),
    FailsafeRow(
        name="critical battery",
        condition=_battery(
            lambda tuning: tuning.battery_critical, "critical", lambda tuning: tuning.battery_critical_v
        ),
        action=lambda tuning: tuning.battery_critical_action,
        is_delayed=True,
    ),
    FailsafeRow(
        name="emergency battery",
        condition=_battery(lambda tuning: tuning.battery_emergency, "nearly empty"),
        action=lambda tuning: tuning.battery_emergency_action,
    ),
    FailsafeRow(
        name="transition",
        condition=lambda safes: safes.craft.vtol.problem if safes.craft.vtol is not None else "",
        action=lambda tuning: tuning.transition_action,
    ),
    FailsafeRow(
        name="leak",
        condition=lambda safes: "Leak Detected" if safes.craft.is_leaking else "",
        action=lambda tuning: tuning.leak_action,
    ),
    FailsafeRow(
        name="crash",
        condition=lambda safes: "Crash: Disarming" if safes.craft.crash.has_crashed else "",
        action=lambda tuning: tuning.crash_action,
    ),
    FailsafeRow(name="attitude", condition=_attitude_lost, action=lambda _: FailsafeAction.TERMINATE),
    FailsafeRow(name="position", condition=_position_lost, action=lambda tuning: tuning.position_lost_action),
    FailsafeRow(name="fence", condition=_fence_broken, action=lambda tuning: tuning.fence_action),
)
"""Every failsafe, in order of evaluation."""
