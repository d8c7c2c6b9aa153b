"""The live picture of a search: a bar, what was reached, and which faults began in which phase."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from gloc3.cli.narration import narrate
from gloc3_sitl.proof.campaign import SearchProgress
from gloc3_sitl.proof.static_proof import StaticProof

MOST_PHASES: Final = 6


@contextmanager
def shown(flights: int | None, *, is_quiet: bool = False) -> Iterator[Callable[[SearchProgress], None]]:
    """Shows a search on stderr: a bar and a live table on a terminal, else a line a round.

    Args:
        flights: how many it flies at most; None where nobody knows.
        is_quiet: shows nothing.
    """
    console = Console(stderr=True)
    if is_quiet:
        yield lambda _: None
    elif not console.is_terminal:
        yield lambda progress: narrate(_line(progress))
    else:
        with Live(console=console, transient=True, refresh_per_second=4) as live:
            yield lambda progress: live.update(render(progress, flights))


def _line(progress: SearchProgress) -> str:
    if progress.shrinking:
        return f"shrinking {progress.shrinking}"
    broken = ", ".join(f"{count} {name}" for name, count in progress.broken.items()) or "nothing broken"
    return f"{progress.flights} flights, {sum(progress.reached.values())} reached, {broken}"


def render(progress: SearchProgress, flights: int | None) -> RenderableType:
    """The picture of one moment."""
    broken = ", ".join(f"{count} {name}" for name, count in progress.broken.items())
    head = Text(
        f"{progress.mission} on {progress.platform}: {progress.flights} flights, {progress.simulated_s:.0f} s flown  "
    )
    head.append(broken or "nothing broken", style="bold red" if broken else "green")
    parts: list[RenderableType] = [head]
    if flights:
        parts.append(ProgressBar(total=flights, completed=min(flights, progress.flights), width=60))
    parts.append(Text("reached: " + ", ".join(f"{count} {kind}" for kind, count in progress.reached.items())))
    parts.append(covered(progress))
    if progress.shrinking:
        parts.append(Text(f"shrinking {progress.shrinking}", style="yellow"))
    return Group(*parts)


def covered(progress: SearchProgress) -> Table:
    """Faults by kind and phase of the mission in which they begin."""
    phases = progress.phases
    shown = phases if len(phases) <= MOST_PHASES else [*phases[: MOST_PHASES - 1], "later"]
    table = Table("fault", *shown, "all", box=None, header_style="bold")
    for kind, row in sorted(progress.covered.items()):
        counts = [row.get(phase, 0) for phase in shown if phase != "later"]
        counts += [sum(row.get(phase, 0) for phase in phases[MOST_PHASES - 1 :])] if "later" in shown else []
        cells = [str(count) if count else Text("0", style="dim") for count in counts]
        table.add_row(kind, *cells, str(sum(row.values())))
    return table


def cells_as_lines(proof: StaticProof) -> list[str]:
    """The answers of a static proof; actions with the same answer share a line."""
    shared: dict[tuple[str, str, str], list[str]] = {}
    for cell in proof.cells:
        shared.setdefault((cell.component, cell.answer, cell.problem), []).append(cell.phase)
    count = len({cell.phase for cell in proof.cells})
    lines = []
    for (component, answer, problem), phases in shared.items():
        where = "always" if len(phases) == count else "during " + ", ".join(phases)
        lines.append(f"{component} dies, {where}: {answer}" + (f"; NO ANSWER: {problem}" if problem else ""))
    return lines
