"""Parameters: searched, edited within their bounds, compared with a file before it is loaded, and saved."""

from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.widgets import Input

from gloc3.cli.counting import counted
from gloc3_groundstation.desk.parameter_desk import judge
from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.vehicle_desk import Firmware, VehicleDesk
from gloc3_groundstation.services.parameter_table import ParameterRow, ParameterTable
from gloc3_groundstation.tui.services.pane import ServicePane
from gloc3_groundstation.tui.views.services.frame import hint_lines
from gloc3_groundstation.tui.views.services.parameters import (
    Only,
    diff_detail,
    diff_header,
    diff_line,
    diff_rows,
    diff_title,
    parameter_line,
    parameter_lines,
    parameters_header,
    parameters_title,
)
from gloc3_groundstation.tui.widgets.panel import Row


class ParametersPane(ServicePane):
    """The pane of parameters."""

    service = ServiceKind.PARAMETERS
    detail_lines = 7
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f", "fetch", "Fetch", tooltip="lists all parameters of the vehicle"),
        Binding("slash", "search", "Search", tooltip="by name or title; * and ? are wildcards"),
        Binding("e", "edit", "Edit", tooltip="the parameter under the cursor; enter does the same"),
        Binding("o", "open", "Load", tooltip="a file; its changes are shown first"),
        Binding("w", "write", "Write", tooltip="the differences from the file, except excluded ones"),
        Binding("s", "save", "Save", tooltip="all parameters to .params, .parm or .param"),
        Binding("m", "only", "Only", show=False, tooltip="changed, not at default, or all parameters"),
        Binding("i", "describe", "Describe", show=False, tooltip="loads titles and bounds from the vehicle or a file"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._text = ""
        self._only = Only.ALL
        self._sought: tuple[ParameterTable, str, Only] = (ParameterTable(), "", Only.ALL)
        self._found: list[ParameterRow] = []

    def compose(self) -> ComposeResult:
        """The search line above the list."""
        yield Input(
            id="parameters_search", placeholder="search: words of name or title, or a pattern as *_MAX", compact=True
        )
        yield from super().compose()

    def fill(self, vehicle: VehicleDesk) -> None:
        """The list, or the comparison with a file."""
        if vehicle.parameters.diff is not None:
            self._fill_comparison(vehicle)
            return
        table, width = vehicle.parameters.table, self.list.width
        found = self._find(table)
        rows = self.rows(lambda: [Row(parameter_line(row, width), row.name) for row in found], found, width)
        if not rows:
            hints = (
                ("No parameter matches; esc shows all.",)
                if table.is_complete
                else (
                    "f fetches the parameters; over a slow radio that takes minutes.",
                    "Fetching changes nothing on the vehicle.",
                )
            )
            rows = [Row(line) for line in hint_lines(*hints)]
        self.show(parameters_header(width), rows, parameters_title(table, len(found), self._text, self._only))
        row = table.rows.get(self.list.chosen)
        self.show_detail(lambda wide: parameter_lines(row, wide), row.group if row is not None else "")

    def style_class(self, vehicle: VehicleDesk) -> object:
        """The comparison has its own keys."""
        return vehicle.parameters.diff is None

    def choose(self, key: str) -> None:
        """Edits, or leaves one of the file's parameters as it is."""
        if self.vehicle is None:
            return
        if self.vehicle.parameters.diff is None:
            self.action_edit()
        else:
            self.vehicle.parameters.leave_out(key)
            self.show_again()

    def leave(self) -> bool:
        """Leaves the comparison, then the search."""
        if self.vehicle is not None and self.vehicle.parameters.diff is not None:
            self.vehicle.parameters.close_comparison()
        elif self._text or self._only:
            self._text, self._only = "", Only.ALL
            self.query_one(Input).value = ""
            self.query_one(Input).display = False
        else:
            return False
        self.list.focus()
        self.show_again()
        return True

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Hides the keys of the list in a comparison, and those of the comparison in the list."""
        if action in ("write", "edit", "save", "only", "search", "describe"):
            is_comparing = self.vehicle is not None and self.vehicle.parameters.diff is not None
            return is_comparing == (action == "write")
        return super().check_action(action, parameters)

    # --- keys ---

    def action_fetch(self) -> None:
        """Lists all."""
        if self.vehicle is not None:
            self.vehicle.parameters.close_comparison()
            self.vehicle.parameters.fetch()

    def action_search(self) -> None:
        """Looks for some while typing."""
        search = self.query_one(Input)
        search.display = True
        self.screen.set_focus(search)  # at once, so that what is typed next goes there

    def action_only(self) -> None:
        """Shows all, those changed, or those not as the firmware brings them."""
        order = list(Only)
        self._only = order[(order.index(self._only) + 1) % len(order)]
        self.show_again()

    def action_edit(self) -> None:
        """Asks for a value, with all that is known of the parameter."""
        vehicle = self.vehicle
        row = vehicle.parameters.table.rows.get(self.list.chosen) if vehicle is not None else None
        if vehicle is None or row is None:
            return
        name = row.name

        def check(text: str) -> str:
            return judge(vehicle.parameters.table, name, text).reason

        def write(text: str) -> None:
            judged = judge(vehicle.parameters.table, name, text)
            self.confirm_if_armed(
                f"Set {name} to {judged.text} in flight (it is {row.text})?",
                "set it",
                lambda: vehicle.parameters.set(name, judged.value, force=judged.is_forced),
            )

        self.prompt(f"set {name}", write, lines=lambda width: parameter_lines(row, width), value=row.text, check=check)

    def action_open(self) -> None:
        """Compares with a file."""
        if self.vehicle is not None:
            self.choose_file("load parameters from a file", self.vehicle.parameters.compare)

    def action_write(self) -> None:
        """Writes what differs."""
        desk = self.vehicle.parameters if self.vehicle is not None else None
        if desk is None or desk.diff is None:
            return
        count = len(desk.diff.changes(desk.left_out))
        self.confirm_if_armed(f"Write {counted(count, 'parameter')} in flight?", "write them", desk.write)

    def action_save(self) -> None:
        """Saves all."""
        vehicle = self.vehicle
        if vehicle is not None:
            suffix = ".parm" if vehicle.snapshot.firmware is Firmware.ARDUPILOT else ".params"
            self.choose_new_file("save all parameters as", vehicle.parameters.save, f"{vehicle.name}{suffix}")

    def action_describe(self) -> None:
        """Takes the description of the parameters."""
        vehicle = self.vehicle
        if vehicle is None:
            return
        hint = "parameters.json or apm.pdef.xml; empty: from the vehicle"
        self.prompt(
            "describe the parameters",
            lambda text: vehicle.parameters.describe(vehicle.path(text) if text.strip() else None),
            hint=hint,
        )

    @on(Input.Changed, "#parameters_search")
    def _typed(self, event: Input.Changed) -> None:
        self._text = event.value.strip()
        self.show_again()

    @on(Input.Submitted, "#parameters_search")
    def _submitted(self) -> None:
        self.query_one(Input).display = bool(self._text)
        self.list.focus()

    # --- what is shown ---

    def _find(self, table: ParameterTable) -> list[ParameterRow]:
        """Parameters that match the search; updated only after a change."""
        sought = (table, self._text, self._only)
        if any(now is not before for now, before in zip(sought, self._sought, strict=True)):
            is_changed, is_own = self._only is Only.CHANGED, self._only is Only.NOT_DEFAULT
            self._sought, self._found = sought, table.find(self._text, changed=is_changed, not_default=is_own)
        return self._found

    def _fill_comparison(self, vehicle: VehicleDesk) -> None:
        diff, left_out = vehicle.parameters.diff, vehicle.parameters.left_out
        if diff is None:
            return
        width, found = self.list.width, diff_rows(diff)
        rows = self.rows(
            lambda: [Row(diff_line(row, left_out, width), row.name) for row in found], diff, left_out, width
        )
        rows = rows or [Row(line) for line in hint_lines("The vehicle has all values of this file. esc goes back.")]
        self.show(diff_header(width), rows, diff_title(diff, left_out))
        chosen = next((row for row in found if row.name == self.list.chosen), None)
        self.show_detail(lambda wide: diff_detail(diff, chosen, wide), "the file")
