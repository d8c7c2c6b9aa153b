"""The supported firmwares: how each is started, for which vehicle and with which parameters."""

import os
import re
import socket
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Final

import msgspec

from gloc3.errors import Refused, nearest
from gloc3.mavlink.transport.endpoints import parse_url
from gloc3_sitl.firmware import ardupilot, px4
from gloc3_sitl.firmware.hil_server import DEFAULT_PORT as HIL_PORT
from gloc3_sitl.firmware.json_server import DEFAULT_PORT as JSON_PORT
from gloc3_sitl.firmware.program import FirmwareProcess
from gloc3_sitl.world import World

_MOST_LINKS: Final = 3
_INSTANCES: Final = 10


class FirmwareOptionsWanted(msgspec.Struct, frozen=True, kw_only=True):
    """Inputs of a firmware start: world, vehicle, links, parameters."""

    world: World
    vehicle: str
    port: int
    """Where our physics listens."""
    links: Sequence[str]
    """URLs of the MAVLink links to open; empty for the firmware's defaults."""
    speedup: float
    """Times real time that it may run at most."""
    is_without_gps: bool
    parameters: Mapping[str, float]
    """Beside those of the vehicle."""
    folder: Path
    """Where it works."""


class FirmwareStart(msgspec.Struct, frozen=True, kw_only=True):
    """Command line and environment of a firmware."""

    arguments: Sequence[str]
    environment: Mapping[str, str]


class FirmwareKind(msgspec.Struct, frozen=True, kw_only=True):
    """One kind of firmware."""

    title: str
    programs: Mapping[str, Sequence[str]]
    """Program names to find on PATH, by vehicle."""
    port: int
    """Default port of the physics."""
    rate_hz: int
    links: Sequence[str]
    """Default links to open."""
    uses_fixes: bool
    """Whether it uses the simulated satellite receiver rather than its own."""
    start: Callable[[Path, FirmwareOptionsWanted], FirmwareStart]
    problem: Callable[[str], str] = lambda _: ""
    """What its output says went wrong with its parameters, once it flies; empty where nothing did."""
    opens: str = ""
    """Sockets that the program opens to the network by itself, whatever it is asked for."""
    by_hand: str
    """What a person would type, with {port}."""

    def programs_for(self, vehicle: str) -> Sequence[str]:
        """Returns the program names that fly a vehicle.

        Raises:
            Refused: none does, because nobody has tuned its parameters; the message says what flies it.
        """
        if vehicle in self.programs:
            return self.programs[vehicle]
        known = ", ".join(self.programs)
        raise Refused(
            f"{self.title} cannot fly the vehicle {vehicle} here: the order of its actuators and its gains are set up for "
            f"{known} only. Leave out --firmware for the embedded autopilot, or choose one of these vehicles"
        )


def kind_named(name: str) -> FirmwareKind:
    """Returns the firmware of that name.

    Raises:
        Refused: there is none.
    """
    if name not in KINDS:
        raise Refused(f"no firmware {name!r}; {nearest(name, list(KINDS))}")
    return KINDS[name]


def start_program(kind: FirmwareKind, binary: Path, options: FirmwareOptionsWanted) -> FirmwareProcess:
    """Starts a firmware.

    Raises:
        Refused: the system does not run it, or it does not support an option.
    """
    start = kind.start(binary, options)
    program = FirmwareProcess([str(binary), *start.arguments], options.folder, start.environment)
    program.start()
    return program


def _start_ardupilot(_: Path, options: FirmwareOptionsWanted) -> FirmwareStart:
    """A fresh ArduPilot; its parameters go into files, in the order in which they count."""
    names = [f"ardupilot_{options.vehicle}.parm", *(["ardupilot_odometry.parm"] if options.is_without_gps else [])]
    for name in names:
        (options.folder / name).write_text(preset_text(name))
    if options.parameters:
        names.append("given.parm")
        write_parameters(options.folder / "given.parm", options.parameters)
    (options.folder / "eeprom.bin").unlink(missing_ok=True)
    if len(options.links) > _MOST_LINKS:
        raise Refused(f"ArduPilot supports at most {_MOST_LINKS} MAVLink links, not {len(options.links)}")
    lines = [_ardupilot_line(url) for url in options.links]
    lines += ["none:0"] * (_MOST_LINKS - len(lines))
    latitude, longitude, altitude = options.world.home
    return FirmwareStart(
        arguments=[
            *("--model", "JSON:127.0.0.1"),
            *("--sim-port-out", str(options.port)),
            *("--home", f"{latitude:.9f},{longitude:.9f},{altitude:.3f},{options.world.heading_deg:.3f}"),
            *("--rate", str(ardupilot.RATE_HZ)),
            *("--speedup", f"{options.speedup:g}"),
            *("--defaults", ",".join(names)),
            *(word for number, line in enumerate(lines) for word in (f"--serial{number}", line)),
            *("--rc-in-port", str(_free_udp_port())),
        ],
        environment={},
    )


