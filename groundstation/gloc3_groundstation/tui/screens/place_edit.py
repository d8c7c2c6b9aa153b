"""Editing of places on the map, whatever they belong to: the crosshair picks up, carries and puts down."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Final

from gloc3_groundstation.mapping.handles import Handle, Point
from gloc3_groundstation.tui.views.mission.map import Chart
from gloc3_groundstation.tui.views.mission.map_edit import EditState
from gloc3_groundstation.tui.widgets.lines import Line

REACH: Final = 6.0
"""Distance in dots within which the crosshair picks up a place."""


class PlaceEdit(ABC):
    """What the editing of a mission and that of rally points have in common."""

    TITLE: ClassVar[str]
    """Of what is beside the map."""
    NOTHING_NEAR: ClassVar[str]
    """Says what to do where nothing is near."""

    def __init__(self) -> None:
        self.is_on = False
        self.is_dragging = False
        self.state = EditState()
        self._grip: Point = (0.0, 0.0)
        """From the crosshair to the place that it carries."""

    # --- what is edited ---

    @abstractmethod
    def begin(self, vehicle: str | None) -> str:
        """Begins to edit; returns why not, or an empty text."""

    @abstractmethod
    def drawn(self, chart: Chart, cursor: tuple[int, int], place: Point) -> Chart:
        """The chart with what is edited."""

    @abstractmethod
    def status(self, chart: Chart, place: Point, width: int) -> Line:
        """What is done, or the worst that is wrong: one line below the map."""

    @abstractmethod
    def beside(self, width: int) -> list[Line]:
        """What is edited, beside the map."""

    @abstractmethod
    def add(self, place: Point) -> None:
        """Adds a place after the chosen one."""

    @abstractmethod
    def remove(self) -> None:
        """Leaves out what is chosen."""

    @abstractmethod
    def raise_to(self, height_m: float) -> None:
        """Gives the chosen place another height."""

    @abstractmethod
    def undo(self, *, again: bool = False) -> None:
        """Takes the last change back, or makes it again."""

    @abstractmethod
    def move(self, handle: Handle, to: Point) -> None:
        """Places one elsewhere."""

    # --- the crosshair ---

    def leave(self) -> None:
        """Ends what is begun, one thing at a time; at last the edit mode."""
        state = self.state
        if state.drawing or state.target_ne_m is not None:
            self._set(drawing="", corners=(), target_ne_m=None)
        elif state.chosen is not None:
            self._set(chosen=None)
        else:
            self.is_on = False

    def enter(self, place: Point, m_per_dot: float) -> bool:
        """Sets a corner, places what is carried, or picks up the nearest place; returns whether an area is complete."""
        state = self.state
        if state.drawing:
            first = state.corners[0] if state.corners else None
            if first is not None and len(state.corners) > 2 and _is_near(first, place, REACH * m_per_dot):
                return True
            self._set(corners=(*state.corners, place))
        elif state.target_ne_m is not None:
            self.put_down(place)
        elif not self.pick(place, m_per_dot):
            self._set(message=self.NOTHING_NEAR, chosen=None)
        return False

    def pick(self, place: Point, m_per_dot: float) -> bool:
        """Picks up the place nearest to the crosshair; returns whether one is near."""
        places = self.state.places
        handle = places.nearest(place, REACH * m_per_dot) if places is not None else None
        if handle is None:
            return False
        position = handle.position_ne_m
        self._grip = (position[0] - place[0], position[1] - place[1])
        self._set(chosen=handle, target_ne_m=position)
        return True

    def put_down(self, place: Point) -> None:
        """Places what is carried, with the crosshair there."""
        handle, target = self.state.chosen, self.carried(place)
        self._set(target_ne_m=None)
        if handle is not None and target is not None and target != handle.position_ne_m:
            self.move(handle, target)

    def let_go(self, *, is_chosen: bool = True) -> None:
        """Leaves what is carried where it was; it stays chosen, or nothing is."""
        self._set(target_ne_m=None, chosen=self.state.chosen if is_chosen else None)

    def choose(self, step: int) -> Handle | None:
        """Chooses the next place, or the one before."""
        handles = self.state.places.handles if self.state.places is not None else ()
        if not handles:
            return None
        here = next((number for number, one in enumerate(handles) if one == self.state.chosen), -1 if step > 0 else 0)
        self._set(chosen=handles[(here + step) % len(handles)], target_ne_m=None)
        return self.state.chosen

    def raise_by(self, by_m: float) -> None:
        """Raises the chosen place."""
        handle = self.state.chosen
        if handle is not None:
            self.raise_to((handle.height_m or 0.0) + by_m)

    def carried(self, place: Point) -> Point | None:
        """Where the carried place is, with the crosshair there; None while nothing is carried."""
        if self.state.target_ne_m is None or self.state.chosen is None:
            return None
        return place[0] + self._grip[0], place[1] + self._grip[1]

    def outside_m(self, chart: Chart, place: Point) -> float:
        """How far the carried place is outside the fence; 0 inside it, or while nothing is carried."""
        fence = chart.request.fence if chart.request is not None else None
        target = self.state.target_ne_m or (place if self.state.drawing == "survey" else None)
        if fence is None or target is None:
            return 0.0
        gaps = [area.clearance_m(*target) for area in ([fence.area] if fence.area is not None else [])]
        gaps += [-area.clearance_m(*target) for area in fence.keep_out]
        return max(0.0, -min(gaps, default=0.0))

    def _set(self, **changes: Any) -> None:
        self.state = self.state._replace(**{"message": "", **changes})


def _is_near(one: Point, other: Point, within_m: float) -> bool:
    return abs(one[0] - other[0]) <= within_m and abs(one[1] - other[1]) <= within_m
