"""A client that speaks as dronekit does, made of pymavlink: attributes that follow the messages, and calls that wait."""

import time
from collections.abc import Callable
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect
from tests.sitl.mavsdk_client import LONGITUDE_DEG, degrees_north

GUIDED, ACCEPTED = 4, 0


class Vehicle:
    """What dronekit makes of a link: attributes that follow the messages, and calls that wait."""

    def __init__(self, port: int, timeout_s: float = 20.0) -> None:
        self.master: Any = mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}", source_system=255, autoreconnect=False)
        self.timeout_s = timeout_s
        self.received: dict[str, Any] = {}
        self.listeners: list[tuple[str, Callable[[Any], None]]] = []
        self.parameters: dict[str, float] = {}

    def close(self) -> None:
        self.master.close()

    def wait(self, is_so: Callable[[], bool], within_s: float | None = None) -> None:
        """Hears messages until something is so."""
        deadline = time.monotonic() + (within_s or self.timeout_s)
        beat_s = 0.0
        while not is_so():
            assert time.monotonic() < deadline
            if time.monotonic() > beat_s:
                beat_s = time.monotonic() + 0.5
                self.master.mav.heartbeat_send(dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, 0)
            message = self.master.recv_match(blocking=True, timeout=0.1)
            if message is None or message.get_srcComponent() != 1:
                continue
            name = message.get_type()
            self.received[name] = message
            if name == "PARAM_VALUE":
                self.parameters[message.param_id] = message.param_value
            for wanted, listener in self.listeners:
                if wanted in (name, "*"):
                    listener(message)

    def await_message(self, name: str, fits: Callable[[Any], bool] = lambda _: True) -> Any:
        """The next message of a name that fits."""
        self.received.pop(name, None)
        self.wait(lambda: name in self.received and fits(self.received[name]))
        return self.received[name]

    def connect(self) -> None:
        """As `wait_ready`: heartbeat, all streams at 4 Hz, all parameters, a fix."""
        self.await_message("HEARTBEAT")
        self.master.target_system, self.master.target_component = 1, 1
        self.master.mav.request_data_stream_send(1, 1, 0, 4, 1)
        self.master.mav.param_request_list_send(1, 1)
        self.wait(
            lambda: "PARAM_VALUE" in self.received and len(self.parameters) >= self.received["PARAM_VALUE"].param_count
        )
        self.await_message("GPS_RAW_INT", lambda fix: fix.fix_type >= 3)

    @property
    def mode(self) -> int:
        return int(self.received["HEARTBEAT"].custom_mode)

    @property
    def is_armed(self) -> bool:
        return bool(self.received["HEARTBEAT"].base_mode & 128)

    def set_mode(self, mode: int) -> None:
        """SET_MODE, as `vehicle.mode = ...`."""
        self.master.mav.set_mode_send(1, 1, mode)
        self.wait(lambda: self.mode == mode)

    def command(self, number: int, *params: float) -> int:
        """Sends a COMMAND_LONG; its result, the last one where it takes long."""
        self.master.mav.command_long_send(1, 1, number, 0, *params, *(0.0,) * (7 - len(params)))
        return int(self.await_message("COMMAND_ACK", lambda ack: ack.command == number and ack.result != 5).result)

    def await_armable(self) -> None:
        """Pre-arm checks passed, as the bit in SYS_STATUS says."""
        self.await_message("SYS_STATUS", lambda status: status.onboard_control_sensors_health & 0x10000000)

    def arm_and_take_off(self, height_m: float) -> None:
        self.await_armable()
        self.set_mode(GUIDED)
        assert self.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1) == ACCEPTED
        self.wait(lambda: self.is_armed)
        assert self.command(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == ACCEPTED
        self.await_message("GLOBAL_POSITION_INT", lambda place: place.relative_alt >= 950 * height_m)

    def simple_goto(self, north_m: float, height_m: float) -> None:
        """dronekit's way: a mission item that is marked as one to go to now."""
        place = (degrees_north(north_m), LONGITUDE_DEG, height_m)
        self.master.mav.mission_item_send(1, 1, 0, 3, dialect.MAV_CMD_NAV_WAYPOINT, 2, 0, 0, 0, 0, 0, *place)

    def upload(self, *rows: tuple[int, float, float]) -> None:
        """As `commands.upload()`: MISSION_COUNT, then a MISSION_ITEM of floats for each MISSION_REQUEST."""
        items = [(dialect.MAV_CMD_NAV_WAYPOINT, 0.0, 0.0), *rows]
        self.received.pop("MISSION_ACK", None)
        self.master.mav.mission_count_send(1, 1, len(items))
        requested = [-1]

        def answer(request: Any) -> None:
            requested[0] = request.seq
            command, north_m, height_m = items[request.seq]
            place = (degrees_north(north_m), LONGITUDE_DEG, height_m)
            self.master.mav.mission_item_send(1, 1, request.seq, 3, command, 0, 1, 0, 0, 0, 0, *place)

        self.listeners.append(("MISSION_REQUEST", answer))
        try:
            self.wait(lambda: "MISSION_ACK" in self.received)
        finally:
            self.listeners.pop()
        assert self.received["MISSION_ACK"].type == 0
        assert requested[0] == len(items) - 1

    def download(self) -> list[Any]:
        """As `commands.download()`: MISSION_REQUEST for each item, answered by a MISSION_ITEM of floats."""
        self.master.mav.mission_request_list_send(1, 1)
        count = self.await_message("MISSION_COUNT").count
        items = []
        for number in range(count):
            self.master.mav.mission_request_send(1, 1, number)
            items.append(self.await_message("MISSION_ITEM"))
            assert items[-1].seq == number
        self.master.mav.mission_ack_send(1, 1, 0)
        return items
