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
    far_m: float
    """Side of the box that it goes round."""
    speed_m_s: float
    near_m: float
    """How near to a waypoint counts as having passed it."""
    margin_m: float
    """Room between the box and the mission's fence."""
    wait_m: float
    """How far it may go from where it is told to wait."""
    home: str = "-35.363261,149.165230,584,353"
    preset: str = ""
    """The preset that it needs, since by itself it stops without a station, or ignores its fence."""
    is_winged: bool = False
    """It waits in circles, and goes on to the next waypoint from where it then is."""

    @property
    def name(self) -> str:
        """As a user starts it."""
        return f"{self.binary} --model {self.model}"


COMPASS = "".join(
    f"COMPASS_OFS{n}_{axis} {value}\n" for n in ("", "2", "3") for axis, value in zip("XYZ", (5, 13, -18), strict=True)
)
INERTIAL = "".join(
    f"INS_ACC{n}OFFS_{axis} {0.001}\nINS_ACC{n}SCAL_{axis} {1.001}\n" for n in ("", "2") for axis in "XYZ"
)
BATTERY = "BATT_MONITOR 4\nBATT_CAPACITY 3300\nBATT_LOW_MAH 330\nBATT_FS_LOW_ACT "
"""A tenth is low, as the platform files say; followed by what happens then."""
AIRSPEED = "ARSPD_USE 1\nROLL_LIMIT_DEG 65\nKFF_RDDRMIX 0.5\n"
FIELD = "47.397700,8.545600,488,0"
COPTER = Vehicle(
    "arducopter",
    "quad",
    "copter",
    "take_off: {height_m: 5}",
    5.0,
    f"{COMPASS}{INERTIAL}{BATTERY}2\nFRAME_CLASS 1\n",
    far_m=15.0,
    speed_m_s=2.0,
    near_m=1.0,
    margin_m=5.0,
    wait_m=3.0,
    preset="arducopter_companion",
)
ROVER = Vehicle(
    "ardurover",
    "rover",
    "rover",
    "drive_off: {}",
    0.0,
    f"{COMPASS}{INERTIAL}{BATTERY}2\nATC_SPEED_P 0.1\nATC_STR_RAT_FF 0.75\nCRUISE_SPEED 5\nCRUISE_THROTTLE 30\n"
    "SERVO1_MIN 1000\nSERVO1_MAX 2000\nSERVO3_MIN 1000\nSERVO3_MAX 2000\n",
    far_m=15.0,
    speed_m_s=2.0,
    near_m=2.0,
    margin_m=8.0,
    wait_m=5.0,
)
SUB = Vehicle(
    "ardusub",
    "vectored",
    "submarine",
    "dive: {depth_m: 4}",
    -4.0,
    f"{COMPASS}{INERTIAL}{BATTERY}3\nBARO_EXT_BUS 1\nBTN0_FUNCTION 0\nBTN6_FUNCTION 4\nBTN7_FUNCTION 21\n",
    far_m=6.0,
    speed_m_s=0.5,
    near_m=0.6,
    margin_m=5.0,
    wait_m=1.5,
    home="33.810313,-118.393867,0,185",
    preset="ardusub_companion",
)
PLANE = Vehicle(
    "arduplane",
    "plane",
    "plane",
    "take_off: {height_m: 50}",
    60.0,
    f"{COMPASS}{INERTIAL}{AIRSPEED}{BATTERY}2\nAIRSPEED_MIN 10\nAIRSPEED_MAX 30\nAIRSPEED_CRUISE 22\n"
    "PTCH_LIM_MIN_DEG -20\nPTCH_LIM_MAX_DEG 25\nWP_LOITER_RAD 80\nWP_RADIUS 50\nNAVL1_PERIOD 15\nTRIM_THROTTLE 50\n"
    "RLL_RATE_P 0.3\nRLL_RATE_I 0.25\nRLL_RATE_D 0.017\nRLL_RATE_FF 0.237\n"
    "PTCH_RATE_P 0.15\nPTCH_RATE_I 0.11\nPTCH_RATE_D 0.007\nPTCH_RATE_FF 0.596\nSERVO3_MIN 1000\nSERVO3_MAX 2000\n",
    far_m=400.0,
    speed_m_s=22.0,
    near_m=60.0,
    margin_m=700.0,
    wait_m=300.0,
    home=FIELD,
    preset="arduplane_companion",
    is_winged=True,
)
QUADPLANE = Vehicle(
    "arduplane",
    "quadplane",
    "vtol",
    "take_off: {height_m: 40}",
    50.0,
    f"{COMPASS}{INERTIAL}{AIRSPEED}{BATTERY}1\nQ_ENABLE 1\nQ_MAV_TYPE 22\nAIRSPEED_MIN 13\nAIRSPEED_MAX 35\nAIRSPEED_CRUISE 25\nNAVL1_PERIOD 14\n"
    "PTCH_LIM_MIN_DEG -30\nPTCH_LIM_MAX_DEG 30\nQ_ASSIST_SPEED 18\nSCHED_LOOP_RATE 300\n"
    "RLL_RATE_P 0.141\nRLL_RATE_I 0.2125\nRLL_RATE_FF 0.5527\nPTCH_RATE_P 0.31\nPTCH_RATE_I 0.2125\nPTCH_RATE_FF 1.407\n"
    "Q_A_RAT_RLL_P 0.108\nQ_A_RAT_RLL_I 0.108\nQ_A_RAT_RLL_D 0.001\nQ_A_RAT_PIT_P 0.103\nQ_A_RAT_PIT_I 0.103\n"
    "Q_A_RAT_PIT_D 0.001\nQ_A_RAT_YAW_P 0.2\nQ_A_RAT_YAW_I 0.02\nQ_A_ANG_RLL_P 6\nQ_A_ANG_PIT_P 6\n"
    "SERVO3_MIN 1000\nSERVO3_MAX 2000\n",
    far_m=500.0,
    speed_m_s=25.0,
    near_m=60.0,
    margin_m=500.0,
    wait_m=300.0,
    home=FIELD,
    preset="arduquadplane_companion",
    is_winged=True,
)
VEHICLES = (COPTER, ROVER, SUB, PLANE, QUADPLANE)


class Lines(NamedTuple):
    """URLs of a vehicle's lines."""

    first: str
    """On this one ArduPilot also hears what is not signed."""
    second: str


@contextmanager
def simulated(vehicle: Vehicle, folder: Path, wind_m_s: float = 0.0) -> Iterator[Lines]:
    """The program in a folder of its own, as a user starts it; gives the URLs of its lines.

    Args:
        vehicle: which of them.
        folder: where it works.
        wind_m_s: wind from the north.
    """
    folder.mkdir()
    wind = f"SIM_WIND_SPD {wind_m_s:g}\nSIM_WIND_DIR 0\n" if wind_m_s else ""
    (folder / "defaults.parm").write_text(vehicle.defaults + wind)
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


__all__ = [
    "COPTER", "PLANE", "QUADPLANE", "ROVER", "SUB", "VEHICLES", "Vehicle", "flights", "pictures", "simulated", "station", "until",
]  # fmt: skip
