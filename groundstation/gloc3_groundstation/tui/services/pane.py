"""Base of the services' panes: a list with its header, one row in full, and confirmations."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.containers import Container

from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.vehicle_desk import VehicleDesk
from gloc3_groundstation.tui.dialogues.questions import YesNoQuestion
from gloc3_groundstation.tui.screen import PaletteCommand
from gloc3_groundstation.tui.widgets.entry import TextEntry
from gloc3_groundstation.tui.widgets.lines import Line
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel, Row


class ServicePane(Container):
    """One service of the vehicle in view.

    An author writes `fill`, which is called only while the pane is shown and the vehicle can be reached, and the keys'
    actions, which ask the vehicle's desk.
    """

    service: ClassVar[ServiceKind]
    detail_lines: ClassVar[int] = 0
    """Lines below the list for the full row under the cursor; 0 for none."""

    def __init__(self) -> None:
        super().__init__(id=self.name_of(self.service), classes="service")
        self.vehicle: VehicleDesk | None = None
        """Whose services these are; None while it cannot be reached."""
        self._made: tuple[tuple[object, ...], Sequence[Row]] = ((), ())

    @staticmethod
    def name_of(service: ServiceKind) -> str:
        """The id of a service's pane."""
        return service.name.lower()

    def compose(self) -> ComposeResult:
        """The list with its header, and the detail."""
        yield Panel(id=f"{self.id}_header", classes="head", can_focus=False)
        yield ListPanel(id=f"{self.id}_list", classes="plain rows")
        if self.detail_lines:
            yield Panel(id=f"{self.id}_detail", classes="detail")

    def fill(self, vehicle: VehicleDesk) -> None:
        """Shows the vehicle's loaded data."""
        raise NotImplementedError

    def style_class(self, vehicle: VehicleDesk) -> object:
        """State on which its keys depend; when it changes, they are updated."""
        del vehicle
        return None

    def choose(self, key: str) -> None:
        """Handles Enter on a row."""

    def leave(self) -> bool:
        """Handles Escape while no job is running; returns whether the pane had something to leave."""
        return False

    def commands(self) -> Sequence[PaletteCommand]:
        """What the command palette offers: the pane's keys."""
        found = []
        for binding in (one for _, one in self._bindings if one.description):
            title = f"{self.service}: {binding.description}"
            found.append(PaletteCommand(title, binding.tooltip, partial(self.run_action, binding.action)))
        return found

    # --- what a pane may call ---

    @property
    def list(self) -> ListPanel:
        """Its list."""
        return self.query_one(f"#{self.id}_list", ListPanel)

    def rows(self, make: Callable[[], Sequence[Row]], *sources: object) -> Sequence[Row]:
        """Rows that are rebuilt only when their sources change: lists are long, and updated often."""
        before = self._made[0]
        if len(before) != len(sources) or any(
            now is not was and now != was for now, was in zip(sources, before, strict=True)
        ):
            self._made = (sources, make())
        return self._made[1]

    def show(self, header: Line, rows: Sequence[Row], title: str) -> None:
        """Fills header and list."""
        self.query_one(f"#{self.id}_header", Panel).show([header], title)
        is_other = len(rows) != len(self.list.lines)
        self.list.show_rows(rows)
        if is_other and self.list.chosen:
            self.list.point_at(self.list.chosen)

    def show_detail(self, lines: Callable[[int], Sequence[Line]], title: str = "") -> None:
        """Fills the details; their lines depend on the width."""
        detail = self.query_one(f"#{self.id}_detail", Panel)
        detail.show(lines(max(20, detail.width)), title)

    def prompt(
        self,
        title: str,
        work: Callable[[str], object],
        *,
        lines: Callable[[int], Sequence[Line]] | None = None,
        value: str = "",
        hint: str = "",
        check: Callable[[str], str] = lambda _: "",
    ) -> None:
        """Asks for a text and does something with it."""

        def answered(text: str | None) -> None:
            if text is not None:
                work(text)
                self.show_again()

        self.app.push_screen(TextEntry(title, lines, value=value, hint=hint, check=check), answered)

    def choose_file(self, title: str, work: Callable[[Path], object], value: str = "") -> None:
        """Asks for the name of a file here; names begin in the folder for downloads."""
        vehicle = self.vehicle
        if vehicle is None:
            return

        def check(text: str) -> str:
            return "" if text.strip() else "type the name of a file"

        hint = f"a file; names begin in {vehicle.folder.absolute()}"
        self.prompt(title, lambda text: work(vehicle.path(text)), value=value, hint=hint, check=check)

    def choose_new_file(self, title: str, work: Callable[[Path], object], value: str = "") -> None:
        """Asks for the name of a file to write, and again before one that exists is replaced."""

        def write(file: Path) -> None:
            if file.exists():
                self.confirm(f"{file.name} is there already. Replace it?", "replace it", lambda: work(file))
            else:
                work(file)

        self.choose_file(title, write, value)

    def confirm(self, question: str, yes: str, work: Callable[[], object]) -> None:
        """Asks for confirmation before a dangerous action."""

        def answered(answer: bool | None) -> None:
            if answer:
                work()
                self.show_again()

        self.app.push_screen(YesNoQuestion(question, yes), answered)

    def confirm_if_armed(self, question: str, yes: str, work: Callable[[], object]) -> None:
        """Asks for confirmation while the vehicle is armed; otherwise acts at once."""
        if self.vehicle is not None and self.vehicle.is_armed:
            self.confirm(f"{self.vehicle.name} is ARMED. {question}", yes, work)
        else:
            work()
            self.show_again()

    def show_again(self) -> None:
        """Updates at once after a key."""
        self.refresh_bindings()
        if self.vehicle is not None and self.is_attached:
            self.fill(self.vehicle)

    @on(ListPanel.Moved)
    def _moved(self) -> None:
        self.show_again()

    @on(ListPanel.Chosen)
    def _chosen(self, event: ListPanel.Chosen) -> None:
        self.choose(event.key)