def _ardupilot_line(url: str) -> str:
    """A link in the syntax of ArduPilot's simulation.

    Raises:
        Refused: this kind of link is not supported.
    """
    there = parse_url(url)
    match there.scheme:
        case "udpout":
            return f"udpclient:{socket.gethostbyname(there.host)}:{there.port}"
        case "tcpin":
            return f"tcp:{there.port}"
        case "tcpout":
            return f"tcpclient:{socket.gethostbyname(there.host)}:{there.port}"
        case "serial" if there.baud is not None:
            return f"uart:{there.device}:{there.baud}"
    raise Refused(f"link {url!r}: ArduPilot opens udpout://, tcpin://, tcpout:// and serial:// with a baud rate")


_READING, _READ = "gloc3: parameters", "gloc3: parameters read"


def _start_px4(binary: Path, options: FirmwareOptionsWanted) -> FirmwareStart:
    """A PX4 with its build's root file system, whose start script opens 14550 and 14540, and reads our parameters.

    Every version reads `px4-rc.params`, the first on PATH; parameters in the environment only newer ones. Its speed is ours:
    PX4_SIM_SPEED_FACTOR would only make its failsafes wait longer (COM_OF_LOSS_T and others are multiplied by it).
    """
    if options.links:
        raise Refused("omit --link: PX4 opens 127.0.0.1:14550 for stations and 127.0.0.1:14540 for companions")
    instance = options.port - HIL_PORT
    if not 0 <= instance < _INSTANCES:
        raise Refused(f"PX4 connects to a TCP port from {HIL_PORT} to {HIL_PORT + _INSTANCES - 1}, not {options.port}")
    parameters: dict[str, float] = {}
    for name in (f"px4_{options.vehicle}.params", *(["px4_odometry.params"] if options.is_without_gps else [])):
        parameters |= read_parameters(preset_text(name), name)
    parameters |= options.parameters
    lines = [f"param set {name} {value:.10g}" for name, value in parameters.items()]
    (options.folder / "px4-rc.params").write_text("\n".join([f"echo '{_READING}'", *lines, f"echo '{_READ}'", ""]))
    root = binary.resolve().parent.parent / "etc"
    return FirmwareStart(
        arguments=[
            *("-d", "-i", str(instance), "-w", str(options.folder)),
            *([str(root)] if (root / "init.d-posix" / "rcS").is_file() else []),
        ],
        environment={
            "PATH": os.pathsep.join([str(options.folder), str(binary.resolve().parent), os.environ.get("PATH", "")]),
            "PX4_SIM_MODEL": "none_iris",
            "PX4_SIM_HOST_ADDR": "127.0.0.1",
            "PX4_SIM_SPEED_FACTOR": "1",
        },
    )


def _px4_problem(output: str) -> str:
    ours, read, _ = output.partition(_READING)[2].partition(_READ)
    if not read:
        return "its start script has not read px4-rc.params, so that our parameters did not arrive"
    unknown = re.findall(r"Parameter (\w+) not found", ours)
    return f"it has no parameter {', '.join(unknown)}" if unknown else ""


def _free_udp_port() -> int:
    """For the transmitter that ArduPilot would listen to: two of them must not meet."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))
        return int(opened.getsockname()[1])


KINDS: Final[Mapping[str, FirmwareKind]] = {
    "ardupilot": FirmwareKind(
        title="ArduPilot",
        programs={
            "pelican": ("arducopter",),
            "rover": ("ardurover",),
            "boat": ("ardurover",),
            "rov": ("ardusub",),
        },
        port=JSON_PORT,
        rate_hz=ardupilot.RATE_HZ,
        links=("udpout://127.0.0.1:14550", "udpout://127.0.0.1:14540"),
        uses_fixes=False,
        opens="listens on two UDP ports, and on TCP for tcpin://, on every address of this computer",
        start=_start_ardupilot,
        by_hand="arducopter --model JSON:127.0.0.1 --sim-port-out {port} --rate 800",
    ),
    "px4": FirmwareKind(
        title="PX4",
        programs={"pelican": ("px4",)},
        port=HIL_PORT,
        rate_hz=px4.RATE_HZ,
        links=(),
        uses_fixes=True,
        opens="listens on UDP ports 13030, 14280, 14580 and 18570 on every address of this computer",
        start=_start_px4,
        problem=_px4_problem,
        by_hand="PX4_SIM_MODEL=none_iris px4, which connects to TCP port {port}",
    ),
}
"""By name."""


_FOLDER = "presets"


def preset_text(name: str) -> str:
    """Returns the text of a parameter preset.

    Raises:
        Refused: there is none.
    """
    file = files("gloc3_sitl.firmware") / _FOLDER / name
    if not file.is_file():
        raise Refused(f"no parameter file {name} for this vehicle")
    return file.read_text()


def read_parameters(text: str, name: str = "") -> dict[str, float]:
    """Reads lines of NAME VALUE, or NAME,VALUE; # starts a comment.

    Raises:
        Refused: a line has another form; the message gives its number.
    """
    found: dict[str, float] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            key, value = words
            found[key] = float(value)
        except ValueError:
            raise Refused(f"{name}:{number}: {line.strip()!r} is not NAME VALUE") from None
    return found


def write_parameters(file: Path, parameters: Mapping[str, float]) -> None:
    """Writes lines of NAME VALUE."""
    file.write_text("".join(f"{name} {value:.10g}\n" for name, value in parameters.items()))
