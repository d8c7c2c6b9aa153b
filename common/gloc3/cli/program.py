"""The program `gloc3`: finds its subcommands through entry points, so that each package adds its own."""

import gc
import os
import re
import signal
import sys
from collections.abc import Sequence
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Any, Final

from gloc3 import __version__
from gloc3.cli.narration import ERROR, narrate
from gloc3.component.memory import MemoryReserve, is_out_of_memory
from gloc3.errors import Gloc3Error, InputError, NoContact, nearest
from gloc3.installed import installed_points

if TYPE_CHECKING:
    from cyclopts import CycloptsError
    from cyclopts.help import HelpEntry, HelpPanel
    from rich.console import Console, ConsoleOptions


SUMMARIES: Final = {
    "sitl": "Run the simulated vehicle: physics, world and autopilot, on real sockets.",
    "onboard": "Run the onboard companion process of a platform.",
    "update": "Change the version that the services of this computer run, and back.",
    "platform": "Make a platform file from an autopilot; check and show platform files.",
    "doctor": "Check a vehicle's computer and autopilot before a flight, without flying.",
    "preset": "Compare an autopilot's parameters with a preset's, and set them on request.",
    "network": "Make the network of platforms and stations: members, certificates, roles.",
    "signing": "Make the key of signed MAVLink links, and give it to an autopilot.",
    "station": "Run the ground station: the terminal, --web for a browser, --headless for scripts.",
    "ros2": "Show vehicles to ROS 2, and let it command their missions; without a ROS installation.",
    "fly": "Fly a mission in simulation: everything in one process, in virtual time.",
    "prove": "Look for a flight that goes wrong: faults at any moment, judged by what must hold.",
    "demo": "Fly a mission with three real processes on this machine.",
    "relay": "Pass datagrams on as a bad link would: a radio, an acoustic modem.",
    "mission": "Make, check, show, simulate and convert mission files; list capabilities.",
    "log": "Inspect, plot, report, recover and replay logs.",
    "odometry": "Run odometers on data sets, and compare trajectories with the truth.",
    "calibrate": "Calibrate cameras, pairs, scanners and magnetometers into a rig file.",
    "component": "List components and describe them.",
    "completion": "Print a script that completes commands and options in a shell.",
}
"""What `gloc3 --help` says of the subcommands without loading any of them."""

EXTRAS: Final = {
    "aiohttp": "groundstation",
    "av": "video",
    "foxglove": "groundstation",
    "jsbsim": "sitl",
    "matplotlib": "logs",
    "mcap_ros2": "ros2",
    "mavsdk": "groundstation",
    "pyarrow": "logs",
    "pyulog": "logs",
    "textual": "groundstation",
    "textual_serve": "groundstation",
    "xxhash": "ros2",
}
"""Libraries that only some of the installs have, and the extra that brings each."""

MORE_MEMORY: Final = "raise its limit (ulimit -v, MemoryMax= of a service), or leave components out"
"""What to do where memory is used up."""

EXIT_FAILED: Final = 1
EXIT_WRONG_USE: Final = 2
EXIT_INTERRUPTED: Final = 128 + signal.SIGINT
EXIT_BROKEN_PIPE: Final = 128 + signal.SIGPIPE


