"""Keys that several screens have in common."""

from typing import Final

from textual.binding import Binding, BindingType

MISSION_KEYS: Final[list[BindingType]] = [
    Binding("s", "app.start", "Start", tooltip="the mission; it is streamed first if need be"),
    Binding("p", "app.steer('pause')", "Pause"),
    Binding("r", "app.steer('resume')", "Resume"),
    Binding("a", "app.abort", "Abort", tooltip="cancels all actions, then flies on_failure; asks first"),
    Binding("u", "app.stream", "Upload", tooltip="streams the mission at hand"),
    Binding("c", "app.control", "Control", tooltip="asks for control of the vehicle in view"),
]
"""Steering the mission of the vehicle in view."""
