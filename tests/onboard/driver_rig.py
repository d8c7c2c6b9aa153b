"""The autopilot driver with a scripted autopilot, its state every 0.2 s and its poses at 20 Hz."""

from collections.abc import Callable
from typing import Any

from gloc3.messages.envelope import Message
from gloc3.messages.vehicle import DriverState, FlightMode, Manoeuvre, ManoeuvreKind, MotionGrant
from gloc3_onboard.components.drivers.autopilot import AutopilotDriver
from gloc3_onboard.components.drivers.manoeuvres import DriverSettings

from .messages import LIMITS, autopilot_pose, grant, pose, setpoint
from .scripted_autopilot import ScriptedAutopilot
from .stage import Stage

STEP_S = 0.05


class DriverRig:
    """A driver that has been granted motion; the vehicle is where `at` says."""

    def __init__(self, style: str = "px4", autopilot: ScriptedAutopilot | None = None, **settings: Any) -> None:
        self.autopilot = autopilot or ScriptedAutopilot(style)
        self.driver = AutopilotDriver(self.autopilot)
        self.stage = Stage(self.driver, DriverSettings(**settings))
        self.at = (0.0, 0.0, 0.0)
        """North, east, height in our frame; the autopilot's is 10 m farther north."""
        self.wants: Callable[[], Message | None] = lambda: None
        """The setpoint of each cycle."""
        self._count = 0
        self.stage.put(limits=LIMITS, grant=grant())

    @property
    def now_s(self) -> float:
        return self.stage.now_s

    @property
    def state(self) -> DriverState:
        found = self.stage.last(DriverState)
        assert isinstance(found, DriverState)
        return found

    def step(self, **messages: Message) -> None:
        now_s = self.now_s + STEP_S
        before, state = self.autopilot.reported, self.autopilot.tick(now_s)
        if self._count % 4 == 0 or state is not before:
            messages.setdefault("autopilot", state)
        self._count += 1
        north, east, height = self.at
        messages.setdefault("pose", pose(north, east, height))
        messages.setdefault("autopilot_pose", autopilot_pose(north - 10.0, east, height))
        wanted = self.wants()
        if wanted is not None:
            messages.setdefault("setpoint", wanted)
        self.stage.step(STEP_S, **messages)

    def run(self, seconds: float, **messages: Message) -> None:
        """Lets time pass; the messages come with the first cycle."""
        for index in range(round(seconds / STEP_S)):
            self.step(**(messages if index == 0 else {}))

    def see(self) -> None:
        """The autopilot has changed by itself, or by a pilot's hand; the driver is told."""
        self.step(autopilot=self.autopilot.reported)

    def hold(self, owner: str = "go") -> None:
        """The owner asks for the present place from now on."""
        north, east, height = self.at
        self.wants = lambda: setpoint((north, east, -height), (0.0, 0.0, 0.0), owner)

    def own(self, owner: str) -> MotionGrant:
        """Motion goes to somebody."""
        given = grant(owner)
        self.stage.put(grant=given)
        return given

    def request(self, kind: ManoeuvreKind, owner: str = "go", **fields: Any) -> None:
        """The owner asks for a manoeuvre."""
        self.step(manoeuvre=Manoeuvre(action_id=owner, kind=kind, **fields))

    def in_flight(self) -> "DriverRig":
        """Takes off for the owner and streams until the autopilot follows."""
        self.step()
        self.request(ManoeuvreKind.TAKE_OFF, height_m=2.0, may_arm=True)
        self.run(1.0)
        self.at = (0.0, 0.0, 2.0)
        self.step()
        self.autopilot.fly(FlightMode.HOLD if self.autopilot.is_px4 else FlightMode.GUIDED)
        self.hold()
        self.run(2.0)
        assert self.state.is_guided, self.state
        assert not self.state.has_pilot_control, self.state.pilot_reason
        return self
