"""What of an item's parameters a mission cannot express, although its command can."""

from collections.abc import Iterator

from gloc3.mission.formats.items import MavItem

_UNUSED: dict[int, dict[int, str]] = {
    16: {2: "the acceptance radius of {:g} m", 3: "the radius of {:g} m to pass by at"},
    19: {2: "the heading that is required to leave", 3: "the loiter radius of {:g} m", 4: "where it leaves the circle"},
    21: {1: "the height of {:g} m to abort at", 2: "the precision landing mode {:g}", 4: "the heading of {:g} degrees"},
    22: {1: "the pitch of {:g} degrees", 4: "the heading of {:g} degrees"},
    178: {3: "the throttle of {:g} %"},
}
"""By command and parameter: what is not used."""


def losses(item: MavItem) -> Iterator[tuple[str, str]]:
    """What is left out of an item that is converted, each with a hint."""
    for number, words in _UNUSED.get(item.command, {}).items():
        value = item.params[number - 1]
        if value and not (item.command == 178 and value < 0.0):
            yield f"{words.format(value)} is left out", _HINTS.get((item.command, number), "")
    if not item.is_continued:
        yield "autocontinue is off, but the mission goes on", "add a hold by hand"
    if item.command == 21 and item.z:
        yield f"the height of {item.z:g} m is left out: it lands on the ground", ""


_HINTS = {(16, 2): "set acceptance_m by hand"}
