"""How `--help` looks: two columns, no boxes, so that it reads the same in a terminal, in a pipe and in a bug report."""

import re
from typing import Any, Final

from cyclopts.help import HelpEntry, HelpPanel
from rich.console import Console, ConsoleOptions
from rich.table import Table
from rich.text import Text

PLACEHOLDERS: Final = {"FLOAT": "NUMBER", "INT": "NUMBER", "PATH": "PATH"}
"""What stands for a value, by what the library calls its type; for all others the option's own name does."""

TITLES: Final = {"Parameters": "Options"}
"""Parts that we call by another name."""

_OF_TYPE: Final = re.compile(r"(--[a-z-]+) ([A-Z]+)")
"""An option that must be given, with what the library calls its type."""


class HelpPage:
    """Draws the parts of a help page; the library calls it with each."""

    def render_usage(self, console: Console, options: ConsoleOptions, usage: Any) -> None:
        """Draws the first line."""
        text = _OF_TYPE.sub(lambda found: f"{found[1]} {_placeholder(found[1], found[2])}", _plain(usage, console))
        console.print(f"Usage: {text}", markup=False, highlight=False, soft_wrap=True)
        console.print()

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Draws one part: the commands, the arguments or the options."""
        entries = [entry for entry in panel.entries if "--help" not in entry.names]
        if not entries:
            return
        console.print(Text(f"{TITLES.get(str(panel.title), panel.title)}:", "bold"))
        table = Table.grid(padding=(0, 2, 0, 0))
        table.add_column(no_wrap=True)
        table.add_column(overflow="fold")
        for entry in entries:
            table.add_row(Text(f"  {_label(entry)}"), Text(f"{_plain(entry.description, console)}{_default(entry)}"))
        console.print(table)
        console.print()


def _label(entry: HelpEntry) -> str:
    """The name of an entry with a placeholder for its value, such as `--seed NUMBER`."""
    labels = ", ".join(entry.all_options)
    if entry.positional_label or entry.metavar is None:
        return entry.positional_label or labels
    kind = entry.metavar.removesuffix("...")
    return f"{labels} {'|'.join(entry.choices) if entry.choices else _placeholder(entry.positive_names[0], kind)}"


def _placeholder(option: str, kind: str) -> str:
    """What stands for the value of an option."""
    return PLACEHOLDERS.get(kind, option.removeprefix("--").replace("-", "_").upper())


def _plain(description: Any, console: Console) -> str:
    """A description of any kind as text in one line."""
    if description is None:
        return ""
    return " ".join("".join(segment.text for segment in console.render(description)).split())


def _default(entry: HelpEntry) -> str:
    if entry.default in (None, "False", '""'):
        return ""
    return f" [default: {entry.default}]"
