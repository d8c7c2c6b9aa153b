"""The command `gloc3 signing`: makes keys of signed MAVLink links, and sets them on an autopilot."""

import asyncio
import ipaddress
import os
import secrets
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Annotated, Final

from cyclopts import App, Parameter

from gloc3.cli.narration import narrate
from gloc3.clock import Clock
from gloc3.errors import NoContact, Refused
from gloc3.mavlink.signing import KEY_BYTES, timestamp
from gloc3.mavlink.signing_key import read_signing_key
from gloc3.mavlink.transport.endpoints import SERIAL_SCHEMES, open_endpoint, parse_url
from gloc3_onboard.autopilot.signing_setup import Setup, Signs

LISTEN_S: Final = 5.0
"""So long an autopilot is waited for, which sends a heartbeat each second."""
COUNT_S: Final = 1.5
FAILED: Final = 1

app = App(
    name="gloc3 signing",
    help="""Make the key of signed MAVLink links, and give it to an autopilot, which then drops what is not signed with it.

    For example, with the autopilot on a cable, and the same file on every computer that connects to it:

    - `gloc3 signing new radio.key`
    - `gloc3 signing set --autopilot serial:///dev/ttyACM0:115200 --key radio.key`
    - `gloc3 onboard my.yaml --autopilot 'serial:///dev/ttyAMA0:921600?key=radio.key' --signing-key radio.key`
    - `gloc3 station --signing-key radio.key`

    Exit codes: 0 done; 1 the autopilot did not accept it; 2 wrong use; 130 interrupted.""",
    help_format="markdown",
    version_flags=[],
)

Autopilot = Annotated[str, Parameter(help="Link to the autopilot, as for `gloc3 onboard`.")]
Key = Annotated[Path, Parameter(help="File with the key, readable by its owner only.")]
Yes = Annotated[bool, Parameter(negative=(), help="Do it without asking.")]
OverNetwork = Annotated[bool, Parameter(negative=(), help="Send the key over a network, where others can read it.")]


