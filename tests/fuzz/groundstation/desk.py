"""Targets of the station itself: its configuration, scripts, the gamepad, the browser's websocket."""

from typing import Any

from tests.fuzz.target import as_file, fuzz_target, refuses

from gloc3_groundstation.cli.script import parse_command
from gloc3_groundstation.joysticks.defaults import XBOX, default_mapping
from gloc3_groundstation.joysticks.device import JoystickDevice
from gloc3_groundstation.joysticks.linux_reader import EventState
from gloc3_groundstation.store.configuration import ConfigurationFile
from gloc3_groundstation.web.glass import Glass
from gloc3_groundstation.web.terminal_view import LARGEST, TerminalView


@fuzz_target("gloc3_groundstation.store.configuration", "tomllib")
def configuration_file(data: bytes) -> None:
    """A station's configuration is read, and written again with a change, or is refused with findings and places."""

    def whole() -> None:
        file = ConfigurationFile(as_file(data, "station.toml"))
        found = file.read()
        assert file.write(found.with_mission("other.yaml"))
        assert ConfigurationFile(file.path).read() == found.with_mission("other.yaml")

    refuses(whole)


@fuzz_target("gloc3_groundstation.cli.script")
def script_command(data: bytes) -> None:
    """A line of a script is a command, or is refused with its form."""
    refuses(lambda: parse_command(data.decode("utf-8", "replace")))


@fuzz_target("gloc3_groundstation.joysticks.linux_reader", "gloc3_groundstation.joysticks.mapping")
def gamepad_events(data: bytes) -> None:
    """Any bytes of a joystick leave every stick between -1 and 1."""
    state = EventState()
    mapping = default_mapping(JoystickDevice(key="pad", name="pad", controls=XBOX))
    assert mapping is not None
    for size in (1, 5, 8, 64):
        for place in range(0, len(data), size):
            state.feed(data[place : place + size])
        assert all(-1.0 <= one <= 1.0 for one in mapping.sticks(state.reading))


class Window:
    """A terminal that only checks what it is given."""

    vehicle = "heron"

    def attach(self, show: Any, columns: int, lines: int) -> None:
        assert 0 < columns <= LARGEST
        assert 0 < lines <= LARGEST

    def detach(self) -> None:
        """Nothing to do."""

    def typed(self, text: str) -> None:
        assert isinstance(text, str)

    def resized(self, columns: int, lines: int) -> None:
        self.attach(None, columns, lines)

    def focused(self, is_focused: bool) -> None:
        assert is_focused in (True, False)


@fuzz_target("gloc3_groundstation.web")
def browser_message(data: bytes) -> None:
    """Any message of a page is carried out within bounds, or ignored."""
    text = data.decode("utf-8", "replace")
    for may_command in (False, True):
        view = TerminalView(Window, lambda *_: None, "station")
        glass = Glass(None, lambda: 1.0, "a browser", may_command=may_command)  # type: ignore[arg-type] # it sends nothing
        for _ in range(2):
            view.receive(glass, text)
        assert 0 < glass.columns <= LARGEST
