"""The command `gloc3 preset`: compares and sets an autopilot's parameters."""

import asyncio
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import App, Parameter

from gloc3.cli.narration import narrate
from gloc3.errors import Gloc3Error, NoContact, Refused
from gloc3_onboard.cli.onboard_options import DEFAULT_AUTOPILOT, MOST_SYSTEM_ID

if TYPE_CHECKING:
    from gloc3_onboard.autopilot.presets.session import PresetSession, PresetStage

TICK_S: Final = 0.05
LISTEN_S: Final = 10.0
"""So long an autopilot is waited for, which sends a heartbeat each second."""
TIMEOUT_S: Final = 60.0
"""So long all parameters of a preset may take over a slow radio."""

app = App(
    name="gloc3 preset",
    help="""Show what a preset of parameters would change on an autopilot, and apply it on request. Run it while
    `gloc3 onboard` is not running, or over a link of its own.

    For example:

    - `gloc3 preset list`: the presets that ship with GLOC3; a path names your own
    - `gloc3 preset show ardusub_companion`: what is in it, and why
    - `gloc3 preset diff ardusub_companion --autopilot tcpout://127.0.0.1:5760`: what it would change; changes nothing
    - `gloc3 preset apply ardusub_companion --autopilot serial:///dev/ttyACM0:57600`: the same, then asks, sets, reads again

    Exit codes: 0 done, or nothing to be done; 1 the autopilot has other values, lacks or refused one; 2 wrong use.""",
    help_format="markdown",
    version_flags=[],
)


@app.command(name="list")
def list_presets() -> int:
    """List the presets that ship with GLOC3."""
    from gloc3_onboard.autopilot.presets.files import load_preset, preset_files

    for name in preset_files():
        preset = load_preset(name)
        print(f"{name:24} {preset.style} on a {preset.vehicle}, {len(preset.parameters)} parameters")  # noqa: T201
    return 0


@app.command
def show(preset: str, /) -> int:
    """Show what is in a preset.

    Args:
        preset: A preset file, or the name of one that ships with GLOC3.
    """
    from gloc3_onboard.autopilot.presets.files import load_preset

    known = load_preset(preset)
    for name, row in known.parameters.items():
        restart = " (after a restart)" if name in known.restart else ""
        print(f"{name:16} {row.value:<8g} {row.why}{restart}")  # noqa: T201
    return 0


@app.command
def diff(preset: str, /, *, autopilot: str = DEFAULT_AUTOPILOT, system_id: int = 1) -> int:
    """Show what a preset would change on an autopilot. Nothing is changed.

    Args:
        preset: A preset file, or the name of one that ships with GLOC3.
        autopilot: Where the autopilot is, as for gloc3 onboard.
        system_id: The vehicle's MAVLink system.
    """
    return _run(preset, autopilot, system_id, lambda: False)


@app.command
def apply(
    preset: str,
    /,
    *,
    autopilot: str = DEFAULT_AUTOPILOT,
    system_id: int = 1,
    yes: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Show what a preset would change on an autopilot, ask, set it, and read it again.

    Args:
        preset: A preset file, or the name of one that ships with GLOC3.
        autopilot: Where the autopilot is, as for gloc3 onboard.
        system_id: The vehicle's MAVLink system.
        yes: Do not ask, for scripts; the changes are shown all the same.
    """
    return _run(preset, autopilot, system_id, lambda: yes or _is_agreed(), is_applying=True)


def _is_agreed() -> bool:
    if not sys.stdin.isatty():
        raise Refused("there is no terminal to ask on; add --yes to apply it")
    return input("Set these? Type yes: ").strip() == "yes"


def _run(
    preset: str, autopilot: str, system_id: int, is_agreed: Callable[[], bool], *, is_applying: bool = False
) -> int:
    if not 1 <= system_id <= MOST_SYSTEM_ID:
        raise Refused(f"--system-id must be from 1 to {MOST_SYSTEM_ID}; those above are stations'")
    from gloc3.mavlink.message import Address
    from gloc3_onboard.autopilot.link import COMPANION
    from gloc3_onboard.autopilot.presets.files import load_preset
    from gloc3_onboard.autopilot.presets.session import PresetSession

    session = PresetSession(Address(system_id, COMPANION), load_preset(preset))
    return asyncio.run(_converse(session, autopilot, is_agreed, is_applying=is_applying))


async def _converse(
    session: "PresetSession", autopilot: str, is_agreed: Callable[[], bool], *, is_applying: bool
) -> int:
    from gloc3.clock import Clock
    from gloc3.mavlink import codec
    from gloc3.mavlink.node import MavlinkComponent
    from gloc3.mavlink.transport.endpoints import open_endpoint
    from gloc3_onboard.autopilot.presets.session import PresetStage
    from gloc3_onboard.cli.direct import heartbeat_of, signing_of, warn_of_exposure

    loop = asyncio.get_running_loop()
    parser, node = codec.Parser(), MavlinkComponent(session.own, [heartbeat_of(session.own), session])
    encoder = codec.Encoder(*session.own, signing_of(autopilot, Clock(loop)))

    def receive(data: bytes) -> None:
        for frame in parser.receive(data):
            node.receive(frame, loop.time())

    endpoint = await open_endpoint(autopilot, loop, receive)
    warn_of_exposure(autopilot)

    async def until(stage: "PresetStage") -> None:
        begin_s = loop.time()
        while session.stage not in (stage, PresetStage.FAILED):
            if session.stage is PresetStage.LISTENING and loop.time() > begin_s + LISTEN_S:
                raise NoContact(f"{autopilot}: no autopilot responds: {endpoint.problem or 'no heartbeat received'}")
            if loop.time() > begin_s + TIMEOUT_S:
                raise NoContact(f"{autopilot}: the autopilot stopped responding while {session.stage}")
            node.tick(loop.time())
            for message in node.outgoing():
                endpoint.send(encoder.encode(message))
            await asyncio.sleep(TICK_S)

    try:
        await until(PresetStage.READ)
        for change in session.changes:
            print(change)  # noqa: T201
        needed = sum(change.is_needed for change in session.changes)
        missing = sum(change.now is None for change in session.changes)
        if session.problem:
            raise Gloc3Error(session.problem)
        if missing:
            narrate(f"the autopilot does not have {missing} of {len(session.changes)}")
        if not needed:
            narrate("nothing to change")
            return 1 if missing else 0
        if not is_applying:
            return 1
        if not is_agreed():
            narrate("nothing was changed")
            return 1
        session.apply(loop.time())
        await until(PresetStage.DONE)
        if session.problem:
            raise Gloc3Error(session.problem)
        narrate(f"{needed} set and read again")
        return 1 if missing else 0
    finally:
        await endpoint.close()
