"""An autopilot as a device: takes commands after a delay, changes modes by its style, and refuses what it is told to."""

from msgspec.structs import replace

from gloc3.messages.frames import Vector3
from gloc3.messages.vehicle import AutopilotState, FlightMode, LandedState, VehicleClass
from gloc3_onboard.autopilot import ardupilot, px4
from gloc3_onboard.sensors.devices import AutopilotBehaviour, AutopilotSetpoint, CommandAnswer

from .messages import standing


class ScriptedAutopilot:
    """Driven by `tick`; `reported` is its true state, and what its sampler would report.

    Args:
        style: `px4` or `ardupilot`.
    """

    def __init__(self, style: str = "px4", vehicle: VehicleClass = VehicleClass.COPTER) -> None:
        self.is_px4 = style == "px4"
        self.vehicle = vehicle
        self.reported: AutopilotState = standing(FlightMode.HOLD if self.is_px4 else FlightMode.MANUAL)
        self.setpoints: list[tuple[float, Vector3 | None, Vector3 | None]] = []
        """When, position, velocity."""
        self.commands: list[str] = []
        """Everything that was commanded, in words."""
        self.refuses: dict[str, str] = {}
        """The begin of a command's words to the reason."""
        self.is_deaf = False
        self.is_heard = True
        """Whether its link works."""
        self.delay_s = 0.1
        self.now_s = 0.0
        self._waiting: list[tuple[float, int, str]] = []
        self._answers: dict[int, CommandAnswer] = {}
        self._tickets = 0

    # --- the device ---

    def state(self) -> AutopilotState:
        return replace(self.reported, is_connected=self.is_heard)

    @property
    def behaviour(self) -> AutopilotBehaviour:
        classes = px4.CLASSES if self.is_px4 else ardupilot.CLASSES
        return classes[self.vehicle].behaviour

    def send_setpoint(self, setpoint: AutopilotSetpoint) -> None:
        self.setpoints.append((self.now_s, setpoint.position_ned_m, setpoint.velocity_ned_m_s))

    def command_mode(self, mode: FlightMode) -> int:
        return self._command(f"mode {mode}")

    def command_arm(self) -> int:
        return self._command("arm")

    def command_disarm(self, *, is_forced: bool = False) -> int:
        return self._command("disarm, forced" if is_forced else "disarm")

    def command_mission_start(self) -> int:
        return self._command("begin the mission")

    def command_take_off(self, height_m: float) -> int:
        return self._command(f"take off to {height_m:g}")

    def answer(self, ticket: int) -> CommandAnswer | None:
        return self._answers.get(ticket)

    def abandon_commands(self) -> None:
        self.commands.append("abandon")
        self._waiting.clear()

    def _command(self, words: str) -> int:
        self._tickets += 1
        self.commands.append(words)
        self._waiting.append((self.now_s + self.delay_s, self._tickets, words))
        return self._tickets

    # --- what it does ---

    def tick(self, now_s: float) -> AutopilotState:
        """Carries out what is due."""
        self.now_s = now_s
        while self._waiting and self._waiting[0][0] <= now_s + 1e-9:
            _, ticket, words = self._waiting.pop(0)
            if not self.is_deaf:
                reason = next((why for begin, why in self.refuses.items() if words.startswith(begin)), "")
                self._answers[ticket] = CommandAnswer(not reason, reason)
                if not reason:
                    self._do(words)
        return self.reported

    def _do(self, words: str) -> None:
        if words.startswith("mode "):
            self.enter(FlightMode(words.removeprefix("mode ")))
        elif words in ("arm", "disarm"):
            self.reported = replace(self.reported, is_armed=words == "arm")
        else:
            mode = FlightMode.TAKE_OFF if self.is_px4 else self.reported.mode
            self.reported = replace(self.reported, mode=mode, mode_name=str(mode))

    def enter(self, mode: FlightMode) -> None:
        """Somebody changes the mode."""
        landed = LandedState.LANDING if mode is FlightMode.LAND else self.reported.landed
        self.reported = replace(self.reported, mode=mode, mode_name=str(mode), landed=landed)

    def fly(self, mode: FlightMode = FlightMode.HOLD) -> None:
        """It is in the air."""
        self.reported = replace(self.reported, is_armed=True, landed=LandedState.IN_AIR, mode=mode, mode_name=str(mode))

    def touch_down(self) -> None:
        """It has landed and disarms, as both styles do."""
        mode = FlightMode.HOLD if self.is_px4 else self.reported.mode
        self.reported = replace(
            self.reported, is_armed=False, landed=LandedState.ON_GROUND, mode=mode, mode_name=str(mode)
        )

    @property
    def modes_asked(self) -> list[str]:
        """The modes that were commanded, in order."""
        return [words.removeprefix("mode ") for words in self.commands if words.startswith("mode ")]
