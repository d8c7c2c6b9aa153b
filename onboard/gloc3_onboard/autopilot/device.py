"""The autopilot as a device of samplers and drivers: telemetry, height, satellites, wheels, setup, and control.

Its methods may be called from any thread: readings are immutable, commands are passed to the link's event loop.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from gloc3.errors import Refused
from gloc3.messages.readiness import AutopilotSetup
from gloc3.messages.vehicle import AutopilotState, FlightMode, Pose, Style
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.formats.items import FenceArea
from gloc3_onboard.autopilot.commands import NO_OWNER
from gloc3_onboard.autopilot.health_words import FENCE_BIT
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.autopilot.sensors import FIX_HZ, WHEELS_HZ
from gloc3_onboard.autopilot.setpoints import ControlLead
from gloc3_onboard.autopilot.style import (
    ARM_DISARM,
    DO_SET_HOME,
    MISSION_START,
    PROGRESS,
    SET_EKF_SOURCE_SET,
    MavCommand,
)
from gloc3_onboard.autopilot.vision import Spread, odometry_message, origin_message
from gloc3_onboard.payload.outputs import OutputWrite, output_command
from gloc3_onboard.sensors.devices import (
    AutopilotBehaviour,
    AutopilotSetpoint,
    Bell,
    CommandAnswer,
    FileProgress,
    GeoPath,
    Stamped,
    StampedFix,
    StampedHeight,
    StampedWheels,
    Unwatch,
)

FORCE: Final = 21196.0
"""What COMPONENT_ARM_DISARM takes for disarming in flight (MAVLink, MAV_CMD_COMPONENT_ARM_DISARM)."""


class AutopilotDevice:
    """Implements the telemetry, height and control devices of one autopilot.

    Args:
        link: the conversation with it.
    """

    def __init__(self, link: AutopilotLink) -> None:
        self._link = link
        self._lead = ControlLead(link.telemetry)
        self._rung: tuple[object, object, object, object] = (None, None, None, None)
        self._on_state, self._on_pose, self._on_height, self._on_setup = Bell(), Bell(), Bell(), Bell()
        link.reports.listen(self._ring)

    def _ring(self) -> None:
        """Notifies subscribers of new data."""
        state, pose, height, attitude = self._rung
        telemetry = self._link.telemetry
        self._rung = (telemetry.state, telemetry.pose, telemetry.height, telemetry.attitude)
        if telemetry.pose is not pose or telemetry.attitude is not attitude:
            self._on_pose.ring()
        if telemetry.height is not height:
            self._on_height.ring()
        if telemetry.state is not state:
            self._on_state.ring()
        if self._link.inspection.events():
            self._on_setup.ring()

    # --- telemetry ---

    def state(self) -> AutopilotState:
        """The latest mode, arming state and battery."""
        return self._link.telemetry.state

    def pose(self) -> Stamped | None:
        """The latest estimate; None before the first."""
        return self._link.telemetry.pose

    def attitude(self) -> Stamped | None:
        """The latest attitude that came without a position; None before the first."""
        return self._link.telemetry.attitude

    def height(self) -> StampedHeight | None:
        """The latest distance to the ground; None before the first."""
        return self._link.telemetry.height

    def fix(self) -> StampedFix | None:
        """The latest satellite fix; None before the first."""
        return self._link.sensors.satellites

    def wheels(self) -> StampedWheels | None:
        """The latest wheel distances; None before the first."""
        return self._link.sensors.wheels

    def setup(self) -> AutopilotSetup:
        """Firmware, parameters that matter, and sensors' health, as known now."""
        return self._link.inspection.setup

    def on_setup(self, changed: Callable[[], None]) -> Unwatch:
        """Calls `changed` when the setup has changed, or was read again."""
        return self._on_setup.listen(changed)

    def on_state(self, changed: Callable[[], None]) -> Unwatch:
        """Calls `changed` when the state has changed."""
        return self._on_state.listen(changed)

    def on_pose(self, ready: Callable[[], None]) -> Unwatch:
        """Calls `ready` on each new estimate."""
        return self._on_pose.listen(ready)

    def on_height(self, ready: Callable[[], None]) -> Unwatch:
        """Calls `ready` on each new distance."""
        return self._on_height.listen(ready)

    def on_fix(self, ready: Callable[[], None]) -> Unwatch:
        """Requests satellite fixes, and calls `ready` on each new one."""
        self._link.sensors.want("satellites", FIX_HZ)
        return self._link.sensors.fix_bell.listen(ready)

    def on_wheels(self, ready: Callable[[], None]) -> Unwatch:
        """Requests the wheel encoders, and calls `ready` on each new reading."""
        self._link.sensors.want("wheels", WHEELS_HZ)
        return self._link.sensors.wheels_bell.listen(ready)

    # --- commands ---

    def _command(self, make: Callable[[], MavCommand | CommandAnswer]) -> int:
        """Sends the result of `make` on the loop's thread, or stores its answer."""
        ticket = self._link.commands.ticket()

        def send() -> None:
            now_s, made = self._link.loop.time(), make()
            if isinstance(made, CommandAnswer):
                self._link.commands.put(ticket, made)
            else:
                self._link.commands.send(ticket, made, self._link.target, now_s)
            self._link.settle()

        self._link.post(send)
        return ticket

    # --- the control device ---

    @property
    def behaviour(self) -> AutopilotBehaviour:
        """How the connected autopilot is commanded."""
        return self._link.style.class_properties.behaviour

    def send_setpoint(self, setpoint: AutopilotSetpoint) -> None:
        """Streams one setpoint."""

        def send() -> None:
            if self._link.target is None:
                return
            message = self._lead.message(
                setpoint, self._link.style.class_properties, self._link.target, self._link.loop.time()
            )
            if message is not None:
                self._link.send_message(message)
            if self._lead.gap:
                self._link.report(self._lead.gap)
                self._lead.gap = ""

        self._link.post(send)

    def send_pose(self, pose: Pose, t_s: float, attitude_std_rad: float, velocity_std_m_s: float) -> None:
        """Sends the autopilot its pose at the time `t_s`."""
        spread = Spread(attitude_std_rad, velocity_std_m_s)

        def send() -> None:
            if self._link.target is not None:
                boot_s = self._link.clock_offset.boot_s(min(t_s, self._link.loop.time()))
                boot_us, frame = max(0, round(boot_s * 1e6)), self._link.style.odometry_frame
                self._link.send_message(odometry_message(pose, boot_us, spread, frame))

        self._link.post(send)

    def command_source_set(self, number: int) -> int:
        """Asks ArduPilot's estimator to fly by the set of sources 1, 2 or 3."""

        def make() -> MavCommand | CommandAnswer:
            if self._link.style.style is not Style.ARDUPILOT:
                return CommandAnswer(False, "PX4 has no source sets: choose with EKF2_EV_CTRL and EKF2_GPS_CTRL")
            return MavCommand(SET_EKF_SOURCE_SET, (float(number), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))

        return self._command(make)

    @property
    def contacts(self) -> int:
        """Times that an autopilot was found, came back or restarted."""
        return self._link.contacts

    def command_home(self, place_geo: tuple[float, float, float]) -> int:
        """Sends the autopilot its home position, which it cannot know without satellites."""
        latitude, longitude, altitude = place_geo
        return self._command(lambda: MavCommand(DO_SET_HOME, (0.0, 0.0, 0.0, 0.0, latitude, longitude, altitude)))

    def send_origin(self, origin_geo: tuple[float, float, float]) -> None:
        """Sends the autopilot the origin of the frame of the poses."""

        def send() -> None:
            if self._link.target is not None:
                self._link.send_message(origin_message(origin_geo, self._link.target))

        self._link.post(send)

    def command_mode(self, mode: FlightMode) -> int:
        """Requests a mode."""
        return self._command(lambda: self._link.style.mode_command(mode, self._link.telemetry.state.form))

    def command_arm(self) -> int:
        """Requests arming."""
        return self._command(lambda: MavCommand(ARM_DISARM, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))

    def command_disarm(self, *, is_forced: bool = False) -> int:
        """Requests disarming; the autopilot refuses it in flight, unless it is forced."""
        force = FORCE if is_forced else 0.0
        return self._command(lambda: MavCommand(ARM_DISARM, (0.0, force, 0.0, 0.0, 0.0, 0.0, 0.0)))

    def command_mission_start(self) -> int:
        """Requests that the uploaded mission begins."""
        return self._command(lambda: MavCommand(MISSION_START, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))

    def command_take_off(self, height_m: float) -> int:
        """Requests a take-off to a height above the current position."""

        def make() -> MavCommand | CommandAnswer:
            ground_m = self._link.telemetry.altitude_m
            if ground_m is None:
                return CommandAnswer(False, "the autopilot has not sent its altitude yet")
            return self._link.style.take_off_command(height_m, ground_m)

        return self._command(make)

    def send_output(self, write: OutputWrite) -> int:
        """Commands a servo, gripper, relay or winch; commands of one kind are sent one after the other."""
        ticket = self._link.commands.ticket()

        def send() -> None:
            desk = self._link.commands
            try:
                command = MavCommand(*output_command(write, self._link.style.style))
            except Refused as refusal:
                desk.put(ticket, CommandAnswer(False, str(refusal)))
            else:
                desk.send_in_turn(ticket, command, self._link.target, self._link.loop.time())
            self._link.settle()

        self._link.post(send)
        return ticket

    def command_fence(self, areas: Sequence[FenceArea]) -> int:
        """Uploads a fence, reads it back and switches it on; without areas the autopilot's fence is cleared."""
        ticket = self._link.commands.ticket()

        def begin() -> None:
            now_s = self._link.loop.time()
            if self._link.target is None:
                self._link.commands.put(ticket, CommandAnswer(False, "no autopilot heartbeat received"))
            else:
                self._link.fence.begin(ticket, areas, self._link.target, now_s)
                self._link.settle()

        self._link.post(begin)
        return ticket

    @property
    def fence_problem(self) -> str:
        """Reason why the autopilot does not enforce its fence, as far as reported; PX4 does not report it."""
        if self._link.style.fence_on_command is None or self._link.inspection.setup.sensors_enabled & FENCE_BIT:
            return ""
        return (
            "its fence is switched off (SYS_STATUS); FENCE_ACTION must not be 0, FENCE_TYPE must contain 4 (polygons)"
        )

    def command_plan(self, path: GeoPath) -> int:
        """Uploads the plan of a path and reads it back."""
        return self._upload(partial(self._link.plan.begin, path=path))

    def command_file(self, order: FlyFileOrder, *, continue_at: int) -> int:
        """Uploads the items of a plan and reads them back; one that is there already is left as it is.

        Args:
            order: with the items.
            continue_at: the item to continue at, from 1; 0 to begin anew.
        """
        return self._upload(partial(self._link.file.begin, order=order, continue_at=continue_at))

    @property
    def file_progress(self) -> FileProgress:
        """What the autopilot reports of the items uploaded last."""
        return self._link.file.poll()

    def _upload(self, begin_upload: Callable[..., None]) -> int:
        ticket = self._link.commands.ticket()

        def begin() -> None:
            now_s = self._link.loop.time()
            if self._link.target is None:
                self._link.commands.put(ticket, CommandAnswer(False, NO_OWNER))
                return
            try:
                begin_upload(ticket, style=self._link.style.style, target=self._link.target, now_s=now_s)
            except Refused as refusal:
                self._link.commands.put(ticket, CommandAnswer(False, str(refusal)))
            else:
                if self._link.style.style is Style.ARDUPILOT:  # PX4 sends it at its own rate, and refuses others
                    self._link.request_stream(PROGRESS)
                self._link.settle()

        self._link.post(begin)
        return ticket

    @property
    def places_reached(self) -> int:
        """The number of waypoints of the latest path that the autopilot has passed."""
        return self._link.plan.reached

    def answer(self, ticket: int) -> CommandAnswer | None:
        """The answer to a command; None while there is none."""
        return self._link.commands.answer(ticket)

    def abandon_commands(self) -> None:
        """Cancels the commands that are under way."""
        self._link.post(lambda: self._link.commands.abandon("control was taken over"))

    def read_setup(self, number: int) -> None:
        """Reads them again; the end is reported with this number."""
        self._link.post(lambda: self._link.inspection.read(number, self._link.loop.time()))
