"""Edits of the places in a mission's text, as an editor would make them: only their characters change."""

from collections.abc import Iterator, Sequence
from typing import Any, Final, Generic, TypeVar

from gloc3.documents.document import Where, parse
from gloc3.documents.document_edit import replaced, with_item, with_key, without_item
from gloc3.errors import InputError, Refused
from gloc3_groundstation.mapping.handles import Handle, HandleKind, MissionPlaces, Point

DEPARTURES: Final = ("take_off", "depart", "dive", "drive_off")
STEPS_KEPT: Final = 200
DEFAULT_HEIGHT_M: Final = 2.0
T = TypeVar("T")


class EditHistory(Generic[T]):
    """States to go back to, and forward again, such as the texts of a mission."""

    def __init__(self) -> None:
        self._before: list[T] = []
        self._after: list[T] = []

    def changed(self, before: T) -> None:
        """Keeps the state before a change."""
        self._before = [*self._before, before][-STEPS_KEPT:]
        self._after = []

    def undo(self, now: T) -> T | None:
        """The state before the last change; None without one."""
        return self._step(self._before, self._after, now)

    def redo(self, now: T) -> T | None:
        """The state before it was undone; None without one."""
        return self._step(self._after, self._before, now)

    @staticmethod
    def _step(source: list[T], target: list[T], now: T) -> T | None:
        if not source:
            return None
        target.append(now)
        return source.pop()


def moved(text: str, places: MissionPlaces, handle: Handle, to: Point) -> str:
    """The text with a place elsewhere, at the same height.

    Raises:
        Refused: the text cannot be edited there.
    """
    for index, number in enumerate(_numbers(places, to)):
        text = replaced(text, (*handle.where, index), number)
    return text


def raised(text: str, handle: Handle, height_m: float) -> str:
    """The text with another height of a place.

    Raises:
        Refused: the place has none.
    """
    if handle.height_m is None:
        raise Refused(f"{handle.label} has no height of its own")
    return replaced(text, (*handle.where, 2), _number(height_m, 2))


def added(text: str, places: MissionPlaces, after: Handle | None, at: Point, height_m: float) -> tuple[str, Where]:
    """The text with one more place, and where it is.

    Args:
        text: of the mission.
        places: in it.
        after: the place that it follows, in the same list; None: the last waypoint, else a new action.
        at: where it is.
        height_m: its height, where it has one.

    Raises:
        Refused: the text cannot be extended there.
    """
    if after is None or not after.is_in_list:
        listed = [one for one in places.handles if one.kind is HandleKind.WAYPOINT and one.is_in_list]
        after = listed[-1] if listed else None
    if after is None:
        key = "waypoints" if places.is_geo else "waypoints_m"
        numbers = ", ".join((*_numbers(places, at), _number(height_m, 2)))
        text, where = with_action(text, "way", f"{{follow_waypoints: {{{key}: [[{numbers}]]}}}}")
        return text, (*where, "follow_waypoints", key, 0)
    index = after.where[-1]
    assert isinstance(index, int)
    heights = [] if after.height_m is None else [_number(height_m, 2)]
    written = f"[{', '.join([*_numbers(places, at), *heights])}]"
    return with_item(text, after.list_where, index + 1, written), (*after.list_where, index + 1)


def removed(text: str, handle: Handle) -> str:
    """The text without a place.

    Raises:
        Refused: it is the only one, or its list needs it.
    """
    if not handle.is_in_list:
        raise Refused(f"{handle.label} cannot be removed alone; remove its action in the text")
    if handle.siblings <= handle.least:
        raise Refused(f"{handle.label} cannot be removed: {handle.least} are needed")
    index = handle.where[-1]
    assert isinstance(index, int)
    return without_item(text, handle.list_where, index)


def with_survey(
    text: str, places: MissionPlaces, corners: Sequence[Point], spacing_m: float, height_m: float | None
) -> tuple[str, Where]:
    """The text with a survey of an area, after the departure; and where its corners are.

    Raises:
        Refused: there is no task for it.
    """
    key = "area" if places.is_geo else "area_m"
    parts = [f"{key}: {_corners(places, corners)}", f"spacing_m: {_number(spacing_m, 2)}"]
    parts += [] if height_m is None else [f"height_m: {_number(height_m, 2)}"]
    text, where = with_action(text, "survey", f"{{survey: {{{', '.join(parts)}}}}}")
    return text, (*where, "survey", key)


