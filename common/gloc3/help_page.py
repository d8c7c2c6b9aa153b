"""How `--help` looks: two columns, no boxes, so that it reads the same in a terminal, in a pipe and in a bug report."""

from typing import Any, Final

from cyclopts.help import HelpEntry, HelpPanel
from rich.console import Console, ConsoleOptions
from rich.table import Table
from rich.text import Text

PLACEHOLDERS: Final = {"FLOAT": "NUMBER", "INT": "NUMBER", "PATH": "PATH"}
"""What stands for a value, by what the library calls its type; for all others the option's own name does."""

TITLES: Final = {"Parameters": "Options"}
"""Parts that we call by another name."""


class HelpPage:
    """Draws the parts of a help page; the library calls it with each."""

    def render_usage(self, console: Console, options: ConsoleOptions, usage: Any) -> None:
        """Draws the first line."""
        console.print(f"Usage: {_plain(usage, console)}", markup=False, highlight=False, soft_wrap=True)
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
    labels = ", ".join(entry.positive_names + entry.positive_shorts)
    if entry.positional_label or entry.metavar is None:
        return entry.positional_label or labels
    own = entry.positive_names[0].removeprefix("--").replace("-", "_").upper()
    value = "|".join(entry.choices) if entry.choices else PLACEHOLDERS.get(entry.metavar.removesuffix("..."), own)
    return f"{labels} {value}"


def _plain(description: Any, console: Console) -> str:
    """A description of any kind as text in one line."""
    if description is None:
        return ""
    return " ".join("".join(segment.text for segment in console.render(description)).split())


def _default(entry: HelpEntry) -> str:
    if entry.default is None or entry.default == "False":
        return ""
    return f" [default: {entry.default}]"
