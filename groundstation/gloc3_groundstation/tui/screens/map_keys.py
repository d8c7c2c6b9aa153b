"""Keys and mouse of the map's edit mode, and "go here": what the map screen and its editing have in common."""

from collections.abc import Callable
from contextlib import suppress
from math import hypot, isfinite
from typing import ClassVar, Final

from textual import on
from textual.binding import Binding, BindingType

from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.envelope import Severity
from gloc3_groundstation.desk import go_here
from gloc3_groundstation.desk.plan_desk import RallyPoint
from gloc3_groundstation.desk.services_desk import reached
from gloc3_groundstation.mapping.ground import position_of
from gloc3_groundstation.mapping.handles import Point
from gloc3_groundstation.mapping.projection import Projection
from gloc3_groundstation.tui.dialogues.mission_files import MissionFileDialogue
from gloc3_groundstation.tui.dialogues.questions import TextQuestion
from gloc3_groundstation.tui.screen import StationScreen
from gloc3_groundstation.tui.screens.map_edit import MapEdit
from gloc3_groundstation.tui.screens.place_edit import REACH, PlaceEdit
from gloc3_groundstation.tui.screens.rally_edit import RallyEdit
from gloc3_groundstation.tui.views.mission.map import Chart
from gloc3_groundstation.tui.views.mission.map_edit import spacing_m
from gloc3_groundstation.tui.widgets.canvas import CELL
from gloc3_groundstation.tui.widgets.canvas_panel import CanvasPanel
from gloc3_groundstation.tui.widgets.lines import Line

EDIT_ACTIONS: Final = frozenset(
    {"place", "leave", "add", "remove", "choose", "raise_by", "raise_to", "draw", "undo", "redo", "save"}
)
"""Only in the edit mode."""


