"""The program `gloc3`: its subcommands are found through entry points, so that each package brings its own."""

import signal
import sys
from importlib.metadata import EntryPoint, entry_points
from typing import Final

from gloc3 import __version__
from gloc3.errors import Gloc3Error, nearest

SUMMARIES: Final = {
    "sitl": "Run the simulated vehicle: physics, world and autopilot, on real sockets.",
    "onboard": "Run the onboard companion process of a platform.",
    "station": "Run the ground station: the terminal, or --headless for scripts.",
    "fly": "Fly a mission in simulation: everything in one process, in virtual time.",
    "demo": "Fly a mission with three real processes on this machine.",
    "mission": "Check, show and convert mission files.",
    "log": "Inspect, plot, recover and replay logs.",
    "component": "List components and describe them.",
}
"""What `gloc3 --help` says of the subcommands without loading any of them."""

EXTRAS: Final = {"station": "groundstation", "sitl": "sitl", "fly": "sitl", "demo": "sitl"}

EXIT_WRONG_USE: Final = 2


def main() -> None:
    """Finds the subcommand, loads only its package, and runs it."""
    commands = {point.name: point for point in entry_points(group="gloc3.commands")}
    arguments = sys.argv[1:]
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(_overview(commands))  # noqa: T201
        sys.exit(0 if arguments else EXIT_WRONG_USE)
    if arguments[0] in ("--version", "-V"):
        print(f"gloc3 {__version__}")  # noqa: T201
        sys.exit(0)
    name = arguments[0]
    if name not in commands:
        sys.exit(_complain(f"no command {name!r}; {nearest(name, list(commands))}"))
    try:
        app = commands[name].load()
    except ModuleNotFoundError as error:
        extra = EXTRAS.get(name)
        advice = f'; install it with: pip install "gloc3[{extra}]"' if extra else ""
        sys.exit(_complain(f"{name} needs {error.name}, which is not installed{advice}"))
    try:
        result = app(arguments[1:], exit_on_error=True, result_action="return_value")
    except Gloc3Error as error:
        sys.exit(_complain(str(error)))
    except KeyboardInterrupt:
        sys.exit(128 + signal.SIGINT)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)
    sys.exit(result if isinstance(result, int) else 0)


def _overview(commands: dict[str, EntryPoint]) -> str:
    lines = ["usage: gloc3 COMMAND [ARGUMENTS]", "", "commands:"]
    ordered = [*(name for name in SUMMARIES if name in commands), *sorted(set(commands) - set(SUMMARIES))]
    lines += [f"  {name:<10} {SUMMARIES.get(name, f'from {commands[name].value}')}" for name in ordered]
    return "\n".join([*lines, "", "gloc3 COMMAND --help tells more; gloc3 --version tells the version."])


def _complain(text: str) -> int:
    print(f"gloc3: {text}", file=sys.stderr)  # noqa: T201
    return EXIT_WRONG_USE
