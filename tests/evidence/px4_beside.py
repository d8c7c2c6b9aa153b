"""MAVSDK as another station of a real PX4, on a link of the onboard process: what it is told, word for word."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mavsdk.plugins.ftp import Ftp
from mavsdk.plugins.geofence import Geofence
from mavsdk.plugins.log_files import LogFiles
from mavsdk.plugins.param import Param
from tests.onboard.real_px4 import RealPx4
from tests.sitl.mavsdk_client import Client, client_at

EARTH_M = 6371000.0
ULOG = b"ULog\x01\x12\x35"
WITHIN_S = 120.0


class Other:
    """Its services, each as a sentence."""

    def __init__(self, client: Client, folder: Path) -> None:
        self._client, self._folder = client, folder

    def go_to(self, north_m: float, east_m: float) -> None:
        """Sends it to a place from where it is, at its height, in PX4's own Hold."""
        position = self._client.await_telemetry("position", lambda _: True)
        latitude_deg = position.latitude_deg + math.degrees(north_m / EARTH_M)
        longitude_deg = position.longitude_deg + math.degrees(
            east_m / EARTH_M / math.cos(math.radians(position.latitude_deg))
        )
        self._client.action.goto_location(latitude_deg, longitude_deg, position.absolute_altitude_m, math.nan)

    def clear_fence(self) -> None:
        """Removes the fence that PX4 holds."""
        self._client.plugin(Geofence).clear_geofence()

    def height(self) -> str:
        """Telemetry."""
        position = self._client.await_telemetry("position", lambda at: bool(at.relative_altitude_m > 1.0))
        return f"telemetry: {position.relative_altitude_m:.1f} m above home"

    def parameter(self, name: str, value: float) -> str:
        """Reads one, sets it, and reads it again."""
        parameters = self._client.plugin(Param)
        before = parameters.get_param_float(name)
        parameters.set_param_float(name, value)
        assert parameters.get_param_float(name) == value
        return f"{name} {before:g} set to {value:g} and read again"

    def file(self, name: str) -> str:
        """Downloads a file by MAVLink FTP."""
        rows = self._client.reported(self._client.plugin(Ftp).download_async, name, str(self._folder), False)
        assert rows[-1][0].name == "SUCCESS", rows[-1][0].name
        return f"{name}: {(self._folder / Path(name).name).stat().st_size} bytes"

    def ulog(self, to: Path) -> str:
        """Downloads the newest log."""
        logs = self._client.plugin(LogFiles)
        newest = max(logs.get_entries(), key=lambda entry: entry.id)
        self._client.download(logs, newest, to, WITHIN_S)
        assert to.stat().st_size == newest.size_bytes
        assert to.read_bytes().startswith(ULOG)
        return f"ULog of {newest.size_bytes} bytes"


@contextmanager
def beside(px4: RealPx4) -> Iterator[Other]:
    """MAVSDK on the link for other stations."""
    with client_at(px4.station_port + 50) as client:
        yield Other(client, px4.folder)