@app.command
def new(file: Path, /) -> int:
    """Make a key: 32 random bytes, in a file that nobody else may read.

    Args:
        file: The file to write; an existing file is kept.
    """
    try:
        number = os.open(file.expanduser(), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise Refused(f"{file} is there already; a key that is in use is not overwritten") from None
    with os.fdopen(number, "w") as out:
        out.write(f"{secrets.token_hex(KEY_BYTES)}\n")
    narrate(f"{file} has a new key; every computer that connects to the vehicle needs a copy of it")
    return 0


@app.command
def show(*, autopilot: Autopilot, key: Key) -> int:
    """Show how an autopilot signs what it sends; nothing is changed."""
    return asyncio.run(_show(autopilot, read_signing_key(key.expanduser())))


@app.command(name="set")
def set_(
    *,
    autopilot: Autopilot,
    key: Key,
    present_key: Annotated[Path | None, Parameter(help="The file with the key that it has now, if it has one.")] = None,
    yes: Yes = False,
    over_network: OverNetwork = False,
) -> int:
    """Set the key of an autopilot, and check that it signs; shows what will happen, and asks first."""
    _refuse_detour(autopilot, over_network)
    present = None if present_key is None else read_signing_key(present_key.expanduser())
    return asyncio.run(_set(autopilot, key, read_signing_key(key.expanduser()), present, is_requested=not yes))


@app.command
def remove(*, autopilot: Autopilot, key: Key, yes: Yes = False) -> int:
    """Remove the key of an autopilot, so that it accepts unsigned frames again."""
    return asyncio.run(_remove(autopilot, read_signing_key(key.expanduser()), is_requested=not yes))


def _refuse_detour(url: str, is_allowed: bool) -> None:
    """A key is sent over a cable, or within this computer."""
    wanted = parse_url(url)
    if is_allowed or wanted.scheme in SERIAL_SCHEMES or wanted.host == "localhost":
        return
    try:
        is_here = ipaddress.ip_address(wanted.host).is_loopback
    except ValueError:
        is_here = False
    if not is_here:
        raise Refused(
            f"{url} is a network, over which the key would go unencrypted; connect the autopilot by cable, as "
            "serial:///dev/ttyACM0:115200, or add --over-network if nobody else can listen there"
        )


def _confirmed(question: str) -> None:
    """Asks for confirmation.

    Raises:
        Refused: not confirmed, or not interactive.
    """
    if not sys.stdin.isatty():
        raise Refused("there is no terminal to ask on; add --yes to do it without asking")
    narrate(question)
    if input("type yes to continue: ").strip().lower() != "yes":
        raise Refused("nothing was sent")


@asynccontextmanager
async def _received(url: str, key: bytes, present: bytes | None) -> AsyncIterator[Setup]:
    """The autopilot behind a link, once heard, and its signing.

    Raises:
        NoContact: no autopilot responds.
    """
    loop = asyncio.get_running_loop()
    made: list[Setup] = []
    endpoint = await open_endpoint(url, loop, lambda data: made[0].receive(data) if made else None)
    try:
        setup = Setup(endpoint, key, present, timestamp(Clock(loop).utc_s()))
        made.append(setup)
        for _ in range(round(LISTEN_S / COUNT_S)):
            await setup.listen(COUNT_S)
            if setup.signs.total() > 1:
                break
        if setup.autopilot is None:
            why = endpoint.problem if not endpoint.is_connected and endpoint.problem else "no heartbeat received"
            raise NoContact(f"{url}: no autopilot responds: {why}")
        yield setup
    finally:
        await endpoint.close()


def _who(setup: Setup) -> str:
    assert setup.autopilot is not None
    return f"{setup.family} {setup.autopilot.system}/{setup.autopilot.component}"


def _how(setup: Setup) -> str:
    """Description of the signing of received frames."""
    return ", ".join(f"{count} {signs}" for signs, count in setup.signs.most_common()) or "nothing more was received"


async def _show(url: str, key: bytes) -> int:
    async with _received(url, key, None) as setup:
        narrate(f"{_who(setup)}: of its frames {_how(setup)}")
        return 0 if setup.signs[Signs.OURS] == setup.signs.total() else FAILED


async def _set(url: str, file: Path, key: bytes, present: bytes | None, *, is_requested: bool) -> int:
    async with _received(url, key, present) as setup:
        narrate(f"{_who(setup)} at {url}: of its frames {_how(setup)}")
        if setup.is_armed:
            raise Refused("it is armed; disarm it to set a key")
        if setup.signs[Signs.OTHER] and not setup.signs[Signs.PRESENT]:
            narrate("it has another key, and may accept a new one only if it is signed with that; see --present-key")
        narrate(f"it is sent the key of {file} (SETUP_SIGNING), unencrypted, over {url} alone")
        narrate(
            "it then signs all that it sends, and drops what is not signed with this key; ArduPilot: not on its USB port"
        )
        if is_requested:
            _confirmed(f"keep {file}: without it only the autopilot's own means restore access")
        if setup.signs[Signs.PRESENT]:
            setup.sign_with(Signs.PRESENT)
        setup.give()
        setup.sign_with(Signs.OURS)
        setup.reset()
        await setup.listen(LISTEN_S, until=Signs.OURS)
        setup.reset()
        await setup.listen(COUNT_S)
        narrate(f"{_who(setup)} now: of its frames {_how(setup)}")
        if setup.signs[Signs.OURS]:
            return 0
        narrate("it has not accepted the key: this firmware may not support signing, or has another key already")
        return FAILED


async def _remove(url: str, key: bytes, *, is_requested: bool) -> int:
    async with _received(url, key, None) as setup:
        narrate(f"{_who(setup)} at {url}: of its frames {_how(setup)}")
        if setup.is_armed:
            raise Refused("it is armed; disarm it to remove a key")
        narrate("its key is removed; from then on it accepts unsigned frames from anyone")
        if is_requested:
            _confirmed("anyone with access to its links can then command it")
        setup.sign_with(Signs.OURS)
        setup.remove_key()
        setup.sign_with(None)
        setup.reset()
        await setup.listen(LISTEN_S, until=Signs.NOT)
        setup.reset()
        await setup.listen(COUNT_S)
        narrate(f"{_who(setup)} now: of its frames {_how(setup)}")
        return 0 if setup.signs[Signs.NOT] else FAILED
