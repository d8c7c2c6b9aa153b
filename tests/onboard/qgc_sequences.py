"""What QGroundControl sends when it meets a vehicle, and when its user uploads a plan, in its order and with its patience.

From its public sources: InitialConnectStateMachine (version, standard modes, component information, parameters, mission,
geofence, rally points), RequestMetaDataTypeStateMachine, ParameterManager, PlanManager and GCSControlManager. Bytes are
made and read by pymavlink, not by us.
"""

import math
import socket
import struct
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

SYSTEM, COMPONENT = 255, 190
AUTOPILOT, COMPANION, ALL = 1, 191, 0
ACK_TIMEOUT_S = 1.5
"""Of PlanManager; a command is waited for twice as long."""
ATTEMPTS = 10
"""It asks again when nothing has come; here nothing is lost, and a machine that is busy is waited for as long."""
REQUEST_MESSAGE, REQUEST_OPERATOR_CONTROL = 512, 32100
AVAILABLE_MODES, COMPONENT_METADATA, COMPONENT_INFORMATION, AUTOPILOT_VERSION = 435, 397, 395, 148


class Station:
    """One end of a UDP link that speaks as QGroundControl does."""

    def __init__(self, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._socket.settimeout(0.05)
        self._codec = mavlink.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        self._codec.robust_parsing = True
        self._beat_s = 0.0
        self._waiting: deque[Any] = deque()
        self.texts: list[str] = []

    def close(self) -> None:
        self._socket.close()

    def send(self, message: Any) -> None:
        self._socket.send(message.pack(self._codec))

    def receive(self, is_it: Callable[[Any], bool], within_s: float, what: str) -> Any:
        """The next message that fits; fails when none comes in time."""
        until_s = time.monotonic() + ATTEMPTS * within_s
        while (now_s := time.monotonic()) < until_s:
            while self._waiting:
                message = self._waiting.popleft()
                if is_it(message):
                    return message
            if now_s >= self._beat_s:
                self._beat_s = now_s + 1.0
                self.send(mavlink.MAVLink_heartbeat_message(6, 8, 192, 0, 4, 3))
            try:
                self._waiting.extend(self._codec.parse_buffer(self._socket.recv(65_535)) or ())
            except (TimeoutError, ConnectionRefusedError):
                continue
            self.texts += [message.text for message in self._waiting if message.get_type() == "STATUSTEXT"]
        raise AssertionError(f"{what} has not come within {within_s:g} s; texts: {self.texts[-5:]}")

    def kind(self, name: str, component: int | None = None, **fields: Any) -> Callable[[Any], bool]:
        """Whether a message has this name, comes from there, and has these fields."""

        def is_it(message: Any) -> bool:
            if message.get_type() != name or (component is not None and message.get_srcComponent() != component):
                return False
            return all(getattr(message, field) == value for field, value in fields.items())

        return is_it

    def command(self, component: int, number: int, *params: float) -> int:
        """Sends a command once; its result."""
        values = [*params, *[0.0] * (7 - len(params))]
        self.send(mavlink.MAVLink_command_long_message(1, component, number, 0, *values))
        while True:
            ack = self.receive(
                self.kind("COMMAND_ACK", component, command=number), 2 * ACK_TIMEOUT_S, f"ack of {number}"
            )
            if ack.result != mavlink.MAV_RESULT_IN_PROGRESS:
                return int(ack.result)

    def request(self, component: int, number: int, name: str, index: float = 0.0) -> Any:
        """Has a message sent; None where that is refused. It may come before its acknowledgement."""
        self.send(mavlink.MAVLink_command_long_message(1, component, REQUEST_MESSAGE, 0, number, index, 0, 0, 0, 0, 0))
        sender = None if name.startswith("UNKNOWN") else component  # pymavlink does not tell whose an unknown one is
        found, result = None, None
        while result is None or (result == 0 and found is None):
            message = self.receive(
                lambda one: (
                    self.kind(name, sender)(one) or self.kind("COMMAND_ACK", component, command=REQUEST_MESSAGE)(one)
                ),
                2 * ACK_TIMEOUT_S,
                name,
            )
            if message.get_type() == name:
                found = message
            else:
                result = message.result
        return found if result == 0 else None

    def parameters(self) -> dict[int, dict[str, float]]:
        """The list of all components, by component; those that were lost are asked for by their index."""
        self.send(mavlink.MAVLink_param_request_list_message(1, ALL))
        found: dict[int, dict[int, tuple[str, float]]] = {}
        counts: dict[int, int] = {}
        while True:
            try:
                reported = self.receive(self.kind("PARAM_VALUE"), 1.5, "a parameter")
            except AssertionError:
                missing = [(c, i) for c, count in counts.items() for i in range(count) if i not in found[c]]
                if not missing:
                    return {component: dict(rows.values()) for component, rows in found.items()}
                for component, index in missing[:10]:
                    self.send(mavlink.MAVLink_param_request_read_message(1, component, b"", index))
                continue
            component = reported.get_srcComponent()
            counts[component] = reported.param_count
            found.setdefault(component, {})[reported.param_index] = (reported.param_id, reported.param_value)

    def read_plan(self, component: int, kind: int) -> list[Any]:
        """Reads a plan as PlanManager does."""
        self.send(mavlink.MAVLink_mission_request_list_message(1, component, kind))
        count = self.receive(self.kind("MISSION_COUNT", mission_type=kind), ACK_TIMEOUT_S, f"count of {kind}").count
        items = []
        for number in range(count):
            self.send(mavlink.MAVLink_mission_request_int_message(1, component, number, kind))
            items.append(
                self.receive(self.kind("MISSION_ITEM_INT", mission_type=kind), ACK_TIMEOUT_S, f"item {number}")
            )
        self.send(mavlink.MAVLink_mission_ack_message(1, component, 0, kind))
        return items

    def write_plan(self, component: int, kind: int, items: list[tuple[Any, ...]]) -> int:
        """Writes a plan as PlanManager does: no answer for 1.5 s at the end is a failure."""
        self.send(mavlink.MAVLink_mission_count_message(1, component, len(items), kind))
        while True:
            requested = self.receive(
                lambda one: (
                    one.get_type() in ("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")
                    and one.mission_type == kind
                ),
                ACK_TIMEOUT_S,
                "a request, or the acknowledgement",
            )
            if requested.get_type() == "MISSION_ACK":
                return int(requested.type)
            command, frame, params, x, y, z = items[requested.seq]
            self.send(
                mavlink.MAVLink_mission_item_int_message(
                    1, component, requested.seq, frame, command, int(requested.seq == 0), 1, *params, x, y, z, kind
                )
            )

    def has_file(self, component: int, path: str) -> bool:
        """Opens a file over MAVLink FTP."""
        data = path.encode()
        payload = struct.pack("<HBBBBBxI", 1, 0, 4, len(data), 0, 0, 0) + data
        self.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, component, payload.ljust(251, b"\0")))
        answer = self.receive(self.kind("FILE_TRANSFER_PROTOCOL", component), 2 * ACK_TIMEOUT_S, path)
        return int(answer.payload[3]) == 128

    def connect(self) -> dict[int, dict[str, float]]:
        """The whole of the initial connect; gives the parameters."""
        self.receive(self.kind("HEARTBEAT", AUTOPILOT), 10.0, "a heartbeat")
        version = self.request(AUTOPILOT, AUTOPILOT_VERSION, "AUTOPILOT_VERSION")
        assert version is not None
        self.request(AUTOPILOT, AVAILABLE_MODES, f"UNKNOWN_{AVAILABLE_MODES}", 1.0)
        if self.request(AUTOPILOT, COMPONENT_METADATA, f"UNKNOWN_{COMPONENT_METADATA}") is None:
            self.request(AUTOPILOT, COMPONENT_INFORMATION, f"UNKNOWN_{COMPONENT_INFORMATION}")
        if version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_FTP:
            self.has_file(AUTOPILOT, "@PARAM/param.pck")
        found = self.parameters()
        kinds = [0]
        kinds += [1] if version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE else []
        kinds += [2] if version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY else []
        for kind in kinds:
            self.read_plan(AUTOPILOT, kind)
        return found


def waypoint(command: int, latitude_deg: float, longitude_deg: float, height_m: float) -> tuple[Any, ...]:
    """A simple item as QGroundControl makes it: relative height, no yaw."""
    params = (0.0, 0.0, 0.0, math.nan)
    return (command, 3, params, round(latitude_deg * 1e7), round(longitude_deg * 1e7), height_m)
