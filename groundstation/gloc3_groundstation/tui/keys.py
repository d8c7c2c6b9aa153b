"""Keys that several screens have in common."""

from typing import Final

from textual.binding import Binding, BindingType

MISSION_KEYS: Final[list[BindingType]] = [
    Binding("s", "app.move('start')", "Start", tooltip="the mission; it is streamed first if need be"),
    Binding("p", "app.move('pause')", "Pause"),
    Binding("r", "app.move('resume')", "Resume"),
    Binding("a", "app.move('abort')", "Abort", tooltip="cancels all actions, then flies on_failure; asks first"),
    Binding("u", "app.move('stream')", "Upload", tooltip="streams the mission at hand"),
    Binding("c", "app.move('control')", "Control", tooltip="asks for control of the vehicle in view"),
]
"""Steering the mission of the vehicle in view."""

GENERAL_KEYS: Final[list[BindingType]] = [
    Binding("space", "emergency", "HOLD", priority=True, tooltip="the vehicle holds at once; again: land, disarm"),
    Binding(
        "ctrl+@,ctrl+space",
        "emergency(True)",
        "HOLD",
        key_display="^space",
        show=False,
        priority=True,
        tooltip="the same, while typing too",
    ),
    Binding("x", "acknowledge", "Acknowledge", tooltip="take note of the alert that is shown; X: of all"),
    Binding("X", "acknowledge(True)", "Acknowledge all", show=False),
    Binding("v", "cycle(1)", "Vehicle", tooltip="look at the next vehicle; V: at the one before"),
    Binding("V", "cycle(-1)", "Vehicle before", show=False),
    Binding("question_mark", "help", "Help", tooltip="this page"),
    Binding("ctrl+p,colon", "command_palette", "All commands", tooltip="everything, by name"),
    Binding("q", "leave", "Quit"),
    Binding("ctrl+q", "leave", "Quit", show=False, priority=True),  # Textual's own asks nothing
    Binding(
        "ctrl+c",
        "interrupt",
        "Quit",
        show=False,
        priority=True,
        tooltip="asking nothing; in the editor it copies",
    ),
]
"""What works on every screen."""