def with_fence(text: str, places: MissionPlaces, corners: Sequence[Point]) -> str:
    """The text with a fence around the mission.

    Raises:
        Refused: it has a fence with an area.
    """
    key, value = "polygon" if places.is_geo else "polygon_m", _value(text)
    written = _corners(places, corners)
    fence = value.get("geofence")
    if fence is None and "geofence" not in value:
        return with_key(text, (), "geofence", f"{{{key}: {written}}}", before="tasks")
    if not isinstance(fence, dict) or {"polygon", "polygon_m", "circle", "circle_m"} & {*fence}:
        raise Refused("the mission has a fence: move its corners, or edit the text")
    return with_key(text, ("geofence",), key, written)


def with_action(text: str, name: str, written: str) -> tuple[str, Where]:
    """The text with one more action, after the departure and before everything that came after that.

    Args:
        text: of the mission.
        name: of the action; a number is added where it is taken.
        written: its value, as a mapping in one line.

    Raises:
        Refused: there is no task with actions.
    """
    value = _value(text)
    group, after = _place_for_action(value)
    actions = _at(value, group)
    free = next(one for one in (name, *(f"{name}{number}" for number in range(2, 1000))) if one not in actions)
    for sibling, where in _waiting_for(actions, after):
        text = replaced(text, (*group, sibling, *where), free)
    text = with_key(text, group, free, f"{written.removesuffix('}')}, after: [{after}]}}", after=after)
    return text, (*group, free)


def default_height_m(text: str, places: MissionPlaces, chosen: Handle | None) -> float:
    """A height for a new place: that of the chosen one, of the last waypoint, or of the departure."""
    known = [one.height_m for one in places.handles if one.height_m is not None]
    if chosen is not None and chosen.height_m is not None:
        return chosen.height_m
    if known:
        return known[-1]
    found = [
        arguments.get("height_m")
        for action in _all_actions(_value(text))
        for capability, arguments in action.items()
        if capability in DEPARTURES and isinstance(arguments, dict)
    ]
    return next((float(one) for one in found if isinstance(one, int | float)), DEFAULT_HEIGHT_M)


def _place_for_action(value: dict[str, Any]) -> tuple[Where, str]:
    """The actions of a task, and which of them a new action follows: the departure, else the last one."""
    found: tuple[Where, str] | None = None
    tasks = value.get("tasks")
    for task, content in tasks.items() if isinstance(tasks, dict) else ():
        actions = content.get("actions") if isinstance(content, dict) else None
        for name, action in actions.items() if isinstance(actions, dict) else ():
            found = ("tasks", task, "actions"), name
            if isinstance(action, dict) and {*DEPARTURES} & {*action}:
                return found
    if found is None:
        raise Refused("the mission has no task with actions, to which the map could add one; edit the text")
    return found


def _waiting_for(actions: dict[str, Any], name: str) -> Iterator[tuple[str, Where]]:
    """The actions that come after another one, and where they say so."""
    for sibling, action in actions.items():
        after = action.get("after") if isinstance(action, dict) else None
        for index, one in enumerate(after if isinstance(after, list) else ()):
            if one == name:
                yield sibling, ("after", index)


def _all_actions(value: dict[str, Any]) -> Iterator[dict[str, Any]]:
    tasks = value.get("tasks")
    for content in tasks.values() if isinstance(tasks, dict) else ():
        actions = content.get("actions") if isinstance(content, dict) else None
        yield from (one for one in (actions.values() if isinstance(actions, dict) else ()) if isinstance(one, dict))


def _value(text: str) -> dict[str, Any]:
    try:
        value = parse(text, "mission").value
    except InputError as error:
        raise Refused(f"the text has errors: {error.findings[0].message}") from None
    return value if isinstance(value, dict) else {}


def _at(value: Any, where: Where) -> dict[str, Any]:
    for step in where:
        value = value[step]
    return dict(value)


def _corners(places: MissionPlaces, corners: Sequence[Point]) -> str:
    return "[" + ", ".join(f"[{', '.join(_numbers(places, corner))}]" for corner in corners) + "]"


def _numbers(places: MissionPlaces, place: Point) -> tuple[str, str]:
    """The two numbers of a place: centimetres in a local frame, and degrees to about a centimetre."""
    decimals = 7 if places.is_geo else 2
    one, other = places.written(place)
    return _number(one, decimals), _number(other, decimals)


def _number(value: float, decimals: int) -> str:
    return f"{round(value, decimals) + 0.0:.{decimals}f}".rstrip("0").rstrip(".")
