"""Health of the vehicle in view: data flow, every component, and commands to a component."""

from collections.abc import Iterable
from functools import partial
from typing import Final

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding

from gloc3.component.component import FunctionEntry
from gloc3_groundstation.desk.component_desk import arguments
from gloc3_groundstation.station.snapshots import ComponentSnapshot, PlatformSnapshot
from gloc3_groundstation.tui.dialogues.component_dialogues import (
    FORCE_QUESTION,
    HARM_QUESTION,
    ComponentMenu,
    FunctionForm,
)
from gloc3_groundstation.tui.keys import MISSION_KEYS
from gloc3_groundstation.tui.screen import PaletteCommand, StationScreen
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.chain import chain_lines, wiring_lines
from gloc3_groundstation.tui.views.components import (
    answer_lines,
    component_lines,
    component_rows,
    components_header,
    components_title,
)
from gloc3_groundstation.tui.views.hosts import host_lines
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel, Row

AROUND: Final = 8
"""Lines reserved above and below the components."""
LEAST: Final = 3
"""Lines of components that are always shown."""


class HealthScreen(StationScreen):
    """The chain, the components from the samplers to the command interface, and the one under the cursor in full."""

    HELP = """Every component of the vehicle in view in data-flow order: SS samplers, DP processors, CC controllers, AD
    drivers, CI command interfaces. The chain above them breaks where a required component delivers no data and no
    other replaces it: ● working, ◐ quiet, ○ standby or idle, ✕ faulty, · absent.

    A vehicle with several processes or computers lists its hosts below the chain: state, processes, clock offset from
    the vehicle with its uncertainty, and the last output of the process that exited last.

    Rate is measured against nominal; load is the share of the period that a cycle takes; late counts the cycles that
    overran their period. Details of the component under the cursor are below, with its last error.

    Enter offers the commands that its state allows, and its functions. A command to a component that a running action
    needs is refused first; then you are asked whether to force it. If an armed vehicle requires the component, the
    consequence is named before anything is sent."""
    BINDINGS = [
        Binding("k", "command", "Command", key_display="enter", tooltip="commands of the component under the cursor"),
        *MISSION_KEYS,
    ]
    AUTO_FOCUS = "#components"

    def body(self) -> ComposeResult:
        """The chain, the hosts where there are several processes, the components, and the one under the cursor."""
        yield Panel(id="chain", classes="plain", can_focus=False)
        yield Panel(id="hosts", classes="plain", can_focus=False)
        yield Panel(id="components_header", classes="plain line", can_focus=False)
        yield ListPanel(id="components", classes="plain")
        yield Panel(id="component")

    def show_view(self, view: StationView) -> None:
        """Fills the panels."""
        components, component, chain = self.query_one(ListPanel), self.panel("component"), self.panel("chain")
        platform, desk, name = view.platform, self.desk.components, components.chosen
        wiring = desk.wiring(platform.name) if platform is not None else None
        chain.show(chain_lines(platform, wiring, view.now_s, chain.width))
        hosts = self.panel("hosts")
        lines = host_lines(platform, view.now_s, chain.width)
        hosts.show(lines)
        hosts.styles.height, hosts.display = len(lines), bool(lines)
        left = self.query_one("#body").size.height - AROUND - len(lines)
        self.panel("components_header").show([components_header(components.width)])
        rows = component_rows(platform, view.now_s, components.width)
        components.show_rows([Row(line, name) for name, line in rows], components_title(platform, view.now_s))
        components.styles.height = min(len(rows), max(LEAST, left))
        name = components.chosen
        lines = component_lines(platform, name, view.now_s, component.width)
        if platform is not None and name:
            lines = [*answer_lines(desk.answer(platform.name, name), view.now_s, component.width), *lines]
            lines += wiring_lines(wiring, name, component.width)
        component.show(lines, name)

    def commands(self) -> Iterable[PaletteCommand]:
        """The commands of the component under the cursor, by name."""
        found = self._chosen()
        if found is None:
            return
        platform, component = found
        for command, effect in self.desk.components.commands(component).items():
            yield PaletteCommand(
                f"{component.name}: {command}", effect, partial(self._command, platform.name, component.name, command)
            )
        for entry in self.desk.components.functions(platform.name, component):
            run = partial(self._fill_in, platform.name, component.name, entry)
            yield PaletteCommand(f"{component.name}: {entry.name}…", entry.doc.partition("\n")[0], run)

    @on(ListPanel.Moved, "#components")
    def show_detail(self) -> None:
        """Tells the component under the cursor."""
        self.show_again()

    @on(ListPanel.Chosen, "#components")
    def action_command(self) -> None:
        """Opens the requests for the component under the cursor."""
        found = self._chosen()
        if found is None:
            return
        platform, component = found
        commands = self.desk.components.commands(component)
        functions = self.desk.components.functions(platform.name, component)

        def chosen(name: str | None) -> None:
            entry = next((entry for entry in functions if entry.name == name), None)
            if entry is not None:
                self._fill_in(platform.name, component.name, entry)
            elif name is not None:
                self._command(platform.name, component.name, name)

        if commands:
            title = f"{platform.name}: {component.name} is {component.health}"
            self.app.push_screen(ComponentMenu(title, commands, functions), chosen)

    def _command(self, platform: str, component: str, command: str) -> None:
        """Sends a command; asks first where an armed vehicle would lose what it requires."""
        known = self.desk.station.fleet.get(platform)
        harm = self.desk.components.harm(known, component, self.desk.missions.policies(known)) if known else ""

        def send() -> None:
            self.do(self._carry_out(platform, component, command))

        if harm:
            self.confirm(HARM_QUESTION.format(command, component, platform, harm), command, send)
        else:
            send()

    async def _carry_out(self, platform: str, component: str, command: str) -> None:
        """Sends a command; offers to force one that a running action forbids."""
        desk = self.desk.components
        answer = await desk.command(platform, component, command)
        if answer.can_be_forced:
            question = FORCE_QUESTION.format(command, component, answer.text)
            self.confirm(
                question, "force it", lambda: self.do(desk.command(platform, component, command, is_forced=True))
            )
        self.show_again()

    def _fill_in(self, platform: str, component: str, entry: FunctionEntry) -> None:
        """Asks for a function's arguments, and sends it."""

        def filled(texts: dict[str, str] | None) -> None:
            if texts is not None:
                self.do(self.desk.components.call(platform, component, entry, texts))

        self.app.push_screen(FunctionForm(component, entry, partial(arguments, entry)), filled)

    def _chosen(self) -> tuple[PlatformSnapshot, ComponentSnapshot] | None:
        platform = self.view.platform if self.view is not None else None
        if platform is None or self.view is None:
            return None
        name = self.query_one(ListPanel).chosen
        found = next((each for each in platform.components(self.view.now_s) if each.name == name), None)
        return None if found is None else (platform, found)
