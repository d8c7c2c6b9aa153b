"""A real ArduPilot with one of its built-in vehicle models, driven through `gloc3 onboard` by stations."""

import asyncio
import secrets
import shutil
import socket
import subprocess
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_groundstation.desk import flights
from gloc3_groundstation.station.station import Station
from gloc3_sitl.demo.demo import free_ports

PICTURES = 200


class Vehicle(NamedTuple):
    """One of ArduPilot's programs, and what is to be known to lead it."""

    binary: str
    model: str
    platform: str
    start: str
    """The action that it sets off with, as YAML."""
    height_m: float
    defaults: str
    """What its own simulation sets up, as a user's set-up would: lines of NAME VALUE."""
    home: str = "-35.363261,149.165230,584,353"
    preset: str = ""
    """The preset that it needs, since by itself it stops without a station."""


COMPASS = "".join(
    f"COMPASS_OFS{n}_{axis} {value}\n" for n in ("", "2", "3") for axis, value in zip("XYZ", (5, 13, -18), strict=True)
)
INERTIAL = "".join(
    f"INS_ACC{n}OFFS_{axis} {0.001}\nINS_ACC{n}SCAL_{axis} {1.001}\n" for n in ("", "2") for axis in "XYZ"
)
COPTER = Vehicle(
    "arducopter",
    "quad",
    "copter",
    "take_off: {height_m: 5}",
    5.0,
    f"{COMPASS}{INERTIAL}FRAME_CLASS 1\nBATT_MONITOR 4\n",
)
ROVER = Vehicle(
    "ardurover",
    "rover",
    "rover",
    "drive_off: {}",
    0.0,
    f"{COMPASS}{INERTIAL}BATT_MONITOR 4\nATC_SPEED_P 0.1\nATC_STR_RAT_FF 0.75\nCRUISE_SPEED 5\nCRUISE_THROTTLE 30\n"
    "SERVO1_MIN 1000\nSERVO1_MAX 2000\nSERVO3_MIN 1000\nSERVO3_MAX 2000\n",
)
SUB = Vehicle(
    "ardusub",
    "vectored",
    "submarine",
    "dive: {depth_m: 4}",
    -4.0,
    f"{COMPASS}{INERTIAL}BATT_MONITOR 4\nBARO_EXT_BUS 1\nBTN0_FUNCTION 0\nBTN6_FUNCTION 4\nBTN7_FUNCTION 21\n",
    home="33.810313,-118.393867,0,185",
    preset="ardusub_companion",
)


class Lines(NamedTuple):
    """URLs of a vehicle's lines."""

    first: str
    """On this one ArduPilot also hears what is not signed."""
    second: str


@contextmanager
def simulated(vehicle: Vehicle, folder: Path) -> Iterator[Lines]:
    """The program in a folder of its own, as a user starts it; gives the URLs of its lines."""
    folder.mkdir()
    (folder / "defaults.parm").write_text(vehicle.defaults)
    (first, second), rc = free_ports(2, socket.SOCK_STREAM), free_ports(1, socket.SOCK_DGRAM)[0]
    program = shutil.which(vehicle.binary)  # it starts itself anew for a reboot, without looking on PATH
    assert program is not None
    command = [program, "--model", vehicle.model, "--home", vehicle.home, "--defaults", "defaults.parm"]
    command += ["--serial0", f"tcp:{first}", "--serial1", f"tcp:{second}", "--serial2", "none:0"]
    command += ["--rc-in-port", str(rc)]
    with (folder / "said.txt").open("wb") as text:
        process = subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=text, stderr=text)
    try:
        time.sleep(1.0)
        assert process.poll() is None, (folder / "said.txt").read_text(errors="replace")
        yield Lines(f"tcpout://127.0.0.1:{first}", f"tcpout://127.0.0.1:{second}")
    finally:
        process.kill()
        process.wait()


def pictures(folder: Path) -> str:
    """A camera that shows something else every second: the URL of its source."""
    folder.mkdir()
    for number in range(PICTURES):
        cv2.imwrite(str(folder / f"{number:05d}.png"), np.full((48, 64), number, np.uint8))
    return f"video://{folder}/%05d.png?rate_hz=1"


@asynccontextmanager
async def station(url: str, system: int) -> AsyncIterator[Station]:
    """A ground station on a link, from a script."""
    ground = GroundStation(StationSetup(boot=secrets.randbits(32), system=system))
    try:
        await ground.open([url])
        yield ground.station
    finally:
        await ground.close()


async def until(is_so: Callable[[], bool], within_s: float, what: str) -> None:
    """Waits until something is so."""
    end_s = time.monotonic() + within_s
    while not is_so():
        assert time.monotonic() < end_s, f"not within {within_s:g} s: {what}"
        await asyncio.sleep(0.05)


__all__ = ["COPTER", "ROVER", "SUB", "Vehicle", "flights", "pictures", "simulated", "station", "until"]
