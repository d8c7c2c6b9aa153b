"""Topics of the vehicle in view, subscribed to while this screen is shown."""

import asyncio
from typing import Any, Final

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.widgets import Input

from gloc3.messages.watch import Preview, Want
from gloc3_groundstation.station import pictures, wording
from gloc3_groundstation.station.preview_size import RATE_HZ
from gloc3_groundstation.station.watches import Sight
from gloc3_groundstation.tui.screen import StationScreen
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.sensors import (
    POINTS,
    STALE_S,
    field_rows,
    no_topics_lines,
    plot_lines,
    preview_line,
    scan_lines,
    sight_line,
    text_lines,
    topic_rows,
    topics_header,
)
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel, Row
from gloc3_groundstation.tui.widgets.picture_panel import PicturePanel

VIEWER: Final = "sensors"
EYES_S: Final = 2.0
"""Time without an update after which a screen counts as hidden, s."""
REST_S: Final = 0.3
"""Time that the cursor rests on a topic before it is requested, s."""
RATES_HZ: Final = (0.5, 1.0, 2.0, 5.0, 10.0)


class SensorsScreen(StationScreen):
    """The topics, and the one under the cursor: its values, a plot, a picture or a plan."""

    HELP = """All topics that the components of the vehicle in view publish. The topic under the cursor is requested,
    and sampled onboard at the rate shown, as far as the link allows; nothing more is sent after you leave this screen.

    A search text that matches no topic is requested as a full name, such as components/pose/status.

    Hz is the publishing rate on the vehicle, “of” the nominal rate. Tab moves to the fields: the numbers under the
    cursor are plotted. Pictures are scaled down onboard, less so where the link has more bandwidth."""
    BINDINGS = [
        Binding("slash", "type", "Search", key_display="/", tooltip="topics by name, type or component"),
        Binding("plus,equals_sign", "rate(1)", "Faster", key_display="+", tooltip="more samples a second"),
        Binding("minus", "rate(-1)", "Slower", key_display="-", tooltip="fewer samples a second"),
        Binding("f", "full", "Full", tooltip="hides the topics, for a larger picture; again: shows them"),
        Binding("escape", "clear", "All topics", show=False, tooltip="ends the search"),
    ]
    AUTO_FOCUS = "#topics"

    def body(self) -> ComposeResult:
        """Topics at the left; at the right the one under the cursor."""
        with Horizontal(id="sensors"):
            with Vertical(id="topics_side"):
                yield Input(id="topic_search", placeholder="topic, type or component", compact=True)
                yield Panel(id="topics_header", classes="plain line", can_focus=False)
                yield ListPanel(id="topics", classes="plain")
            with Vertical(id="sight_side"):
                yield Panel(id="sight", classes="plain line", can_focus=False)
                yield ListPanel(id="fields")
                yield PicturePanel(id="plot")

    def on_mount(self) -> None:
        """Hides the input until it is requested."""
        super().on_mount()
        self.query_one("#topic_search").display = False
        self._filter = ""
        self._rate = RATES_HZ.index(5.0)
        self._topic = ""
        self._since_s = 0.0
        self._drawn: tuple[object, object, tuple[int, int]] | None = None
        self._is_loading = False

    def on_screen_suspend(self) -> None:
        """Looks at nothing any more."""
        self.desk.station.monitor.unwatch(VIEWER)

    def show_view(self, view: StationView) -> None:
        """Shows the watched topic and its data."""
        topics = self.query_one("#topics", ListPanel)
        self.panel("topics_header").show([topics_header(topics.width)])
        platform = view.platform
        if platform is None:
            topics.show_rows([Row(line) for line in text_lines("no vehicle is heard", topics.width)])
            return
        if not platform.has_companion:
            self.desk.station.monitor.unwatch(VIEWER)
            topics.show_rows([Row(line) for line in text_lines(wording.bare(platform), topics.width)])
            return
        watches = self.desk.station.monitor.watches
        entries, name = watches.entries(platform.name), platform.name
        rows = topic_rows(entries, watches.activity(name), self._filter, topics.width)
        first, *more = no_topics_lines(entries, self._filter, watches.problem(name), topics.width)
        nothing = [Row(first, self._filter if entries else ""), *(Row(line) for line in more)]
        topics.show_rows([Row(line, key) for key, line in rows] or nothing)
        if topics.chosen != self._topic:
            self._topic, self._since_s = topics.chosen, view.now_s
        self._want(name, view.now_s)
        self._show_sight(watches.sight(name, self._topic, view.now_s), name, view.now_s)

    def _want(self, platform: str, now_s: float) -> None:
        monitor = self.desk.station.monitor
        monitor.unwatch(VIEWER, except_from=platform)
        is_image = any(e.name == self._topic and e.type == "Image" for e in monitor.watches.entries(platform))
        wants = []
        if self._topic and now_s - self._since_s >= REST_S:
            room = self.query_one(PicturePanel).room
            width, height = monitor.watches.preview_size(platform, self._topic, room)
            rate_hz = min(self.rate_hz, RATE_HZ) if is_image else self.rate_hz
            wants.append(Want(self._topic, rate_hz, width, height))
        monitor.watch(VIEWER, platform, wants, is_listing=True, for_s=EYES_S)
        if is_image and not pictures.is_loaded() and not self._is_loading:
            self._is_loading = True
            self.do(asyncio.to_thread(pictures.load))

    def _show_sight(self, sight: Sight, platform: str, now_s: float) -> None:
        panel, fields, plot = self.panel("sight"), self.query_one("#fields", ListPanel), self.query_one(PicturePanel)
        message = sight.envelope.payload if sight.envelope is not None else None
        is_image = isinstance(message, Preview)
        wanted_hz = min(self.rate_hz, RATE_HZ) if is_image else self.rate_hz
        panel.show([sight_line(sight, wanted_hz, now_s, panel.width)])
        self.set_class(is_image or hasattr(message, POINTS), "-picture")
        is_stale = now_s - sight.received_s > max(STALE_S, 3.0 / wanted_hz)
        rows = field_rows(message, fields.width, is_stale) if message is not None else []
        fields.show_rows([Row(line, path) for path, line in rows], sight.topic)
        width, height = plot.room[0], plot.room[1] // 2
        if isinstance(message, Preview):
            self._show_picture(message, plot)
            return
        plot.show_picture(None)
        if hasattr(message, POINTS):
            plot.show(scan_lines(getattr(message, POINTS), width, height), "from above")
            return
        series = self.desk.station.monitor.watches.series(platform, sight.topic, fields.chosen)
        plot.show(plot_lines(series, width, height) if series else [], _plot_title(fields.chosen, series))

    def _show_picture(self, preview: Preview, plot: PicturePanel) -> None:
        if not preview.is_valid or not pictures.is_loaded():
            plot.show_picture(None, preview_line(preview))
            plot.show(text_lines(preview.reason or "decoding the picture", plot.width))
            return
        drawn = preview, self.app.theme, plot.room
        if drawn != self._drawn or plot.picture is None:
            self._drawn = drawn
            plot.show_picture(pictures.unpack_picture(preview, plot.room), preview_line(preview))

    @property
    def rate_hz(self) -> float:
        """Requested samples per second."""
        return RATES_HZ[self._rate]

    # --- keys ---

    def action_type(self) -> None:
        """Opens the input for the search text."""
        search = self.query_one("#topic_search", Input)
        search.display = True
        search.focus()

    @on(Input.Changed, "#topic_search")
    def search_as_typed(self, event: Input.Changed) -> None:
        """Searches for the text typed so far."""
        self._filter = event.value.strip()
        self.show_again()

    @on(Input.Submitted, "#topic_search")
    def typed(self) -> None:
        """Goes back to the list."""
        self.query_one("#topic_search").display = False
        self.query_one("#topics").focus()

    def action_clear(self) -> None:
        """Shows all topics."""
        self.query_one("#topic_search", Input).value = ""
        self.typed()

    def action_rate(self, step: int) -> None:
        """Asks for more or fewer samples."""
        self._rate = max(0, min(len(RATES_HZ) - 1, self._rate + step))
        self.show_again()

    def action_full(self) -> None:
        """Gives the topic under the cursor the whole width."""
        self.toggle_class("-full")
        self.call_after_refresh(self.show_again)

    @on(ListPanel.Moved)
    def show_detail(self) -> None:
        """Tells the topic, or plots the field, under the cursor."""
        self.show_again()


def _plot_title(field: str, series: list[Any]) -> str:
    if len(series) < 2:
        return field
    return f"{field}, {series[-1][0] - series[0][0]:.0f} s"
