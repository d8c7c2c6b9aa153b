"""The map's edit mode: the crosshair picks up, places, adds and raises what the open mission's text names."""

from collections.abc import Callable
from functools import partial
from typing import Any, Final

from gloc3.errors import Refused
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.mapping.handles import Handle, HandleKind, Point, places_of
from gloc3_groundstation.mapping.requested import requested
from gloc3_groundstation.missions.place_edits import (
    TextHistory,
    added,
    default_height_m,
    moved,
    raised,
    removed,
    with_fence,
    with_survey,
)
from gloc3_groundstation.tui.views.mission.map import Chart
from gloc3_groundstation.tui.views.mission.map_edit import EditState, draw_edit

REACH: Final = 6.0
"""Distance in dots within which the crosshair picks up a place."""


class MapEdit:
    """Edits the open mission on the map; every change is one step of undo, and is checked.

    Args:
        desk: holds the open mission.
        changed: called after each change of the text, to have it checked.
    """

    def __init__(self, desk: Desk, changed: Callable[[], None]) -> None:
        self._missions, self._station, self._changed = desk.missions, desk.station, changed
        self.is_on = False
        self.is_dragging = False
        self.state = EditState()
        self._history = TextHistory()
        self._grip: Point = (0.0, 0.0)
        """From the crosshair to the place that it carries."""
        self._whose: object = None
        """The mission that the steps of undo belong to."""

    def begin(self, vehicle: str | None) -> str:
        """Begins to edit the open mission, or a new one; returns why not, or an empty text."""
        if self._missions.draft is None:
            self._missions.begin(vehicle)
        draft = self._missions.draft
        if draft is None or draft.is_fixed:
            return "this file is no mission and cannot be edited"
        self.is_on, self.state = True, EditState()
        if self._whose != (draft.name, draft.path):
            self._whose, self._history = (draft.name, draft.path), TextHistory()
        return ""

    def leave(self) -> None:
        """Ends what is begun, one thing at a time; at last the edit mode."""
        state = self.state
        if state.drawing or state.target_ne_m is not None:
            self._set(drawing="", corners=(), target_ne_m=None)
        elif state.chosen is not None:
            self._set(chosen=None)
        else:
            self.is_on = False

    def drawn(self, chart: Chart, cursor: tuple[int, int], place: Point) -> Chart:
        """The chart with the open mission in place of the vehicle's, and what is edited."""
        draft = self._missions.draft
        if draft is None:
            self.is_on = False
            return chart
        site, terrain = chart.ground.site, self._station.terrain
        places = places_of(draft.text, draft.carried or draft.text, site, terrain)
        chosen = places.find(self.state.chosen.where) if places is not None and self.state.chosen is not None else None
        carried = self.state.target_ne_m is not None and chosen is not None
        target = (place[0] + self._grip[0], place[1] + self._grip[1]) if carried else None
        self.state = self.state._replace(places=places, chosen=chosen, target_ne_m=target, cursor=cursor)
        return chart._replace(
            request=requested(draft.carried or draft.text, site, terrain),
            is_loaded=False,
            has_cross=False,
            overlay=partial(draw_edit, state=self.state),
        )

    def outside_m(self, chart: Chart, place: Point) -> float:
        """How far the carried place is outside the fence; 0 inside it, or while nothing is carried."""
        fence = chart.request.fence if chart.request is not None else None
        target = self.state.target_ne_m or (place if self.state.drawing == "survey" else None)
        if fence is None or target is None:
            return 0.0
        gaps = [area.clearance_m(*target) for area in ([fence.area] if fence.area is not None else [])]
        gaps += [-area.clearance_m(*target) for area in fence.keep_out]
        return max(0.0, -min(gaps, default=0.0))

    # --- the crosshair ---

    def enter(self, place: Point, m_per_dot: float) -> bool:
        """Sets a corner, places what is carried, or picks up the nearest place; returns whether an area is complete."""
        state = self.state
        if state.drawing:
            first = state.corners[0] if state.corners else None
            if first is not None and len(state.corners) > 2 and _is_near(first, place, REACH * m_per_dot):
                return True
            self._set(corners=(*state.corners, place))
        elif state.target_ne_m is not None:
            self.put_down()
        elif not self.pick(place, m_per_dot):
            self._set(message="nothing is near: i adds a waypoint here, m draws a survey, b a fence", chosen=None)
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

    def put_down(self) -> None:
        """Places what is carried."""
        places, handle, target = self.state.places, self.state.chosen, self.state.target_ne_m
        self._set(target_ne_m=None)
        if places is not None and handle is not None and target is not None and target != handle.position_ne_m:
            self._edit(lambda text: moved(text, places, handle, target))

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

    # --- changes ---

    def add(self, place: Point) -> None:
        """Adds a place after the chosen one, a waypoint where none is chosen."""
        places, chosen = self.state.places, self.state.chosen
        if places is None:
            return

        def with_place(text: str) -> str:
            found, where = added(text, places, chosen, place, default_height_m(text, places, chosen))
            self._set(chosen=Handle(where, HandleKind.WAYPOINT, "", place))  # found again by where it is
            return found

        self._edit(with_place)

    def remove(self) -> None:
        """Leaves out the chosen place, or the last corner that was drawn."""
        handle = self.state.chosen
        if self.state.drawing:
            self._set(corners=self.state.corners[:-1])
        elif handle is not None:
            self._set(chosen=None, target_ne_m=None)
            self._edit(lambda text: removed(text, handle))

    def raise_by(self, by_m: float) -> None:
        """Raises the chosen place."""
        handle = self.state.chosen
        if handle is not None:
            self.raise_to((handle.height_m or 0.0) + by_m)

    def raise_to(self, height_m: float) -> None:
        """Gives the chosen place another height."""
        handle = self.state.chosen
        if handle is not None:
            self._edit(lambda text: raised(text, handle, height_m))

    def draw(self, what: str) -> None:
        """Begins to draw the corners of a survey or a fence."""
        self._set(drawing=what, corners=(), chosen=None, target_ne_m=None)

    def finish(self, spacing_m: float = 0.0, height_m: float | None = None) -> None:
        """Puts the drawn area into the mission; the numbers are a survey's."""
        places, corners, what = self.state.places, self.state.corners, self.state.drawing
        self._set(drawing="", corners=())
        if places is None:
            return
        if what == "fence":
            self._edit(lambda text: with_fence(text, places, corners))
        else:
            self._edit(lambda text: with_survey(text, places, corners, spacing_m, height_m)[0])

    def undo(self, *, again: bool = False) -> None:
        """Takes the last change back, or makes it again."""
        draft = self._missions.draft
        if draft is None:
            return
        text = self._history.redo(draft.text) if again else self._history.undo(draft.text)
        self._set(message="" if text is not None else "there is nothing to " + ("redo" if again else "undo"))
        if text is not None:
            self._set(target_ne_m=None)
            self._missions.edit(text)
            self._changed()

    def _edit(self, change: Callable[[str], str]) -> None:
        draft = self._missions.draft
        if draft is None:
            return
        try:
            text = change(draft.text)
        except Refused as refusal:
            self._set(message=str(refusal))
            return
        self._history.changed(draft.text)
        self._missions.edit(text)
        self._changed()

    def _set(self, **changes: Any) -> None:
        self.state = self.state._replace(**{"message": "", **changes})


def _is_near(one: Point, other: Point, within_m: float) -> bool:
    return abs(one[0] - other[0]) <= within_m and abs(one[1] - other[1]) <= within_m
