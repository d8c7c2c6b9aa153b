"""The mission: a graph with live states, its text with findings, and the keys that control it."""

from typing import ClassVar, Final

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.events import ScreenResume
from textual.timer import Timer
from textual.widgets import TextArea

from gloc3.cli.counting import counted
from gloc3.messages.command_interface import Verb
from gloc3.messages.summaries import MissionSummary
from gloc3.mission.model.states import ActionState
from gloc3_groundstation.missions.outline import Outline, legal_verbs
from gloc3_groundstation.tui.dialogues.mission_files import MissionFileDialogue
from gloc3_groundstation.tui.dialogues.questions import ABORT_QUESTION, YesNoQuestion
from gloc3_groundstation.tui.dialogues.single_action import SingleAction
from gloc3_groundstation.tui.screen import StationScreen
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.chrome import Key
from gloc3_groundstation.tui.views.mission.detail import (
    detail_lines,
    detail_title,
    nothing_lines,
    position_line,
    text_line,
)
from gloc3_groundstation.tui.views.mission.graph import mission_graph
from gloc3_groundstation.tui.widgets.graph_panel import GraphPanel
from gloc3_groundstation.tui.widgets.lines import Span, Tone
from gloc3_groundstation.tui.widgets.mission_text import MissionText
from gloc3_groundstation.tui.widgets.panel import Panel

CHECKED_AFTER_S: Final = 0.4
"""After the last key that changed the text it is checked."""
ITEM_ABORT_QUESTION: Final = "Abort {} on {}?\nIt is cancelled; then the mission's on_failure policy may run."


