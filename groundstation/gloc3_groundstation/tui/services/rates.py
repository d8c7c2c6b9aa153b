"""Message rates of the vehicle: rate and bandwidth of each message, and requests for other rates."""

from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.widgets import Input

from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.vehicle_desk import VehicleDesk
from gloc3_groundstation.services.rates import RateRow, RateTable
from gloc3_groundstation.tui.services.pane import ServicePane
from gloc3_groundstation.tui.views.services.frame import hint_lines
from gloc3_groundstation.tui.views.services.lists import rate_line, rates_header, rates_title
from gloc3_groundstation.tui.widgets.panel import Row

POLL_PERIOD_S = 1.0
FASTEST_HZ = 1000.0


class RatesPane(ServicePane):
    """The pane of message rates."""

    service = ServiceKind.RATES
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("e", "set", "Rate", tooltip="requests a rate for the message under the cursor; also enter"),
        Binding("n", "name", "By name", tooltip="requests a message that is not received yet"),
        Binding("slash", "search", "Search", tooltip="by name"),
        Binding("b", "busiest", "Busiest", tooltip="the most expensive first, or by name"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._text = ""
        self._is_busiest = False
        self._polled: tuple[float, VehicleDesk | None] = (float("-inf"), None)
        self._table = RateTable()

    def compose(self) -> ComposeResult:
        """The search line above the list."""
        yield Input(id="rates_search", placeholder="search: a part of the name", compact=True)
        yield from super().compose()

    def fill(self, vehicle: VehicleDesk) -> None:
        """The table, measured once a second."""
        if vehicle.now_s >= self._polled[0] + POLL_PERIOD_S or vehicle is not self._polled[1]:
            self._polled, self._table = (vehicle.now_s, vehicle), vehicle.rates
        width, found = self.list.width, self._table.find(self._text)

        def make() -> list[Row]:
            ordered = sorted(found, key=lambda row: -row.bytes_s) if self._is_busiest else found
            return [Row(rate_line(row, width), _key(row)) for row in ordered]

        rows = self.rows(make, self._table, self._text, self._is_busiest, width)
        rows = rows or [Row(line) for line in hint_lines("No received message matches.")]
        self.show(rates_header(width), rows, rates_title(self._table, len(found), self._text))

    def choose(self, key: str) -> None:
        """Asks for a rate."""
        self._request(key.partition(" ")[0])

    def leave(self) -> bool:
        """Leaves the search."""
        if not self._text:
            return False
        self.query_one(Input).value = self._text = ""
        self.query_one(Input).display = False
        self.list.focus()
        self.show_again()
        return True

    def action_set(self) -> None:
        """Asks for another rate of the message under the cursor."""
        if self.list.chosen:
            self.choose(self.list.chosen)

    def action_name(self) -> None:
        """Asks for the name of a message."""

        def check(text: str) -> str:
            return "" if text.strip() else "type the name of a message, such as ATTITUDE, or its number"

        self.prompt(
            "which message?", lambda text: self._request(text.strip().upper()), hint="ATTITUDE, or 30", check=check
        )

    def action_search(self) -> None:
        """Looks for some while typing."""
        search = self.query_one(Input)
        search.display = True
        self.screen.set_focus(search)  # at once, so that what is typed next goes there

    def action_busiest(self) -> None:
        """Sorts by cost, or by name."""
        self._is_busiest = not self._is_busiest
        self.show_again()

    def _request(self, name: str) -> None:
        vehicle = self.vehicle
        if vehicle is None:
            return

        def work(text: str) -> None:
            vehicle.request_rate(name, _rate(text))

        hint = "in Hz; 0: off; empty: the vehicle's default rate"
        self.prompt(f"{name}: how often?", work, hint=hint, check=_wrong)

    @on(Input.Changed, "#rates_search")
    def _typed(self, event: Input.Changed) -> None:
        self._text = event.value.strip()
        self.show_again()

    @on(Input.Submitted, "#rates_search")
    def _sought(self) -> None:
        self.query_one(Input).display = bool(self._text)
        self.list.focus()


def _key(row: RateRow) -> str:
    name = row.name if not row.name.startswith("message ") else str(row.message_id)
    return f"{name} {row.source.system}/{row.source.component}"


def _rate(text: str) -> float | None:
    return float(text) if text.strip() else None


def _wrong(text: str) -> str:
    try:
        rate_hz = _rate(text)
    except ValueError:
        return f"{text!r} is no number"
    is_good = rate_hz is None or 0.0 <= rate_hz <= FASTEST_HZ
    return "" if is_good else f"a rate is from 0 to {FASTEST_HZ:g} Hz"