def main() -> None:
    """Runs the program with the arguments of its command line, and ends the process."""
    gc.set_threshold(20_000, 20, 20)  # loading makes many objects that stay; looking for garbage among them is dear
    sys.exit(run(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Runs the program; an error becomes a line on stderr and an exit code."""
    _have_streams()
    name = f"gloc3 {arguments[0]}" if arguments else "gloc3"
    try:
        code = _run(list(arguments))
        sys.stdout.flush()
    except InputError as error:
        narrate(str(error), ERROR)
    except NoContact as error:
        narrate(f"{name}: {error}", ERROR)
        return EXIT_FAILED
    except Gloc3Error as error:
        narrate(f"{name}: {error}", ERROR)
    except KeyboardInterrupt:
        narrate(f"{name}: interrupted")
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        _close_stdout()
        return EXIT_BROKEN_PIPE
    except ModuleNotFoundError as error:
        extra = EXTRAS.get(str(error.name).partition(".")[0])
        if extra is None:
            raise
        hint = f'install it with: pip install "gloc3[{extra}]"'
        narrate(f"{name} needs {error.name}, which is not installed; {hint}", ERROR)
    except (OSError, MemoryError, RuntimeError) as error:
        if is_out_of_memory(error):
            narrate(f"{name}: {MemoryReserve.text()}; {MORE_MEMORY}", ERROR)
            return EXIT_FAILED
        if not isinstance(error, OSError):
            raise
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


def prepared(app: Any) -> Any:
    """A subcommand's application with GLOC3's own help pages, and flags without a negative form."""
    from cyclopts import Parameter

    app.help_formatter = HelpPage()
    app.default_parameter = Parameter(negative=())
    app.suppress_keyboard_interrupt = False
    return app


def _call(app: Any, arguments: list[str]) -> int:
    """Calls a subcommand's application, with GLOC3's usage errors."""
    from cyclopts import CycloptsError

    prepared(app)
    if not arguments and app.default_command is None:
        from rich.console import Console

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
    return "\n".join([*lines, "", "gloc3 COMMAND --help explains a command; gloc3 --version prints the version."])


def _have_streams() -> None:
    """Replaces streams that were closed at start, and makes output of unsupported characters safe."""
    if sys.stdin is None:
        sys.stdin = open(os.devnull)  # noqa: SIM115, PTH123 # open for as long as the process runs
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115, PTH123 # open for as long as the process runs
        stream = getattr(sys, name)
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _close_stdout() -> None:
    """Closes stdout when its reader is gone, so that the buffer is not flushed again at the end of the process."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
    os.close(null)


PLACEHOLDERS: Final = {"FLOAT": "NUMBER", "INT": "NUMBER", "PATH": "PATH"}
"""Placeholders of option values, by the library's type name; other types use the option's own name."""

TITLES: Final = {"Parameters": "Options"}
"""Parts that we call by another name."""

_OF_TYPE: Final = re.compile(r"(--[a-z-]+) ([A-Z]+)")
"""Matches a required option with the library's name of its type."""


class HelpPage:
    """Draws the parts of a help page; the library calls it with each."""

    def render_usage(self, console: "Console", options: "ConsoleOptions", usage: Any) -> None:
        """Draws the first line."""
        text = _OF_TYPE.sub(lambda found: f"{found[1]} {_placeholder(found[1], found[2])}", _plain(usage, console))
        console.print(f"Usage: {text}", markup=False, highlight=False, soft_wrap=True)
        console.print()

    def __call__(self, console: "Console", options: "ConsoleOptions", panel: "HelpPanel") -> None:
        """Draws one part: the commands, the arguments or the options."""
        from rich.table import Table
        from rich.text import Text

        entries = [entry for entry in panel.entries if "--help" not in entry.names]
        if not entries:
            return
        console.print(Text(f"{TITLES.get(str(panel.title), panel.title)}:", "bold"))
        table = Table.grid(padding=(0, 2, 0, 0))
        table.add_column(no_wrap=True)
        table.add_column(overflow="fold")
        for entry in entries:
            table.add_row(Text(f"  {_label(entry)}"), Text(f"{_plain(entry.description, console)}{_default(entry)}"))
        console.print(table)
        console.print()


def _label(entry: "HelpEntry") -> str:
    """The name of an entry with a placeholder for its value, such as `--seed NUMBER`."""
    labels = ", ".join(entry.all_options)
    if entry.positional_label or entry.metavar is None:
        return entry.positional_label or labels
    kind = entry.metavar.removesuffix("...")
    return f"{labels} {'|'.join(entry.choices) if entry.choices else _placeholder(entry.positive_names[0], kind)}"


def _placeholder(option: str, kind: str) -> str:
    """Placeholder for the value of an option."""
    return PLACEHOLDERS.get(kind, option.removeprefix("--").replace("-", "_").upper())


def _plain(description: Any, console: "Console") -> str:
    """A description of any kind as text in one line."""
    if description is None:
        return ""
    return " ".join("".join(segment.text for segment in console.render(description)).split())


def _default(entry: "HelpEntry") -> str:
    if entry.default in (None, "False", '""'):
        return ""
    return f" [default: {entry.default}]"


KINDS: Final = {int: "a whole number", float: "a number"}


def explained(error: "CycloptsError") -> str:
    """What is wrong with the arguments, and what would be right."""
    from cyclopts import (
        CoercionError,
        MissingArgumentError,
        RepeatArgumentError,
        UnknownCommandError,
        UnknownOptionError,
        UnusedCliTokensError,
    )

    named = error.argument.name if error.argument is not None else ""
    name = named if named.startswith("--") else named.upper()
    match error:
        case UnknownCommandError(unused_tokens=[word, *_]) if error.app is not None:
            known = [command for command in error.app if not command.startswith("-")]
            return f"no command {word!r}; {nearest(word, known)}"
        case UnknownOptionError(token=token):
            names = [name for argument in error.argument_collection for name in argument.names]
            known = [name.removeprefix("--") for name in names if name.startswith("--")]
            word = token.keyword or token.value
            return f"no option {word}; {nearest(word.lstrip('-'), known)}"
        case MissingArgumentError():
            is_alone = named.startswith("--") and named in (error.root_input_tokens or ())
            return f"{name} needs a value" if is_alone else f"{name} is missing"
        case CoercionError(token=token) if token is not None:
            choices = error.argument.get_choices() if error.argument is not None else None
            kind = KINDS.get(error.target_type) if error.target_type is not None else None
            if choices:
                return f"{name} must be {' or '.join(choices)}, not {token.value!r}"
            if kind is not None:
                return f"{name} must be {kind}, not {token.value!r}"
        case RepeatArgumentError(token=token):
            return f"{token.keyword or name} is given more than once"
        case UnusedCliTokensError(unused_tokens=[*words]):
            return f"unexpected after the arguments: {' '.join(words)!r}"
    return str(error).strip()