class EditableMap(StationScreen):
    """A map with a crosshair, on which the open mission can be edited."""

    EDIT_HELP: ClassVar[str] = """e edits the open mission here: its waypoints, the corners of its areas and of its
    fence. The arrows move the crosshair, and so does the mouse; enter picks up the nearest place and places it, or drag
    it with the mouse. i adds a place after the chosen one, delete leaves it out, + and - raise it by a metre, t takes a
    height. m draws a survey and b a fence, corner by corner; enter on the first corner closes them. Every change is one
    step of ^z and ^y, changes the mission's text alone, and is checked at once. The wheel zooms, dragging the empty map
    moves it. g sends the vehicle to the crosshair, after its height and a confirmation.

    y edits the rally points of the vehicle in view with the same keys: they are read from it, and ^s uploads them and
    reads them back. H moves its autopilot's home to the crosshair, after the altitude there and a confirmation."""
    EDIT_BINDINGS: ClassVar[list[BindingType]] = [
        Binding(
            "enter", "place", "Pick/place", tooltip="picks up the nearest place, and places it; a corner while drawing"
        ),
        Binding(
            "i,insert", "add", "Add", key_display="i", tooltip="adds a place after the chosen one, else a waypoint"
        ),
        Binding("delete,backspace", "remove", "Leave out", key_display="del", tooltip="the chosen place"),
        Binding("plus,equals_sign", "raise_by(1)", "Height", key_display="+ -", tooltip="of the chosen place, by 1 m"),
        Binding("minus,underscore", "raise_by(-1)", "Lower", show=False),
        Binding("t", "raise_to", "Type height", tooltip="of the chosen place"),
        Binding("n", "choose(1)", "Next", tooltip="chooses the next place; N: the one before"),
        Binding("N", "choose(-1)", "Previous", show=False),
        Binding("m", "draw('survey')", "Survey", tooltip="draws the area of a survey"),
        Binding("b", "draw('fence')", "Fence", tooltip="draws a fence, where there is none"),
        Binding("ctrl+z", "undo", "Undo", key_display="^z"),
        Binding("ctrl+y", "redo", "Redo", key_display="^y", show=False, tooltip="what was undone"),
        Binding("ctrl+s", "save", "Save", key_display="^s", tooltip="the open mission"),
        Binding("escape", "leave", "Done", tooltip="ends what is begun, then the edit mode"),
        Binding("e", "edit", "Edit", tooltip="edits the open mission on the map"),
        Binding("y", "rally", "Rally", tooltip="edits the rally points of the vehicle in view on the map"),
        Binding("H", "set_home", "Set home", tooltip="moves the autopilot's home to the crosshair; asks first"),
        Binding("g", "go_here", "Go here", tooltip="sends the vehicle in view to the crosshair; asks first"),
    ]
    _projection = Projection(0.0, 0.0, 0.1, 0.0, 0, 0)
    _is_fitting = True
    _is_following = False
    _pointed: tuple[int, int] | None = None
    _fitted: tuple[object, ...] | None = None
    """The vehicle, how many things there were, and the size of the map when everything was fitted last."""
    _chart_seen: Chart | None = None
    _edit: MapEdit | None = None
    _rally: RallyEdit | None = None
    _pressed: tuple[int, int] | None = None
    """Where a button of the mouse was pressed; None while none is."""
    _dragged_from: tuple[int, int] | None = None

    @property
    def mission_edit(self) -> MapEdit:
        """The editing of the open mission."""
        if self._edit is None:
            self._edit = MapEdit(self.desk, self._check)
        return self._edit

    @property
    def rally_edit(self) -> RallyEdit:
        """The editing of the rally points of a vehicle."""
        if self._rally is None:
            self._rally = RallyEdit(self.desk.services)
        return self._rally

    @property
    def edit(self) -> PlaceEdit:
        """The editing that is on, else that of the open mission."""
        return self.rally_edit if self.rally_edit.is_on else self.mission_edit

    @property
    def is_mission_edited(self) -> bool:
        """Whether the open mission is shown, in place of the vehicle's."""
        return self.mission_edit.is_on and not self.rally_edit.is_on

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Enables the keys of the edit mode there, and those that they replace elsewhere."""
        is_on, state = self.edit.is_on, self.edit.state
        if action in EDIT_ACTIONS:
            if not is_on or (action == "draw" and self.rally_edit.is_on):
                return False
            if action in ("raise_by", "raise_to"):
                has_height = state.chosen is not None and state.chosen.height_m is not None
                return has_height or (False if action == "raise_by" else None)
            if action == "remove":
                return state.chosen is not None or bool(state.corners) or None
            return True
        if action in ("edit", "rally"):
            return not is_on
        return super().check_action(action, parameters)

    # --- what the map screen calls ---

    def cursor_cell(self) -> tuple[int, int]:
        """Column and line of the crosshair: where the mouse was, else the middle."""
        width, height = self._projection.width // CELL[0], self._projection.height // CELL[1]
        column, row = self._pointed or (width // 2, height // 2)
        return max(0, min(width - 1, column)), max(0, min(height - 1, row))

    def cursor_place(self) -> Point:
        """North and east of the crosshair."""
        return self.place_at(*self.cursor_cell())

    def place_at(self, column: int, row: int) -> Point:
        """North and east of the middle of a cell."""
        return self._projection.place((column + 0.5) * CELL[0], (row + 0.5) * CELL[1])

    def edited(self, chart: Chart) -> Chart:
        """The chart with what is edited; unchanged outside the edit mode."""
        self._chart_seen = chart
        if self.edit.is_on:
            chart = self._chart_seen = self.edit.drawn(chart, self.cursor_cell(), self.cursor_place())
        return chart

    def state_lines(self, chart: Chart) -> list[Line]:
        """What is edited, or the worst that is wrong with it: a second line below the map in the edit mode."""
        panel = self.panel("cursor")
        panel.styles.height = 2 if self.edit.is_on else 1
        if not self.edit.is_on:
            return []
        return [self.edit.status(chart, self.cursor_place(), panel.width)]

    def show_open_mission(self) -> bool:
        """Shows the open mission beside the map in the edit mode; returns whether that is on."""
        if self.edit.is_on:
            panel = self.panel("vehicles")
            panel.show(self.edit.beside(max(20, panel.width)), self.edit.TITLE)
        return self.edit.is_on

    def move_cursor(self, right: int, up: int) -> None:
        """Moves the crosshair by a cell; at the edge the map moves."""
        column, row = self.cursor_cell()
        width, height = self._projection.width // CELL[0], self._projection.height // CELL[1]
        if not (0 <= column + right < width and 0 <= row - up < height):
            self._is_fitting = self._is_following = False
            self._projection = self._projection.moved(0.25 * right, 0.25 * up)
            column, row = column - round(0.25 * right * width), row + round(0.25 * up * height)
        self._pointed = column + right, row - up
        self.show_again()

    # --- keys ---

    def action_edit(self) -> None:
        """Begins to edit the open mission."""
        problem = self._begin(self.mission_edit)
        if not problem and not self.desk.missions.is_checked_for(self._vehicle()):
            self._check()
        self._shown_again()

    def action_rally(self) -> None:
        """Begins to edit the rally points of the vehicle in view."""
        self._begin(self.rally_edit)
        self._shown_again()

    def _begin(self, edit: PlaceEdit) -> str:
        """Begins to edit; returns why not, or an empty text."""
        problem = edit.begin(self._vehicle())
        if problem:
            self.desk.station.note(self._vehicle() or "", Severity.ERROR, f"edit: {problem}")
        self._pointed, self._fitted, self._is_fitting = self.cursor_cell(), None, True
        self.show_again()  # fits what is edited once
        self._is_fitting = self._is_following = False
        return problem

    def action_leave(self) -> None:
        """Ends what is begun, then the edit mode."""
        self.edit.leave()
        self._shown_again()

    def action_place(self) -> None:
        """Picks up, places, or sets a corner."""
        if self.edit.enter(self.cursor_place(), self._projection.m_per_dot):
            self._finish()
        self._shown_again()

    def action_add(self) -> None:
        """Adds a place at the crosshair."""
        self.edit.add(self.cursor_place())
        self._shown_again()

    def action_remove(self) -> None:
        """Leaves out the chosen place."""
        self.edit.remove()
        self._shown_again()

    def action_choose(self, step: int) -> None:
        """Chooses the next place, and moves the crosshair there."""
        handle, chart = self.edit.choose(step), self._chart_seen
        if handle is not None and chart is not None:
            north, east = handle.position_ne_m
            x, y = self._projection.dot(north, east)
            if not (0 <= x < self._projection.width and 0 <= y < self._projection.height):
                self._projection = self._projection._replace(north_m=north, east_m=east)
                x, y = self._projection.dot(north, east)
            self._pointed = int(x // CELL[0]), int(y // CELL[1])
        self._shown_again()

    def action_raise_by(self, by_m: int) -> None:
        """Raises the chosen place."""
        self.edit.raise_by(float(by_m))
        self._shown_again()

    def action_raise_to(self) -> None:
        """Asks for a height."""
        chosen = self.edit.state.chosen
        if chosen is None or chosen.height_m is None:
            return
        self._prompt(
            f"height of {chosen.label}, m", f"{chosen.height_m:g}", 1, lambda numbers: self.edit.raise_to(*numbers)
        )

    def action_draw(self, what: str) -> None:
        """Begins to draw an area."""
        self.mission_edit.draw(what)
        self._shown_again()

    def action_undo(self) -> None:
        """Takes the last change back."""
        self.edit.undo()
        self._shown_again()

    def action_redo(self) -> None:
        """Makes it again."""
        self.edit.undo(again=True)
        self._shown_again()

    def action_save(self) -> None:
        """Saves the open mission, or uploads the rally points."""
        if self.rally_edit.is_on:
            self._upload_rally()
            return
        MissionFileDialogue(self.app, self.desk.missions, self._vehicle).save(self.show_again)

    def action_go_here(self) -> None:
        """Sends the vehicle in view to the crosshair, after its height and a confirmation."""
        platform, chart = self.view.platform if self.view is not None else None, self._chart_seen
        if platform is None or chart is None:
            return
        try:
            request = go_here.go_to_request(self.desk, platform, chart.ground, *self.cursor_place())
        except Refused as refusal:
            self.desk.station.note(platform.name, Severity.ERROR, f"go here: {refusal}")
            self.show_again()
            return

        async def send(height_m: float) -> None:
            with suppress(Gloc3Error):  # it is noted
                await go_here.go_to(self.desk, request, height_m)

        def typed(numbers: tuple[float, ...]) -> None:
            height = f"{numbers[0]:g} m {request.height_name}"
            self.confirm(f"{request.question} At {height}.", "go there", lambda: self.do(send(numbers[0])))

        self._prompt(f"go here: at which height {request.height_name}, m", f"{request.height_m:z.1f}", 1, typed)

    def action_set_home(self) -> None:
        """Moves the home of the vehicle in view to the crosshair, after its altitude and a confirmation."""
        platform, chart = self.view.platform if self.view is not None else None, self._chart_seen
        if platform is None or chart is None:
            return
        try:
            request = go_here.home_request(self.desk, platform, chart.ground, *self.cursor_place())
        except Refused as refusal:
            self.desk.station.note(platform.name, Severity.ERROR, f"set home: {refusal}")
            self.show_again()
            return

        async def send(altitude_m: float) -> None:
            with suppress(Gloc3Error):  # it is noted
                await self.desk.autopilots.set_home(request.vehicle, request.place._replace(altitude_m=altitude_m))
            self.show_again()

        def typed(numbers: tuple[float, ...]) -> None:
            question = f"{request.question}\nAltitude: {numbers[0]:g} m above the sea."
            self.confirm(question, "move home", lambda: self.do(send(numbers[0])))

        altitude_m = request.place.altitude_m
        self._prompt("set home: altitude of the ground there above the sea, m", f"{altitude_m:.1f}", 1, typed)

    def rally_points(self) -> tuple[RallyPoint, ...] | None:
        """Rally points of the vehicle in view as far as they were read; nothing is requested for it."""
        vehicle = reached(self.desk.services, self._vehicle() or "")[0]
        return vehicle.plans.rally if vehicle is not None else None

    def _upload_rally(self) -> None:
        edit, vehicle = self.rally_edit, self.rally_edit.vehicle
        if vehicle is None or edit.points is None:
            return
        if vehicle.is_armed:
            question = f"{vehicle.name} is ARMED. Replace its rally points? Its return may end at one of them."
            self.confirm(question, "upload them", edit.upload)
        else:
            edit.upload()
        self._shown_again()

    # --- the mouse ---

    @on(CanvasPanel.Pointed, "#map")
    def point(self, event: CanvasPanel.Pointed) -> None:
        """The mouse is the cursor until the map is moved by key."""
        self._pointed = event.column, event.row
        self._drawn_again()

    @on(CanvasPanel.Pressed, "#map")
    def press(self, event: CanvasPanel.Pressed) -> None:
        """Picks up a place, or takes hold of the map."""
        self._pointed = self._pressed = self._dragged_from = event.column, event.row
        edit = self.edit
        if edit.is_on and not edit.state.drawing:
            edit.is_dragging = edit.pick(self.cursor_place(), self._projection.m_per_dot)
        self._drawn_again()

    @on(CanvasPanel.Dragged, "#map")
    def drag(self, event: CanvasPanel.Dragged) -> None:
        """Carries the place, or the map."""
        if self._dragged_from is None:
            return
        before, self._dragged_from = self._dragged_from, (event.column, event.row)
        if self.edit.is_dragging:
            self._pointed = event.column, event.row
        else:
            self._is_fitting = self._is_following = False
            was, now = self.place_at(*before), self.place_at(event.column, event.row)
            here = self._projection
            self._projection = here._replace(
                north_m=here.north_m + was[0] - now[0], east_m=here.east_m + was[1] - now[1]
            )
        self._drawn_again()

    @on(CanvasPanel.Released, "#map")
    def release(self, event: CanvasPanel.Released) -> None:
        """Places what was dragged; a click chooses a place, sets a corner, or shows a vehicle."""
        is_click = self._pressed == (event.column, event.row)
        self._pressed = self._dragged_from = None
        edit = self.edit
        if edit.is_dragging:
            edit.is_dragging = False
            if is_click:
                edit.let_go()
            else:
                edit.put_down(self.cursor_place())
        elif is_click and edit.is_on and edit.state.drawing:
            if edit.enter(self.cursor_place(), self._projection.m_per_dot):
                self._finish()
        elif is_click and edit.is_on:
            edit.let_go(is_chosen=False)
        elif is_click:
            self._show_nearest()
        self._shown_again()

    @on(CanvasPanel.Wheeled, "#map")
    def wheel(self, event: CanvasPanel.Wheeled) -> None:
        """Zooms about the place under the mouse."""
        was = self.place_at(event.column, event.row)
        self._is_fitting = False
        self._projection = self._projection.zoomed(event.steps)
        now, here = self.place_at(event.column, event.row), self._projection
        self._projection = here._replace(north_m=here.north_m + was[0] - now[0], east_m=here.east_m + was[1] - now[1])
        self._drawn_again()

    # --- helpers ---

    def _check(self) -> None:
        """Checks the open mission in a thread, because a long one takes a while."""

        async def check() -> None:
            await self.desk.missions.check(self._vehicle())
            self.show_again()

        self.run_worker(check(), exclusive=True, group="check", exit_on_error=True)

    def _finish(self) -> None:
        """Puts the drawn area into the mission; asks for a survey's numbers."""
        edit = self.mission_edit
        if edit.state.drawing == "fence":
            edit.finish()
            return
        step_m = spacing_m(edit.state.corners)
        self._prompt(
            "distance between lines, and height: m, m", f"{step_m:g}, 2", 2, lambda numbers: edit.finish(*numbers)
        )

    def _prompt(self, question: str, value: str, count: int, do: Callable[[tuple[float, ...]], object]) -> None:
        """Asks for numbers."""

        def answered(text: str | None) -> None:
            if text is None:
                return
            try:
                numbers = tuple(float(part) for part in text.replace(",", " ").split())
            except ValueError:
                numbers = ()
            if len(numbers) == count and all(map(isfinite, numbers)):
                do(numbers)
            else:
                self.desk.station.note("", Severity.ERROR, f"{text!r}: {count} numbers are needed")
            self._shown_again()

        self.app.push_screen(TextQuestion(question, value), answered)

    def _show_nearest(self) -> None:
        """Shows the vehicle that was clicked."""
        chart, place = self._chart_seen, self.cursor_place()
        near: list[tuple[float, str]] = []
        for _, platform, at in chart.placed if chart is not None else ():
            position = position_of(platform)
            if position is not None:
                north, east, _ = at.point(position)
                near.append((hypot(north - place[0], east - place[1]), platform.name))
        if near and min(near)[0] <= REACH * self._projection.m_per_dot:
            self.show_vehicle(min(near)[1])

    def _shown_again(self) -> None:
        self.refresh_bindings()
        self.show_again()

    def _drawn_again(self) -> None:
        if self.view is not None:
            self.show_view(self.view)

    def _vehicle(self) -> str | None:
        return self.view.platform.name if self.view is not None and self.view.platform is not None else None
