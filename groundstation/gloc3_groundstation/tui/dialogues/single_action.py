"""The dialogue for a single action: a capability, a typed form for its arguments, and the vehicle's reply."""

from collections.abc import Mapping
from typing import Any, ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.events import DescendantFocus
from textual.screen import ModalScreen
from textual.widgets import Input, Label

from gloc3.errors import Gloc3Error
from gloc3_groundstation.desk.mission_desk import MissionDesk
from gloc3_groundstation.missions.forms import CapabilityForm, FormError, FormField, arguments_of
from gloc3_groundstation.tui.dialogues.questions import YesNoQuestion, start_question
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, cut, spread, wrapped
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel, Row


class SingleAction(ModalScreen[None]):
    """Dialogue that requests a single action and shows the reply."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "back", "Back"),
        Binding("ctrl+s", "send", "Send"),
        Binding("up", "walk(-1)", "Up", show=False),
        Binding("down", "walk(1)", "Down", show=False),
    ]
    AUTO_FOCUS = "#capabilities"

    def __init__(self, missions: MissionDesk, platform: str) -> None:
        """Creates the dialogue.

        Args:
            missions: sends requests to the vehicle.
            platform: the vehicle.
        """
        super().__init__()
        self._missions = missions
        self._platform = platform
        self._form: CapabilityForm | None = None
        self._is_requesting = False

    def compose(self) -> ComposeResult:
        """The capabilities, the form, and the reply."""
        with Vertical(classes="sheet action"):
            yield ListPanel(id="capabilities", classes="plain")
            yield VerticalScroll(id="form", can_focus=False)
            yield Panel(id="hint", classes="plain", can_focus=False)
            yield Panel(id="reply", can_focus=False)

    def on_mount(self) -> None:
        """Begins with the capabilities."""
        self._show_form(None)

    def on_resize(self) -> None:
        """Wraps the lines again."""
        self.call_after_refresh(self._list)

    @on(ListPanel.Chosen, "#capabilities")
    def choose(self, event: ListPanel.Chosen) -> None:
        """Shows the form of a capability."""
        self._show_form(self._missions.form(self._platform, event.key))

    @on(DescendantFocus)
    def explain(self) -> None:
        """Tells of the field that is being filled."""
        form, here = self._form, self.focused
        field = (
            next((one for one in form.fields if here is not None and here.id == f"field_{one.name}"), None)
            if form
            else None
        )
        hint = self.query_one("#hint", Panel)
        reported = [text for text in (field.hint, field.doc) if text] if field is not None else []
        width = max(30, hint.width)
        hint.show([(Span(row, Tone.DIM),) for text in reported for row in wrapped(text, width)][:2])

    @on(Input.Submitted)
    def enter(self, event: Input.Submitted) -> None:
        """Moves to the next field; in the last one it sends."""
        inputs = list(self.query(Input))
        index = inputs.index(event.input)
        if index + 1 < len(inputs):
            inputs[index + 1].focus()
        else:
            self.action_send()

    def action_walk(self, step: int) -> None:
        """Goes to the field above or below."""
        inputs = list(self.query(Input))
        here = next((index for index, one in enumerate(inputs) if one.has_focus), None)
        if here is not None:
            inputs[max(0, min(len(inputs) - 1, here + step))].focus()

    def action_back(self) -> None:
        """Back to the capabilities, or out."""
        if self._form is None:
            self.dismiss()
        else:
            self._show_form(None)

    def action_send(self) -> None:
        """Sends the typed values, if they are valid."""
        form = self._form
        if form is None or self._is_requesting:
            return
        row = self._missions.capabilities(self._platform)[form.capability]
        typed = {one.id.removeprefix("field_"): one.value for one in self.query(Input) if one.id}
        try:
            arguments = arguments_of(form, row, typed)
        except FormError as error:
            self._show_reply(str(error), Tone.BAD)
            for field in self.query(f"#field_{error.field}").results(Input) if error.field else ():
                field.focus()
            return
        if not self._missions.arms(self._platform, form.capability):
            self._begin(form.capability, arguments)
            return

        def answered(answer: bool | None) -> None:
            if answer:
                self._begin(form.capability, arguments)

        self.app.push_screen(YesNoQuestion(start_question(form.capability, [self._platform]), "do it"), answered)

    def _begin(self, capability: str, arguments: dict[str, Any]) -> None:
        self._is_requesting = True
        self._show_reply(f"asking {self._platform}…", Tone.DIM)
        self.run_worker(self._request(capability, arguments), exit_on_error=True)

    async def _request(self, capability: str, arguments: dict[str, Any]) -> None:
        try:
            name = await self._missions.request(self._platform, capability, arguments)
        except Gloc3Error as error:
            self._show_reply(f"refused: {error}", Tone.BAD)
        else:
            self._show_reply(f"accepted: running as {name or capability}; esc returns to its state", Tone.GOOD)
        finally:
            self._is_requesting = False

    # --- what is shown ---

    def _show_form(self, form: CapabilityForm | None) -> None:
        self._form = form
        sheet, box, capabilities = self.query_one(".sheet"), self.query_one("#form"), self.query_one(ListPanel)
        capabilities.display, box.display = form is None, form is not None
        box.remove_children()
        if form is None:
            sheet.border_title = f"single action for {self._platform}"
            sheet.border_subtitle = "enter chooses   esc closes"
            self._show_reply("", Tone.DIM)
            self.query_one("#hint", Panel).show([])
            self.call_after_refresh(self._list)
            capabilities.focus()
            return
        sheet.border_title = f"{form.capability} for {self._platform}"
        self.query_one("#hint", Panel).show([(Span(form.doc, Tone.DIM),)])
        sheet.border_subtitle = "enter: next, and sends   ^s sends   esc: back"
        box.mount(*(_field(field) for field in form.fields))
        claimed = self._claimed(form.claims)
        self._show_reply(
            claimed or ("" if form.fields else "no arguments: ^s sends"), Tone.WARN if claimed else Tone.DIM
        )
        if form.fields:
            box.call_after_refresh(lambda: next(iter(self.query(Input))).focus())
        else:
            self.set_focus(None)

    def _list(self) -> None:
        if self._form is not None:
            return
        panel = self.query_one(ListPanel)
        rows = self._missions.capabilities(self._platform)
        claims = self._claims()
        panel.show_rows(
            [
                Row(_capability_line(name, self._doc(name), rows[name].claims, claims, panel.width), name)
                for name in rows
            ]
        )

    def _doc(self, capability: str) -> str:
        return self._missions.form(self._platform, capability).doc

    def _claims(self) -> Mapping[str, str]:
        platform = self._missions.station.fleet.get(self._platform)
        return self._missions.claimants(platform) if platform is not None else {}

    def _claimed(self, needed: tuple[str, ...]) -> str:
        claims = self._claims()
        held = [f"{name} is claimed by {claims[name]}" for name in needed if name in claims]
        return f"{'; '.join(held)}: pause or abort it first" if held else ""

    def _show_reply(self, text: str, tone: Tone) -> None:
        reply = self.query_one("#reply", Panel)
        width = max(30, reply.width or 60)
        reply.show([(Span(row, tone),) for row in wrapped(text, width)], "reply")


def _label(field: FormField) -> str:
    return f"{field.label} [{field.unit}]" if field.unit else field.label


def _field(field: FormField) -> Horizontal:
    typed = Input(
        field.default, placeholder="" if field.is_required else "optional", id=f"field_{field.name}", compact=True
    )
    return Horizontal(Label(_label(field), markup=False), typed, classes="field")


def _capability_line(name: str, doc: str, needed: tuple[str, ...], claims: Mapping[str, str], width: int) -> Line:
    held = [f"{one} claimed by {claims[one]} " for one in needed if one in claims]
    left = Span(f" {name:<18}")
    right = Span(held[0] if held else "", Tone.WARN)
    room = width - len(left.text) - len(right.text) - 3
    return spread((left, Span(cut(doc, room), Tone.DIM)), (right,) if held else (), width)
