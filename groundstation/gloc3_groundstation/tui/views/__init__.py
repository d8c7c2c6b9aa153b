"""The screens' content as pure functions of a view: nothing here uses Textual, so tests read it as text.

Screens call them with a view and draw the lines that they return.
"""

__all__ = [
    "chain",
    "charts",
    "chrome",
    "components",
    "events",
    "findings",
    "fleet",
    "flight_data",
    "hosts",
    "joystick",
    "overview",
    "preflight",
    "sensors",
    "stick_flight",
    "teleoperation",
]
