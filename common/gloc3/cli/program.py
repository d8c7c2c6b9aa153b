"""The program `gloc3`: its subcommands are found through entry points, so that each package brings its own."""

import gc
import os
import signal
import sys
from collections.abc import Sequence
from importlib.metadata import EntryPoint
from typing import Any, Final

from gloc3 import __version__
from gloc3.cli.narration import ERROR, narrate
from gloc3.errors import Gloc3Error, InputError, NotHeard, nearest
from gloc3.installed import installed_points

SUMMARIES: Final = {
    "sitl": "Run the simulated vehicle: physics, world and autopilot, on real sockets.",
    "onboard": "Run the onboard companion process of a platform.",
    "platform": "Make a platform file from an autopilot; check and show platform files.",
    "doctor": "Check a vehicle's computer and autopilot before a flight, without flying.",
    "preset": "Compare an autopilot's parameters with a preset's, and set them when told to.",
    "network": "Make the network of platforms and stations: members, certificates, roles.",
    "signing": "Make the key of signed MAVLink links, and give it to an autopilot.",
    "station": "Run the ground station: the terminal, --web for a browser, --headless for scripts.",
    "fly": "Fly a mission in simulation: everything in one process, in virtual time.",
    "demo": "Fly a mission with three real processes on this machine.",
    "relay": "Pass datagrams on as a bad link would: a radio, an acoustic modem.",
    "mission": "Make, check, show, simulate and convert mission files; tell what they can ask for.",
    "log": "Inspect, plot, report, recover and replay logs.",
    "odometry": "Run odometers on data sets, and compare trajectories with the truth.",
    "component": "List components and describe them.",
}
"""What `gloc3 --help` says of the subcommands without loading any of them."""

EXTRAS: Final = {
    "aiohttp": "groundstation",
    "jsbsim": "sitl",
    "matplotlib": "sitl",
    "mavsdk": "groundstation",
    "textual": "groundstation",
    "textual_serve": "groundstation",
}
"""Libraries that only some of the installs have, and the extra that brings each."""

EXIT_FAILED: Final = 1
EXIT_WRONG_USE: Final = 2
EXIT_INTERRUPTED: Final = 128 + signal.SIGINT
EXIT_NOBODY_READS: Final = 128 + signal.SIGPIPE


def main() -> None:
    """Runs the program with the arguments of its command line, and ends the process."""
    gc.set_threshold(20_000, 20, 20)  # loading makes many objects that stay; looking for garbage among them is dear
    sys.exit(run(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Runs the program; whatever goes wrong becomes a line on stderr and an exit code."""
    _have_streams()
    name = f"gloc3 {arguments[0]}" if arguments else "gloc3"
    try:
        code = _run(list(arguments))
        sys.stdout.flush()
    except InputError as error:
        narrate(str(error), ERROR)
    except NotHeard as error:
        narrate(f"{name}: {error}", ERROR)
        return EXIT_FAILED
    except Gloc3Error as error:
        narrate(f"{name}: {error}", ERROR)
    except KeyboardInterrupt:
        narrate(f"{name}: interrupted")
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        _forget_stdout()
        return EXIT_NOBODY_READS
    except ModuleNotFoundError as error:
        extra = EXTRAS.get(str(error.name).partition(".")[0])
        if extra is None:
            raise
        hint = f'install it with: pip install "gloc3[{extra}]"'
        narrate(f"{name} needs {error.name}, which is not installed; {hint}", ERROR)
    except OSError as error:
        parts = (name, error.filename, error.strerror or error)
        narrate(": ".join(str(part) for part in parts if part), ERROR)
    else:
        return code
    return EXIT_WRONG_USE


def _run(arguments: list[str]) -> int:
    """Finds the subcommand, loads only its package, and runs it."""
    commands = {point.name: point for point in installed_points("gloc3.commands")}
    if not arguments:
        narrate(_overview(commands))
        return EXIT_WRONG_USE
    name, *rest = arguments
    if name == "help" and rest:
        name, *rest = *rest, "--help"
    if name in ("-h", "--help", "help"):
        print(_overview(commands))  # noqa: T201
        return 0
    if name in ("--version", "-V"):
        print(f"gloc3 {__version__}")  # noqa: T201
        return 0
    if name not in commands:
        hint = f"no option {name}" if name.startswith("-") else f"no command {name!r}; {nearest(name, list(commands))}"
        narrate(f"gloc3: {hint} (see gloc3 --help)")
        return EXIT_WRONG_USE
    return _call(commands[name].load(), rest)


def _call(app: Any, arguments: list[str]) -> int:
    """Calls a subcommand's application, with our way to show help and mistakes."""
    from cyclopts import CycloptsError, Parameter
    from rich.console import Console

    from gloc3.cli.help_page import HelpPage
    from gloc3.cli.wrong_use import explained

    app.help_formatter = HelpPage()
    app.default_parameter = Parameter(negative=())
    app.suppress_keyboard_interrupt = False
    if not arguments and app.default_command is None:
        app.help_print([], console=Console(stderr=True))
        return EXIT_WRONG_USE
    try:
        result = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        path = " ".join([app.name[0], *(error.command_chain or ())])
        narrate(f"{path}: {explained(error)} (see {path} --help)")
        return EXIT_WRONG_USE
    return result if isinstance(result, int) else 0


def _overview(commands: dict[str, EntryPoint]) -> str:
    lines = ["Usage: gloc3 COMMAND [ARGUMENTS]", "", "Commands:"]
    ordered = [*(name for name in SUMMARIES if name in commands), *sorted(set(commands) - set(SUMMARIES))]
    lines += [f"  {name:<10} {SUMMARIES.get(name, f'from {commands[name].value}')}" for name in ordered]
    return "\n".join([*lines, "", "gloc3 COMMAND --help tells more; gloc3 --version tells the version."])


def _have_streams() -> None:
    """A program that is started with a stream closed has none at all; and what a stream cannot show must not end it."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115, PTH123 # open for as long as the process runs
        stream = getattr(sys, name)
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _forget_stdout() -> None:
    """Nobody reads stdout any more: what is still in its buffer must not come up again at the end of the process."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
    os.close(null)
