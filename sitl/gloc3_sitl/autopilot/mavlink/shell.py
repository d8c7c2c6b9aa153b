"""The shell of PX4's style: a few commands that change nothing, with echo and prompt as NuttX's."""

from collections.abc import Callable, Mapping
from typing import Final

from gloc3.mavlink.message import Address
from gloc3_sitl.autopilot.autopilot import Autopilot

PROMPT: Final = "nsh> \x1b[K"
_LONGEST: Final = 512
_INTERRUPT: Final = "\x03"


class Shell:
    """One shell for each station that types.

    Args:
        autopilot: whose state the commands show.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._typed: dict[Address, str] = {}

    def type(self, sender: Address, data: bytes) -> bytes:
        """Takes what was typed, and returns the output."""
        output = ""
        typed = self._typed.get(sender, "")
        for letter in data.decode(errors="replace"):
            if letter == _INTERRUPT:
                output, typed = f"{output}^C\n{PROMPT}", ""
            elif letter != "\n":
                output, typed = output + letter, (typed + letter)[-_LONGEST:]
            else:
                output, typed = f"{output}\n{self._run(typed)}{PROMPT}", ""
        self._typed[sender] = typed
        return output.encode()

    def _run(self, line: str) -> str:
        name, *arguments = line.split() or [""]
        if not name:
            return ""
        command = _COMMANDS.get(name)
        if command is None:
            return f"nsh: {name}: command not found\n"
        return command(self._autopilot, arguments)


def _help(autopilot: Autopilot, arguments: list[str]) -> str:
    del autopilot, arguments
    return f"Builtin Apps:\n  {'  '.join(sorted(_COMMANDS))}\n"


def _version(autopilot: Autopilot, arguments: list[str]) -> str:
    if arguments != ["all"]:
        return "usage: ver all\n"
    version = ".".join(map(str, autopilot.style.version[:3]))
    return f"HW arch: GLOC3_SITL\nFW version: {version}\nOS: simulation\nBuild URI: gloc3 sitl\n"


def _uptime(autopilot: Autopilot, arguments: list[str]) -> str:
    del arguments
    return f"up {autopilot.craft.now_s:.0f} s\n"


def _parameter(autopilot: Autopilot, arguments: list[str]) -> str:
    if len(arguments) != 2 or arguments[0] != "show":
        return "usage: param show NAME\n"
    name = arguments[1]
    if name not in autopilot.parameters:
        return f"ERROR: no parameter {name}\n"
    return f"{name}: {autopilot.parameters[name]:g}\n"


_COMMANDS: Final[Mapping[str, Callable[[Autopilot, list[str]], str]]] = {
    "help": _help,
    "param": _parameter,
    "uptime": _uptime,
    "ver": _version,
}
