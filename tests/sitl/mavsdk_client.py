"""An unmodified mavsdk client against `gloc3 sitl` in its own process, over UDP on loopback."""

import ctypes
import queue
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import nan
from pathlib import Path
from typing import Any, TypeVar

from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk, log_subscribe
from mavsdk.cmavsdk_loader import _cmavsdk_lib
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.action import Action
from mavsdk.plugins.log_files import LogFiles
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw
from mavsdk.plugins.offboard import Offboard, OffboardError
from mavsdk.plugins.telemetry import Telemetry

P = TypeVar("P")

log_subscribe(lambda level, text, file, line: True)

PROGRAM = "import sys; from gloc3_sitl.cli.sitl import app; sys.exit(app(sys.argv[1:], result_action='return_value'))"
TIMEOUT_S = 1.0
"""Of each of MAVSDK's four attempts; its own 0.5 s is little where the simulator gets no processor for a second."""
LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 47.3977, 8.5456, 488.0


@contextmanager
def simulated_vehicle(*arguments: str, speed: float = 5.0, link: str = "udpin://127.0.0.1:0") -> Iterator[int]:
    """Runs `gloc3 sitl`; gives the port of its link for ground stations."""
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", PROGRAM, "--world", "open"),
            *("--home", f"{LATITUDE_DEG},{LONGITUDE_DEG},{ALTITUDE_M},0"),
            *("--speed", str(speed), "--link", f"station={link}", *arguments),
        ],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr is not None
        for line in process.stderr:
            found = re.search(r"port (\d+)", line)
            if found:
                yield int(found[1])
                break
        else:
            raise AssertionError("the simulator ended before it opened its link")
    finally:
        process.terminate()
        process.communicate(timeout=60)
        assert process.returncode == 0


class Client:
    """A ground station made of mavsdk's plugins."""

    def __init__(self, port: int) -> None:
        self.mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        set_timeout = _cmavsdk_lib.mavsdk_set_timeout_s
        set_timeout.argtypes = [ctypes.c_void_p, ctypes.c_double]
        set_timeout(self.mavsdk._handle, TIMEOUT_S)
        result = self.mavsdk.add_any_connection(f"udpout://127.0.0.1:{port}")
        assert result == ConnectionResult.SUCCESS
        system = self.mavsdk.first_autopilot(timeout_s=60.0)
        assert system is not None, "mavsdk found no autopilot"
        self.system = system
        self.action = Action(system)
        self.telemetry = Telemetry(system)
        self.mission = MissionRaw(system)
        self._plugins: list[Any] = [self.action, self.telemetry, self.mission]

    def plugin(self, kind: Callable[[Any], P]) -> P:
        """One more plugin, which ends with the client."""
        made = kind(self.system)
        self._plugins.append(made)
        return made

    def close(self) -> None:
        for plugin in self._plugins:
            plugin.destroy()
        self.mavsdk.destroy()

    def await_telemetry(self, kind: str, condition: Callable[[Any], bool], within_s: float = 90.0) -> Any:
        """Waits until a kind of telemetry fulfils a condition; gives that value."""
        arrived: queue.SimpleQueue[Any] = queue.SimpleQueue()
        handle = getattr(self.telemetry, f"subscribe_{kind}")(lambda value, _: arrived.put(value))
        deadline = time.monotonic() + within_s
        value = None
        try:
            while True:
                left = deadline - time.monotonic()
                assert left > 0.0, f"{kind} stayed {value}"
                try:
                    value = arrived.get(timeout=left)
                except queue.Empty:
                    continue
                if condition(value):
                    return value
        finally:
            getattr(self.telemetry, f"unsubscribe_{kind}")(handle)

    def await_armable(self) -> None:
        self.await_telemetry("health", lambda health: bool(health.is_armable and health.is_global_position_ok))

    def await_height(self, least_m: float) -> None:
        self.await_telemetry("position", lambda position: bool(position.relative_altitude_m >= least_m))

    def await_near(self, north_m: float, east_m: float, within_m: float = 0.7) -> None:
        """Waits until the vehicle is over a place, given from home."""

        def is_near(reading: Any) -> bool:
            position = reading.position
            return bool(abs(position.north_m - north_m) < within_m and abs(position.east_m - east_m) < within_m)

        self.await_telemetry("position_velocity_ned", is_near)

    def start_offboard(self, offboard: Offboard) -> None:
        """Enters offboard as soon as the vehicle has seen that setpoints are streamed."""
        for _ in range(50):
            try:
                offboard.start()
            except OffboardError:
                self.await_telemetry("position", lambda _: True)
            else:
                return
        raise AssertionError("offboard was refused again and again")

    def reported(self, begin: Callable[..., Any], *arguments: Any, within_s: float = 90.0) -> list[Any]:
        """Calls what tells its progress; gives everything that it told, the result last."""
        arrived: queue.SimpleQueue[Any] = queue.SimpleQueue()
        begin(*arguments, lambda *values: arrived.put(values))
        rows: list[Any] = []
        while not rows or rows[-1][0].name == "NEXT":
            rows.append(arrived.get(timeout=within_s))
        return rows

    def download(self, logs: LogFiles, entry: Any, path: Path, within_s: float = 90.0) -> None:
        """Fetches a log by the log protocol."""
        reported: queue.SimpleQueue[Any] = queue.SimpleQueue()
        logs.download_log_file_async(entry, str(path), lambda result, progress, _: reported.put(result))
        while (result := reported.get(timeout=within_s)).name == "NEXT":
            pass
        assert result.name == "SUCCESS", result.name

    def await_disarmed(self, within_s: float = 60.0) -> None:
        self.await_telemetry("armed", lambda armed: not armed, within_s)

    def await_mode(self, name: str) -> None:
        self.await_telemetry("flight_mode", lambda mode: bool(mode.name == name))


@contextmanager
def client_at(port: int) -> Iterator[Client]:
    """A client that has found its vehicle."""
    client = Client(port)
    try:
        yield client
    finally:
        client.close()


@contextmanager
def client_of(*arguments: str, speed: float = 5.0) -> Iterator[Client]:
    """A client that has found its simulated vehicle."""
    with simulated_vehicle(*arguments, speed=speed) as port, client_at(port) as client:
        yield client


def outcome(call: Callable[..., Any], *arguments: Any) -> str:
    """Name of the result with which mavsdk answers a call: SUCCESS, or that of the error."""
    try:
        call(*arguments)
    except MavsdkError as error:
        result: Any = vars(error)["result"]
        return str(result.name)
    return "SUCCESS"


def degrees_north(metres: float) -> float:
    return LATITUDE_DEG + metres / 111_180.0


def item(seq: int, command: int, north_m: float = 0.0, height_m: float = 3.0, **fields: Any) -> MissionItem:
    """A mission item over a place north of home."""
    values = {
        "frame": 6,
        "current": 1 if seq == 0 else 0,
        "autocontinue": 1,
        "x": round(degrees_north(north_m) * 1e7),
        "y": round(LONGITUDE_DEG * 1e7),
        "z": height_m,
        "param4": nan,
    }
    return MissionItem(seq=seq, command=command, **{**values, **fields})
