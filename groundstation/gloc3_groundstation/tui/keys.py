"""Keys that several screens have in common."""

from typing import Final

from textual.binding import Binding, BindingType

MISSION_KEYS: Final[list[BindingType]] = [
    Binding("s", "app.move('start')", "Start", tooltip="the mission; uploaded first if needed"),
    Binding("p", "app.move('pause')", "Pause"),
    Binding("r", "app.move('resume')", "Resume"),
    Binding("a", "app.move('abort')", "Abort", tooltip="cancels all actions, then runs on_failure; asks first"),
    Binding("u", "app.move('stream')", "Upload", tooltip="uploads the open mission"),
    Binding("c", "app.move('control')", "Control", tooltip="requests control of the vehicle in view"),
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
    Binding("x", "acknowledge", "Acknowledge", tooltip="acknowledge the alert shown, or dismiss a refusal; X: all"),
    Binding("X", "acknowledge(True)", "Acknowledge all", show=False),
    Binding("v", "cycle(1)", "Vehicle", tooltip="show the next vehicle; V: the previous one"),
    Binding("V", "cycle(-1)", "Previous vehicle", show=False),
    Binding("question_mark", "help", "Help", tooltip="this page"),
    Binding("ctrl+p,colon", "command_palette", "All commands", tooltip="all commands, by name"),
    Binding("q", "leave", "Quit"),
    Binding("ctrl+q", "leave", "Quit", show=False, priority=True),  # Textual's own asks nothing
    Binding(
        "ctrl+c",
        "interrupt",
        "Quit",
        show=False,
        priority=True,
        tooltip="without asking; in the editor it copies",
    ),
]
"""Keys that work on every screen."""
