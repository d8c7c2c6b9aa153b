"""The map's edit mode: the crosshair picks up, places, adds and raises what the open mission's text names."""

from collections.abc import Callable
from functools import partial

from gloc3.errors import Refused
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.mapping.handles import Handle, HandleKind, Point, places_of
from gloc3_groundstation.mapping.requested import requested
from gloc3_groundstation.missions.place_edits import (
    EditHistory,
    added,
    default_height_m,
    moved,
    raised,
    removed,
    with_fence,
    with_survey,
)
from gloc3_groundstation.tui.screens.place_edit import PlaceEdit
from gloc3_groundstation.tui.views.mission.map import Chart
from gloc3_groundstation.tui.views.mission.map_edit import EditState, draw_edit, edit_lines, state_line
from gloc3_groundstation.tui.widgets.lines import Line


class MapEdit(PlaceEdit):
    """Edits the open mission on the map; every change is one step of undo, and is checked.

    Args:
        desk: holds the open mission.
        changed: called after each change of the text, to have it checked.
    """

    TITLE = "open mission"
    NOTHING_NEAR = "nothing is near: i adds a waypoint here, m draws a survey, b a fence"

    def __init__(self, desk: Desk, changed: Callable[[], None]) -> None:
        super().__init__()
        self._missions, self._station, self._changed = desk.missions, desk.station, changed
        self._history = EditHistory[str]()
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
            self._whose, self._history = (draft.name, draft.path), EditHistory[str]()
        return ""

    def drawn(self, chart: Chart, cursor: tuple[int, int], place: Point) -> Chart:
        """The chart with the open mission in place of the vehicle's, and what is edited."""
        draft = self._missions.draft
        if draft is None:
            self.is_on = False
            return chart
        site, terrain = chart.ground.site, self._station.terrain
        places = places_of(draft.text, draft.carried or draft.text, site, terrain)
        chosen = places.find(self.state.chosen.where) if places is not None and self.state.chosen is not None else None
        self.state = self.state._replace(places=places, chosen=chosen, cursor=cursor)
        self.state = self.state._replace(target_ne_m=self.carried(place))
        return chart._replace(
            request=requested(draft.carried or draft.text, site, terrain),
            is_loaded=False,
            has_cross=False,
            overlay=partial(draw_edit, state=self.state),
        )

    def status(self, chart: Chart, place: Point, width: int) -> Line:
        """What is done, or the worst finding."""
        return state_line(self.state, self._missions.draft, self.outside_m(chart, place), width)

    def beside(self, width: int) -> list[Line]:
        """The chosen place, and all findings."""
        return edit_lines(self.state, self._missions.draft, width)

    # --- changes ---

    def move(self, handle: Handle, to: Point) -> None:
        """Places one elsewhere."""
        places = self.state.places
        if places is not None:
            self._edit(lambda text: moved(text, places, handle, to))

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
