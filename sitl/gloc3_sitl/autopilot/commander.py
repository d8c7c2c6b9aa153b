"""The commander: arming, modes, home, and the transition after a finished behaviour."""

from collections.abc import Callable, Iterator
from math import inf, nan
from typing import Final

from gloc3.messages.envelope import Severity
from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.arming import ArmingProblem, ArmPermission, Authorization, Check, vehicle_problems
from gloc3_sitl.autopilot.behaviours.base import Activity, FliesMission, GoesTo, TakesOff
from gloc3_sitl.autopilot.behaviours.choice import activity_for
from gloc3_sitl.autopilot.behaviours.hold import HoldPosition
from gloc3_sitl.autopilot.behaviours.orbit import Orbit, OrbitCircle
from gloc3_sitl.autopilot.control.setpoint import Setpoint
from gloc3_sitl.autopilot.craft import Craft, HomePosition
from gloc3_sitl.autopilot.fence import FenceMonitor
from gloc3_sitl.autopilot.modes import PILOTED, POSITIONED, Behaviour, Mode, Result, StyleTables
from gloc3_sitl.autopilot.tuning import FailsafeAction
from gloc3_sitl.autopilot.verdict import ACCEPTED, Author, RequestVerdict


class Commander:
    """Current mode, changed on permitted requests; every refusal has a reason."""

    def __init__(self, craft: Craft, style: StyleTables, authorization: Authorization) -> None:
        self.craft: Final = craft
        self.authorization: Final = authorization
        self.on_arming_settled: Callable[[RequestVerdict], None] = lambda _: None
        """Called with the result of an arming attempt that waited for authorization."""
        self.on_arming_refused: Callable[[], None] = lambda: None
        """Called when a failed check has refused arming."""
        self._arming: Author | None = None
        self.style: Final = style
        self.fence: Final = FenceMonitor()
        mode = style.mode(style.boot_mode)
        assert mode is not None
        self.mode: Mode = mode
        self.intended: Mode = mode
        """Last mode that was not the choice of a failsafe."""
        self._arming_mode: Mode = mode
        """Last intended mode that can arm."""
        self.activity: Activity = HoldPosition(craft)
        self._ignores_pilot = False
        self.battery_share, self.battery_v = 1.0, inf
        """Set by the battery monitor."""
        self.is_terminated = False
        self.armed_s = -1e9
        self.mode_author: Author = Author.SELF
        self.mode_changes = 0
        self.has_flown = False
        self._takeoff_down_m = nan
        self._resets = 0
        self._jump_ned_m: Vector3 = (0.0, 0.0, 0.0)

    # -- arming ---------------------------------------------------------------------------------------------------

    def problems(self, *, counts_mode: bool = True) -> list[str]:
        """Returns the reasons against arming now in words, worst first, with or without those of the mode."""
        return [problem.text for problem in self.arming_problems(self.mode, counts_mode=counts_mode)]

    def arming_problems(self, mode: Mode, *, counts_mode: bool = True) -> list[ArmingProblem]:
        """Returns the reasons against arming now in a mode."""
        craft, mask = self.craft, self.craft.tuning.check_mask
        found = [
            problem for problem in vehicle_problems(craft, mode.behaviour, self.battery_share) if problem.check & mask
        ]
        if counts_mode:
            found += self._mode_problems(mode)
        if craft.home is not None and Check.FENCE & mask:
            breach = self.fence.breach(craft)
            if breach:
                found.append(ArmingProblem(Check.FENCE, breach, "check_gf_violation_custom_gf"))
        return found

    def _mode_problems(self, mode: Mode) -> Iterator[ArmingProblem]:
        """Yields the unmet requirements of a mode."""
        craft = self.craft
        if not mode.can_arm:
            yield ArmingProblem(Check.MODE, f"mode {mode.name} does not allow arming", "check_modes_cannot_takeoff")
        if mode.behaviour in self.style.on_earth and not craft.estimator.is_yaw_aligned:
            text = "no global position: the heading is not aligned with north"
            yield ArmingProblem(Check.MODE, text, "check_modes_global_pos")
        if mode.behaviour is Behaviour.MISSION and self.style.reports_by_event:
            problem = self._mission_problem()
            if problem:
                yield ArmingProblem(Check.MODE, problem, "check_modes_mission")
        if self._needs_stream(mode) and not craft.stream.is_fresh(craft.now_s, craft.tuning.stream_timeout_s):
            yield ArmingProblem(Check.MODE, "offboard control signal lost", "check_modes_offboard_signal")

    def arm(self, author: Author, *, is_forced: bool = False) -> RequestVerdict:
        """Starts the motors; IN_PROGRESS while an authorization is pending."""
        craft, style = self.craft, self.style
        if craft.is_armed:
            return ACCEPTED
        if self.is_terminated:
            return self._refuse("Arming denied: flight was terminated")
        if not is_forced:
            problems = self.problems()
            if problems:
                texts = ["resolve the reported health failures first"] if style.reports_by_event else problems[:3]
                for text in texts:
                    craft.send_text(Severity.CRITICAL, f"{style.arming_prefix}{text}")
                self.on_arming_refused()
                return RequestVerdict(style.refused, problems[0])
            match self.authorization.leave():
                case ArmPermission.AWAITED:
                    self._arming = author
                    return RequestVerdict(Result.IN_PROGRESS)
                case ArmPermission.REFUSED:
                    return RequestVerdict(style.refused, "arming not authorized")
                case ArmPermission.GIVEN:
                    pass
        craft.is_armed = True
        self.armed_s = craft.now_s
        self.has_flown = False
        self.set_home()
        if self.mode.behaviour is Behaviour.MISSION:
            craft.mission.restart(craft.first_item)
        self._restart_activity()
        craft.send_text(Severity.INFO, f"Armed by {author}")
        return ACCEPTED

    def disarm(self, author: Author, *, is_forced: bool = False) -> RequestVerdict:
        """Stops the motors; in the air only if forced."""
        craft = self.craft
        if not craft.is_armed:
            return ACCEPTED
        if not (craft.is_grounded or is_forced or self.style.disarms_in_motion):
            return self._refuse("Disarming denied: not landed")
        craft.is_armed = False
        craft.send_text(Severity.INFO, f"Disarmed by {author}")
        if self.style.keeps_intention and not self.is_terminated and self.mode is not self._arming_mode:
            self._enter(self._arming_mode.custom_mode, Author.SELF)
        else:
            self._restart_activity()
        return ACCEPTED

    def terminate(self) -> None:
        """Stops the motors wherever the vehicle is, and does not let it arm again."""
        self.is_terminated = True
        self.craft.send_text(Severity.EMERGENCY, "Flight terminated")
        self.disarm(Author.FAILSAFE, is_forced=True)
        self.activity = activity_for(Behaviour.TERMINATED, self.craft, nan, self.style)

    def set_home(self, position_ned_m: Vector3 | None = None) -> RequestVerdict:
        """Sets home to a position, by default the current one."""
        craft = self.craft
        origin = craft.estimator.origin
        is_known = craft.estimator.is_position_good(craft.now_s) and craft.estimator.is_yaw_aligned
        if origin is None or (position_ned_m is None and not is_known):
            return self._refuse("Home not set: position unknown")
        position = craft.estimator.inertial.position_ned_m if position_ned_m is None else position_ned_m
        craft.home = HomePosition(origin.geo_from_ned(position), position, craft.estimator.yaw_rad)
        return ACCEPTED

    # -- modes ----------------------------------------------------------------------------------------------------

    def set_mode(self, custom_mode: int, author: Author) -> RequestVerdict:
        """Changes the mode; refused where the mode cannot be flown now."""
        mode = self.style.mode(custom_mode)
        if mode is None:
            return RequestVerdict(self.style.unknown_mode, "unknown mode")
        if mode is self.mode and author is not Author.FAILSAFE:
            self.mode_author = author
            self._intend(mode)
            if mode.behaviour is Behaviour.HOLD and not self.craft.is_landed:
                self._restart_activity()  # whoever asks for a hold means here, not where it was told to go before
            return ACCEPTED
        problem = self.cannot_fly(mode)
        if problem and (self.craft.is_armed or self.is_terminated or not self.style.keeps_intention):
            return self._refuse(f"{mode.name} denied: {problem}")
        self._enter(custom_mode, author)
        return ACCEPTED

    def cannot_fly(self, mode: Mode) -> str:
        """Returns why a mode cannot be entered now; empty if it can."""
        craft = self.craft
        if self.is_terminated:
            return "flight was terminated"
        if mode.behaviour in POSITIONED and not craft.estimator.is_position_good(craft.now_s):
            return "no position"
        if craft.is_armed and mode.behaviour in self.style.on_earth and not craft.estimator.is_yaw_aligned:
            return "no global position"
        if mode.behaviour is Behaviour.LAND and craft.flight is not None and not craft.flight.is_flying:
            return "it does not fly"
        if mode.behaviour is Behaviour.MISSION:
            problem = self._mission_problem()
            if problem:
                return problem
        if self._needs_stream(mode) and not craft.stream.is_streaming(craft.now_s, craft.tuning.stream_needed_hz):
            return "no setpoints are streamed"
        if mode.behaviour in PILOTED and craft.is_armed and not self.has_pilot:
            return "no transmitter" if mode.behaviour is not Behaviour.POSITION else ""
        return ""

    def _mission_problem(self) -> str:
        """Why the uploaded mission cannot be flown; empty if it can."""
        craft = self.craft
        if len(craft.plans.mission) <= craft.first_item:
            return "no mission"
        lacking = craft.plans.lacks(craft.tuning.mission_requires, is_landed=craft.is_landed)
        return f"the mission has no {lacking}" if lacking else ""

    def _needs_stream(self, mode: Mode) -> bool:
        return mode.behaviour is Behaviour.STREAMED and self.style.streamed_needs_stream

    @property
    def has_pilot(self) -> bool:
        """Whether a transmitter is connected."""
        return self.craft.now_s - self.craft.pilot.last_seen_s <= self.craft.tuning.pilot_timeout_s

    def ignore_pilot(self, is_ignored: bool) -> None:
        """Takes nothing from the transmitter while it is calibrated, as PX4 does."""
        if is_ignored is not self._ignores_pilot:
            self._ignores_pilot = is_ignored
            what = "Disabling" if is_ignored else "Restoring"
            self.craft.send_text(Severity.INFO, f"Calibration: {what} RC input")

    def take_off(self, target_down_m: float) -> RequestVerdict:
        """Climbs to a height (NED down); NaN means the default. The vehicle must be armed."""
        craft, style = self.craft, self.style
        if not craft.is_armed:
            return self._refuse("Take-off denied: not armed")
        base = craft.home.position_ned_m[2] if craft.home is not None else 0.0
        target = base - craft.tuning.takeoff_height_m if target_down_m != target_down_m else target_down_m
        if style.takeoff_in_streamed:
            if self.mode.behaviour is not Behaviour.STREAMED or not isinstance(self.activity, TakesOff):
                return self._refuse("Take-off denied: not in GUIDED")
            if not craft.is_landed:
                return self._refuse("Take-off denied: already flying")
            self.activity.take_off(target)
            return ACCEPTED
        takeoff = style.mode(style.takeoff_mode)
        assert takeoff is not None
        problem = self.cannot_fly(takeoff)
        if problem:
            return self._refuse(f"Take-off denied: {problem}")
        self._takeoff_down_m = target
        if self.mode.custom_mode == style.takeoff_mode:
            self._restart_activity()
        else:
            self._enter(style.takeoff_mode, Author.COMMAND)
        return ACCEPTED

    def go_to(self, position_ned_m: Vector3, yaw_rad: float, speed_m_s: float) -> RequestVerdict:
        """Flies to a position and holds there, in the style's mode for it."""
        craft, style = self.craft, self.style
        if not craft.is_armed or craft.is_landed:
            return self._refuse("Go-to denied: not flying")
        wanted = style.streamed_mode if style.takeoff_in_streamed else style.hold_mode
        if self.mode.custom_mode != wanted:
            verdict = self.set_mode(wanted, Author.COMMAND)
            if not verdict.is_accepted:
                return verdict
        acts = not style.takeoff_in_streamed and craft.tuning.fence_action > FailsafeAction.WARN
        if acts and self.fence.breach(craft, position_ned_m):  # PX4 acknowledges it all the same, and holds
            craft.send_text(Severity.CRITICAL, "Reposition is outside geofence")
        elif isinstance(self.activity, GoesTo):
            self.activity.go_to(position_ned_m, yaw_rad, speed_m_s)
        return ACCEPTED

    def orbit(self, circle: OrbitCircle) -> RequestVerdict:
        """Flies to a circle and orbits on it, if the style has such a mode."""
        if self.style.orbit_mode is None:
            return RequestVerdict(Result.UNSUPPORTED, "orbit is not supported")
        if not self.craft.is_armed or self.craft.is_landed:
            return self._refuse("Orbit denied: not flying")
        verdict = self.set_mode(self.style.orbit_mode, Author.COMMAND)
        if isinstance(self.activity, Orbit):
            self.activity.go_round(circle)
        return verdict

    def _enter(self, custom_mode: int, author: Author) -> None:
        mode = self.style.mode(custom_mode)
        assert mode is not None
        if self.mode.behaviour is Behaviour.MISSION and isinstance(self.activity, FliesMission):
            self.craft.mission_left()
        self.mode, self.mode_author = mode, author
        if author is not Author.FAILSAFE:
            self._intend(mode)
        self.craft.is_facing = None
        self.mode_changes += 1
        self._restart_activity()

    def _intend(self, mode: Mode) -> None:
        self.intended = mode
        if mode.can_arm:
            self._arming_mode = mode

    def _restart_activity(self) -> None:
        target, self._takeoff_down_m = self._takeoff_down_m, nan
        self.activity = activity_for(self.mode.behaviour, self.craft, target, self.style)

    def _refuse(self, reason: str) -> RequestVerdict:
        self.craft.send_text(Severity.WARNING, reason)
        return RequestVerdict(self.style.refused, reason)

    # -- as time goes on ------------------------------------------------------------------------------------------

    def tick(self) -> Setpoint:
        """Updates mode and activity, 50 times a second after the failsafes."""
        craft = self.craft
        estimator = craft.estimator
        if estimator.reset_count != self._resets:
            self._resets = estimator.reset_count
            was, self._jump_ned_m = self._jump_ned_m, estimator.jump_ned_m
            north, east, down = (now - before for now, before in zip(estimator.jump_ned_m, was, strict=True))
            self.activity.on_jump((north, east, down))
        if craft.home is None and estimator.place is not None and estimator.is_position_good(craft.now_s):
            self.set_home()
        self.fence.tick(craft)
        self._mind_pilot()
        self._mind_authorizer()
        if not craft.is_landed:
            self.has_flown = True
        if craft.is_armed:
            self._mind_idle_motors()
        setpoint = self.activity.update()
        if self.activity.is_done and craft.is_armed and not craft.is_landed:
            follows = self.style.goes_on.get(self.mode.behaviour)
            if follows is not None:
                self._enter(follows, Author.SELF)
        return setpoint

    def _mind_authorizer(self) -> None:
        """Arms when authorized, and gives up after the time-out."""
        self.authorization.tick()
        if self._arming is not None and not self.authorization.is_awaited:
            author, self._arming = self._arming, None
            is_given = self.authorization.is_given
            self.on_arming_settled(
                self.arm(author) if is_given else RequestVerdict(self.style.refused, "arming not authorized")
            )

    def _mind_pilot(self) -> None:
        craft = self.craft
        pilot = craft.pilot
        if craft.now_s > pilot.held_until_s:
            pilot.switch_off()
        if not pilot.is_on:
            return
        if pilot.has_transmitter:
            pilot.last_seen_s = craft.now_s
        if self._ignores_pilot:
            return
        if pilot.is_killed:
            pilot.is_killed = False
            craft.send_text(Severity.CRITICAL, "Kill switch")
            self.disarm(Author.PILOT, is_forced=True)
        if pilot.mode_wanted is not None:
            wanted = self.style.mode_named(pilot.mode_wanted)
            pilot.mode_wanted = None
            if wanted is None:
                self._refuse("the mode switch selects an unknown mode")
            else:
                self.set_mode(wanted.custom_mode, Author.PILOT)
        if pilot.arm_wanted is not None:
            if pilot.arm_wanted:
                self.arm(Author.PILOT)
            else:
                self.disarm(Author.PILOT, is_forced=self.style.pilot_disarms_in_air)
            pilot.arm_wanted = None
        behaviour, override = self.mode.behaviour, craft.tuning.pilot_override
        if behaviour in PILOTED or not craft.is_armed or not override or craft.is_landed:
            return
        if pilot.deflection() > craft.tuning.pilot_override_stick and override & (
            2 if behaviour is Behaviour.STREAMED else 1
        ):
            craft.send_text(Severity.NOTICE, "Pilot took over using sticks")
            position_good = craft.estimator.is_position_good(craft.now_s)
            self._enter(self.style.position_mode if position_good else self.style.altitude_mode, Author.PILOT)

    def _mind_idle_motors(self) -> None:
        """Stops the motors of a standing vehicle."""
        craft, tuning = self.craft, self.craft.tuning
        if not craft.is_landed:
            return
        if not self.has_flown:
            wait, since = tuning.disarm_unflown_s, self.armed_s
            if wait <= 0.0:
                return
        else:
            is_landing = self.mode.behaviour in (Behaviour.LAND, Behaviour.RETURN, Behaviour.MISSION)
            wait = tuning.disarm_after_landing_s if is_landing else tuning.disarm_idle_s
            since = craft.touchdown.landed_s
            if wait < 0.0:
                return
        if craft.now_s - since >= wait:
            self.disarm(Author.SELF)