class MissionScreen(StationScreen):
    """Graph or text of the mission on the selected vehicle, or of the open one."""

    HELP = """The mission as a graph: each box is a task, in running order from left to right, and contains its actions.
    Actions in one lane run in sequence, actions in parallel lanes may run at the same time. The cursor is on the whole
    mission, a task or an action, and the keys that pause, resume, skip, retry and abort apply to that item; if the item
    is over, pause and resume apply to the mission.

    Start uploads the open mission first, if needed. Pause ends every motion in a hold; resume continues from there.
    Skip leaves out the item, and what follows it runs. Abort cancels, then runs the mission's on_failure policy.

    Assign gives tasks for any platform to the vehicles in contact, in the mission's text. When one of them drops out, it
    asks whether the others do its tasks.

    The text is checked while you type, for the vehicle in view. Plans of QGroundControl and waypoint files are
    converted to mission YAML when opened; a file name that ends in .plan or .waypoints exports the mission, after
    listing what such a file cannot hold. Single actions run outside the mission."""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("s", "app.move('start')", "Start", tooltip="the mission; uploaded first if needed"),
        Binding("p", "steer('pause')", "Pause", tooltip="the item under the cursor; the mission, if it is over"),
        Binding("r", "steer('resume')", "Resume"),
        Binding("k", "steer('skip')", "Skip", tooltip="skips it; what follows it runs"),
        Binding("t", "steer('retry')", "Retry", tooltip="the failed item"),
        Binding("a", "steer('abort')", "Abort", tooltip="cancels it, then runs on_failure; asks first"),
        Binding("o", "open", "Open", tooltip="a mission file, a plan, waypoints or an example"),
        Binding("e", "text", "Edit", tooltip="the text of the open mission, with findings"),
        Binding("u", "app.move('stream')", "Upload", tooltip="uploads the open mission"),
        Binding("delete", "withdraw", "Withdraw", show=False, tooltip="withdraws the last mission queued for contact"),
        Binding("d", "single", "Do", tooltip="requests a single action outside the mission"),
        Binding("m", "other", "Other", tooltip="the mission on the vehicle, or the open one"),
        Binding("w", "save_as", "Save as", tooltip="saves under another name, or exports (.plan, .waypoints)"),
        Binding("n", "new", "New", show=False, tooltip="creates a new mission"),
        Binding("c", "app.move('control')", "Control", tooltip="requests control of the vehicle in view"),
        Binding("v", "assign", "Assign", tooltip="tasks for any platform, or those of a vehicle that has dropped out"),
        Binding("escape", "graph", "Graph", tooltip="back to the graph"),
        Binding("ctrl+s", "save", "Save", key_display="^s"),
        Binding("ctrl+n", "finding(1)", "Next finding", key_display="^n"),
        Binding("ctrl+b", "finding(-1)", "Previous finding", key_display="^b"),
    ]
    AUTO_FOCUS = "#graph"

    _is_text = False
    _shown: str = ""
    """The operator's choice: `loaded`, `at hand`, or empty for the more relevant one."""
    _timer: Timer | None = None
    _is_checking = False
    _was_possible: object = None
    _drawn: object = None
    """What the graph that is shown was made of."""

    def body(self) -> ComposeResult:
        """Graph and detail; text and findings."""
        yield Panel(id="position", classes="plain line", can_focus=False)
        yield GraphPanel(id="graph", classes="plain")
        yield Panel(id="detail", can_focus=False)
        yield MissionText(id="text")

    def on_screen_resume(self, event: ScreenResume) -> None:
        """Takes the text over that the map may have changed."""
        super().on_screen_resume(event)
        draft, text = self.desk.missions.draft, self.query_one(MissionText)
        if draft is not None and text.editor.text != draft.text:
            text.invalidate()

    def show_view(self, view: StationView) -> None:
        """Fills the graph or the text."""
        missions, draft = self.desk.missions, self.desk.missions.draft
        name = view.platform.name if view.platform is not None else None
        reported, outline = self._mission(view)
        is_loaded = reported is not None
        is_at_hand = missions.is_at_hand(reported)
        if not self._is_text:
            line = position_line(
                draft, view.platform, view.now_s, self.size.width, is_loaded=is_loaded, is_at_hand=is_at_hand
            )
        else:
            line = text_line(draft)
        waiting = self.desk.queue.of(name) if name is not None else []
        if waiting:
            line = (*line, Span(f"  {waiting[-1].plan.title!r} is queued for contact, delete withdraws it", Tone.WARN))
        elif self.desk.crew.question is not None:
            line = (*line, Span(f"  {self.desk.crew.question.lost} has dropped out, v assigns its tasks", Tone.WARN))
        elif draft is not None and draft.outline is not None and draft.outline.unassigned and not is_loaded:
            line = (*line, Span(f"  {counted(len(draft.outline.unassigned), 'task')} to assign: v", Tone.WARN))
        self.panel("position").show([line])
        if self._is_text and draft is not None:
            text = self.query_one(MissionText)
            text.show_mission(draft, is_checking=self._is_checking, is_wide=self.has_class("-wide"))
        else:
            self._show_graph_cursor(view, reported, outline)
        if not missions.is_checked_for(name) and not self._is_checking:
            self._check()
        if view.platform is not None and missions.lacks_instruction(view.platform):
            self.do(missions.learn(view.platform.name))
        possible = (
            self._verbs(),
            self._legal(""),
            self._is_text,
            draft is not None,
            is_loaded,
            is_at_hand,
            self._target,
            self.desk.crew.has_unassigned,
            self.desk.crew.question,
        )
        if possible != self._was_possible:
            self._was_possible = possible
            self.refresh_bindings()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Enables actions that are possible: on the graph for the item under the cursor, in the text for editing."""
        draft = self.desk.missions.draft
        if action in ("graph", "finding", "save"):
            is_possible = draft is not None and not draft.is_fixed if action == "save" else True
            return is_possible or None if self._is_text else False
        if self._is_text and action in ("steer", "open", "text", "single", "other", "save_as", "new", "assign"):
            return False
        match action:
            case "steer":
                return self._steered(Verb(str(parameters[0]))) is not None or None
            case "text" | "save_as":
                return draft is not None or None
            case "single":
                return (self.view is not None and self.view.platform is not None) or None
            case "other":
                return self._has_other() or None
            case "withdraw":
                return bool(not self._is_text and self.desk.queue.of(self._vehicle() or ""))
            case "assign":
                return self.desk.crew.has_unassigned or self.desk.crew.question is not None
        return True

    def action_withdraw(self) -> None:
        """Takes the last mission back that waits for contact."""
        if self.view is not None and self.view.platform is not None:
            self.desk.queue.withdraw(self.view.platform.name)

    def keys(self) -> list[Key]:
        """The keys; in the text the emergency key is the one that works while typing."""
        hold = [Key("^space", "HOLD", self._vehicle() is not None, True)] if self._is_text else []
        return [*super().keys(), *hold]

    # --- which mission is shown ---

    @property
    def _target(self) -> str:
        return self.query_one(GraphPanel).chosen if self._is_there else ""

    def _mission(self, view: StationView) -> tuple[MissionSummary | None, Outline | None]:
        """Displayed states and order: those of the vehicle's mission, or no states and those of the open mission."""
        missions = self.desk.missions
        held = view.platform.mission.value if view.platform is not None and view.platform.mission is not None else None
        draft = missions.draft
        is_running = held is not None and held.state in (ActionState.RUNNING, ActionState.PAUSED)
        has_commands = held is not None and bool(held.tasks)
        is_wanted = self._shown == "loaded" if self._shown else is_running
        if held is not None and has_commands and (is_wanted or draft is None or missions.is_at_hand(held)):
            return held, missions.outline(held)
        return None, draft.outline if draft is not None else None

    def _has_other(self) -> bool:
        view, missions = self.view, self.desk.missions
        held = view.platform.mission if view is not None and view.platform is not None else None
        is_held = held is not None and bool(held.value.tasks)
        return is_held and missions.draft is not None and not missions.is_at_hand(held.value if held else None)

    def _verbs(self) -> frozenset[Verb]:
        """Commands that are legal for the item under the cursor."""
        return self._legal(self._target)

    def _legal(self, target: str) -> frozenset[Verb]:
        if self.view is None or self._is_text:
            return frozenset()
        reported, _ = self._mission(self.view)
        return legal_verbs(reported, target)

    def _steered(self, verb: Verb) -> str | None:
        """Target of a key: the item under the cursor, else the mission if it can be paused or resumed."""
        if verb in self._verbs():
            return self._target
        return "" if verb in (Verb.PAUSE, Verb.RESUME) and verb in self._legal("") else None

    # --- graph ---

    def _show_graph_cursor(self, view: StationView, reported: MissionSummary | None, outline: Outline | None) -> None:
        graph, detail = self.query_one(GraphPanel), self.panel("detail")
        self.set_class(outline is None, "-nothing")
        timed = view.platform.mission if view.platform is not None else None
        is_stale = reported is not None and timed is not None and timed.is_stale(view.now_s)
        if outline is None:
            self._drawn = None
            graph.show_lines(nothing_lines(self.desk.missions.draft, view.platform, self.desk.missions.recent))
            return
        drawn = (outline, reported, graph.width, is_stale)
        if drawn != self._drawn:
            self._drawn = drawn
            graph.show_graph(mission_graph(outline, reported, graph.width, is_stale=is_stale))
        lines = detail_lines(outline, reported, graph.chosen, detail.width - 1)
        detail.show(lines, detail_title(outline, graph.chosen))
        detail.styles.height = max(3, min(len(lines) + 1, self.query_one("#body").size.height // 2))

    @on(GraphPanel.Moved)
    def show_detail(self) -> None:
        """Shows the details of the item under the cursor."""
        self.show_again()

    def action_steer(self, verb: str) -> None:
        """Sends a command for the item under the cursor; confirms first before an abort."""
        platform = self.view.platform if self.view is not None else None
        if platform is None:
            return
        name, target = platform.name, self._steered(Verb(verb))
        if target is None:
            return

        def steer() -> None:
            self.do(self.desk.missions.steer(name, Verb(verb), target))

        if verb != Verb.ABORT:
            steer()
            return
        then = self.desk.missions.after_abort(platform)
        question = ITEM_ABORT_QUESTION.format(target, name) if target else ABORT_QUESTION.format(name, then)
        self.app.push_screen(YesNoQuestion(question, "abort"), lambda answer: steer() if answer else None)

    def action_assign(self) -> None:
        """Assigns tasks for any platform; those of a vehicle that has dropped out after a confirmation."""
        crew = self.desk.crew
        if crew.question is None:
            self.do(crew.assign(self._vehicle()))
            return
        question = YesNoQuestion(f"{crew.question}.\nAssign them to the others?", "assign", "leave them undone")
        self.app.push_screen(question, lambda answer: crew.answer(is_agreed=bool(answer)))

    def action_other(self) -> None:
        """Shows the other mission."""
        if self.view is not None:
            reported, _ = self._mission(self.view)
            self._shown = "at hand" if reported is not None else "loaded"
            self.show_again()

    def action_single(self) -> None:
        """Asks for a single action."""
        if self.view is not None and self.view.platform is not None:
            self._shown = "loaded"
            self.app.push_screen(SingleAction(self.desk.missions, self.view.platform.name))

    # --- text ---

    def action_text(self) -> None:
        """Shows the text of the open mission, at its first error."""
        draft = self.desk.missions.draft
        if draft is None:
            return
        self._is_text = True
        self.add_class("-text")
        self.show_again()
        text = self.query_one(MissionText)
        text.editor.focus()
        if draft.errors:
            self.call_after_refresh(text.point_at, draft.first_error)
        self.refresh_bindings()

    def action_graph(self) -> None:
        """Back to the graph."""
        self._is_text = False
        self.remove_class("-text")
        if self.desk.missions.has_unsaved:
            self._shown = "at hand"
        self.query_one(GraphPanel).focus()
        self.show_again()
        self.refresh_bindings()

    def action_finding(self, step: int) -> None:
        """Goes from finding to finding."""
        self.query_one(MissionText).go_on(step)

    @on(TextArea.Changed, "#editor")
    def typed(self, event: TextArea.Changed) -> None:
        """Takes the text over; it is checked when nothing more is typed for a moment."""
        draft = self.desk.missions.draft
        if draft is None or draft.is_fixed or event.text_area.text == draft.text:
            return
        self.desk.missions.edit(event.text_area.text)
        self._is_checking = True
        if self._timer is not None:
            self._timer.stop()
        self._timer = self.set_timer(CHECKED_AFTER_S, self._check)
        self.show_again()

    def _check(self) -> None:
        """Checks the open mission in a thread, because a long one takes a while."""
        self._is_checking = True

        async def check() -> None:
            self._is_checking = not await self.desk.missions.check(self._vehicle())
            self.show_again()

        self.run_worker(check(), exclusive=True, group="check", exit_on_error=True)

    # --- open and save ---

    def action_open(self) -> None:
        """Opens another mission; asks about unsaved changes first."""
        self._files.choose(lambda file: self.do(self.open(file)))

    def action_new(self) -> None:
        """Begins a new mission."""

        def begin() -> None:
            self.desk.missions.begin(self._vehicle())
            self.query_one(MissionText).invalidate()
            self.action_text()

        self._files.when_saved(begin)

    def action_save(self) -> None:
        """Saves where it came from."""
        self._files.save(self.show_again)

    def action_save_as(self) -> None:
        """Saves under another name, or exports."""
        self._files.save_as(self.show_again)

    async def open(self, file: str) -> None:
        """Opens a file; one with errors is shown as text, at the first of them."""
        missions = self.desk.missions
        if not await missions.open(file, self._vehicle()) or missions.draft is None:
            self.show_again()
            return
        self.query_one(MissionText).invalidate()
        self._shown, self._is_checking = "at hand", False
        if missions.draft.errors:
            self.action_text()
        else:
            self.action_graph()

    @property
    def _files(self) -> MissionFileDialogue:
        return MissionFileDialogue(self.app, self.desk.missions, self._vehicle)

    def _vehicle(self) -> str | None:
        return self.view.platform.name if self.view is not None and self.view.platform is not None else None
