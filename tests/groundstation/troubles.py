"""What goes wrong around a station, and what it shows then: for the tests, and for the page of evidence."""

import asyncio
import tempfile
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import NamedTuple

from gloc3.errors import Gloc3Error
from gloc3.mavlink.signing_key import read_signing_key
from gloc3_groundstation.services.parameter_files import load_parameter_file
from gloc3_groundstation.station import alerts
from gloc3_groundstation.station.alerts import Alerts
from gloc3_groundstation.store.configuration import ConfigurationFile
from gloc3_groundstation.tui.screens.mission import MissionScreen

from .scripted_platform import ScriptedPlatform
from .station_scene import LINKS, Scene, ScriptedLinks, scene
from .vehicles_scene import PX4, SMARTAP, Autopilot, over
from .vehicles_scene import Scene as Links


class TunnelTrouble(NamedTuple):
    """One thing that goes wrong."""

    what: str
    show: Callable[[], Awaitable[str]]
    """Has it happen; gives what the operator reads then."""
    matter: str
    """Must be read there: what is the matter."""
    advice: str
    """Must be read there: what to do."""


def one_line(text: str) -> str:
    return " ".join(text.split())


# --- the terminal ---


async def small_terminal() -> str:
    async with scene(None, size=(60, 20)) as here:
        here.platform.speak()
        await here.until("too_small", "characters")
        return here.shown("too_small")


# --- vehicles and links ---


async def silent(*, is_armed: bool) -> str:
    async with scene(None, size=(120, 40)) as here:
        here.platform.fly(is_armed=is_armed)
        here.platform.speak()
        await here.until("title", "heron")
        return await alerts_after(here, 12.0)


async def restarted_companion() -> str:
    async with scene(None, size=(120, 40)) as here:
        here.platform.speak()
        await here.until("title", "heron")
        ScriptedPlatform(here.exchange, boot=8).speak()
        return await alerts_after(here, 0.0)


async def two_of_one_name() -> str:
    async with scene(None, size=(120, 40)) as here:
        other = ScriptedPlatform(here.exchange, boot=8)
        for _ in range(3):
            here.platform.speak()
            other.speak()
        return await alerts_after(here, 0.0)


async def alerts_after(here: Scene, seconds: float) -> str:
    now_s = here.station.now_s() + seconds
    here.station.now_s = lambda: now_s  # type: ignore[misc]
    await here.until("alerts", "▲")
    return here.shown("alerts")


async def link_that_is_not_open() -> str:
    async with scene(None, size=(120, 40), links=ScriptedLinks(*LINKS)) as here:
        here.platform.speak()
        await here.go("0")
        await here.until("links", "refused")
        return here.shown("links")


async def on_links(play: Callable[[Links], Awaitable[None]]) -> str:
    """What the alerts say after something on the links, in virtual time on a thread of its own."""

    async def reported(links: Links) -> str:
        await play(links)
        found = alerts.update(Alerts(), links.station.fleet, links.station.now_s())
        return "\n".join(dict.fromkeys(f"{alert.severity.name.lower()} {alert.text}" for alert in found.pending))

    return await asyncio.to_thread(over, reported)


async def restarted_autopilot() -> str:
    async def play(links: Links) -> None:
        autopilot = Autopilot(links.memories[0], PX4)
        await links.pass_s(20.0)
        autopilot.booted_s = asyncio.get_running_loop().time()
        await links.pass_s(6.0)

    return await on_links(play)


async def two_of_one_id(*, is_on_one_link: bool) -> str:
    async def play(links: Links) -> None:
        Autopilot(links.memories[0], PX4)
        await links.pass_s(7.5)
        Autopilot(links.memories[0 if is_on_one_link else 1], PX4)
        await links.pass_s(5.0)

    return await on_links(play)


async def unknown_autopilot() -> str:
    async def play(links: Links) -> None:
        Autopilot(links.memories[0], SMARTAP)
        await links.pass_s(5.0)

    return await on_links(play)


# --- files ---


async def opened(name: str, data: bytes) -> str:
    """What the mission screen shows of a file."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_bytes(data)
        async with scene(None, size=(120, 40), opens=str(file)) as here:
            await here.wait(lambda: isinstance(here.app.base, MissionScreen) and here.app.base.has_class("-text"))
            await here.until("findings", "✗")
            return here.shown("findings")


async def refused(read: Callable[[Path], object], text: str) -> str:
    """What is said of a file that is read at the start."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "file"
        file.write_text(text)
        file.chmod(0o600)
        try:
            read(file)
        except Gloc3Error as error:
            return str(error).replace(str(file), "FILE")
    return "nothing"


PLAN = b'{"fileType": "Plan", "mission": {"items": ['
PICTURE = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + bytes(range(256))
MISSION = b"mission: x\nframe: hold\ntasks:\n  a:\n    actions:\n      up: {take_off: {hieght_m: 2}}\n"

TROUBLES = (
    TunnelTrouble("the terminal is too small", small_terminal, "has 60 × 20 characters", "enlarge it"),
    TunnelTrouble(
        "a vehicle falls silent in flight", lambda: silent(is_armed=True), "it was armed", "check radio, antenna"
    ),
    TunnelTrouble(
        "a vehicle falls silent on the ground",
        lambda: silent(is_armed=False),
        "no messages from it",
        "is it switched on",
    ),
    TunnelTrouble(
        "a link cannot be opened",
        link_that_is_not_open,
        "connection refused",
        "is the program at the other end running",
    ),
    TunnelTrouble("the onboard process restarts", restarted_companion, "has restarted", "look at mission and checks"),
    TunnelTrouble("an autopilot restarts", restarted_autopilot, "has restarted", "check them and its plan"),
    TunnelTrouble(
        "two vehicles with one system id on one link",
        lambda: two_of_one_id(is_on_one_link=True),
        "two vehicles share system id 1",
        "give one of them another id",
    ),
    TunnelTrouble(
        "two vehicles with one system id on two links",
        lambda: two_of_one_id(is_on_one_link=False),
        "the same system id 1",
        "give one of them another id",
    ),
    TunnelTrouble("two platforms of one name", two_of_one_name, "two platforms have this name", "give it another name"),
    TunnelTrouble(
        "an autopilot that nobody knows", unknown_autopilot, "unknown autopilot (smartap)", "use its own ground station"
    ),
    TunnelTrouble(
        "a mission with a misspelt word", lambda: opened("m.yaml", MISSION), "'hieght_m'", "did you mean 'height_m'?"
    ),
    TunnelTrouble("a plan that ends in the middle", lambda: opened("m.plan", PLAN), "not JSON", "save it again"),
    TunnelTrouble(
        "a picture in place of a mission", lambda: opened("m.yaml", PICTURE), "not UTF-8 text", "save the file as UTF-8"
    ),
    TunnelTrouble(
        "a configuration file with a misspelt word",
        lambda: refused(lambda file: ConfigurationFile(file).read(), 'theme = "dark"\nlink = []\n'),
        "FILE:2:1: unknown setting 'link'",
        "did you mean 'links'?",
    ),
    TunnelTrouble(
        "a parameter file that is none",
        lambda: refused(load_parameter_file, "hello\nworld\n"),
        "is not understood",
        "a name and a value",
    ),
    TunnelTrouble(
        "a signing key that is none", lambda: refused(read_signing_key, "xyz\n"), "64 hexadecimal digits", "openssl"
    ),
)
