"""`gloc3 sitl` and `gloc3 onboard` as programs of their own, with a link for another program's ground station."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from tests.commands.programs import Program, program

from gloc3_sitl.demo.demo import free_ports

LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 39.5528, 2.6285, 2.0


class Scene(NamedTuple):
    """What runs."""

    port: int
    """Of the onboard process's link to ground stations, on loopback."""
    onboard: Program
    out: Path
    """Where it writes."""


@contextmanager
def vehicle(
    folder: Path,
    *arguments: str,
    style: str = "px4",
    simulator: tuple[str, ...] = (),
    platform: str = "pelican_rtk",
) -> Iterator[Scene]:
    """A simulated vehicle with an onboard computer, on open ground.

    Args:
        folder: of the run.
        arguments: more for the onboard process.
        style: of the autopilot.
        simulator: more arguments for the simulator.
        platform: of the onboard process.
    """
    companion, station = free_ports(2, socket.SOCK_DGRAM)
    home = f"{LATITUDE_DEG},{LONGITUDE_DEG},{ALTITUDE_M},0"
    simulate = ("--world", "open", "--home", home, "--autopilot", style, *simulator)
    links = ("--autopilot", f"udpin://127.0.0.1:{companion}", "--station", f"udpin://127.0.0.1:{station}")
    with ExitStack() as stack:
        sitl = stack.enter_context(
            program("sitl", *simulate, "--link", f"companion=udpout://127.0.0.1:{companion}", folder=folder)
        )
        sitl.await_line(lambda line: "companion link" in line)
        onboard = stack.enter_context(program("onboard", platform, *links, "--out", "out", *arguments, folder=folder))
        onboard.await_line(lambda line: "components; log in" in line)
        yield Scene(station, onboard, folder / "out")
        for each in (onboard, sitl):
            each.interrupt()
        assert onboard.end() == 0, onboard.text
