"""The hosts of a platform: state, processes, clock, load, and the last process exit."""

from typing import Final

from gloc3.messages.hosts import HostLine, HostState, HostSummary, HostWords
from gloc3_groundstation.station.snapshots import STALE_AFTER_S, PlatformSnapshot
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone
from gloc3_groundstation.tui.widgets.tables import Column, FittedTable, table_of

COLUMNS: Final = (
    Column("host", 10, grows=1, most=20),
    Column("state", 17),
    Column("processes", 20),
    Column("load", 5, is_right=True),
    Column("clock", 24, rank=2),
    Column("version", 12, rank=3),
    Column("last exit", 18, rank=1, grows=4),
)
UNKNOWN_MS: Final = 65_535
BUSY_PERCENT: Final = 100
STATES: Final = tuple(HostState)
TONES: Final = {
    HostState.EXPECTED: Tone.WARN,
    HostState.HERE: Tone.GOOD,
    HostState.DIFFERENT: Tone.BAD,
    HostState.LOST: Tone.BAD,
}


def host_lines(platform: PlatformSnapshot | None, now_s: float, width: int) -> list[Line]:
    """A title and a line for each host; nothing for a platform of one process."""
    if platform is None or not platform.hosts:
        return []
    table = table_of(COLUMNS, width)
    words = platform.host_names.hosts if platform.host_names is not None else []
    return [
        table.header(),
        *(
            _line(
                table, line, words[index] if index < len(words) else HostWords(f"host {index + 1}"), now_s - received_s
            )
            for index, (line, received_s) in sorted(platform.hosts.items())
        ),
    ]


def _line(table: FittedTable, line: HostLine, words: HostWords, age_s: float) -> Line:
    state = STATES[line.state] if line.state < len(STATES) else HostState.EXPECTED
    is_stale = age_s >= STALE_AFTER_S[HostSummary]
    rest = Tone.STALE if is_stale else None
    restarts = f", {line.restarts}× anew" if line.restarts else ""
    away = f"{line.away} of {line.processes + line.away} down" if line.away else f"{line.processes} up"
    return table.line(
        [
            Span(words.name, rest or Tone.TEXT),
            Span(f"was {state}" if is_stale else state, rest or TONES[state]),
            Span(away + restarts, rest or (Tone.BAD if line.away else Tone.DIM)),
            Span(f"{line.load_percent} %", rest or (Tone.WARN if line.load_percent > BUSY_PERCENT else Tone.DIM)),
            Span(_clock(line, words), rest or Tone.DIM),
            Span(words.version, rest or Tone.DIM),
            Span(words.last_words, rest or (Tone.BAD if line.away else Tone.DIM)),
        ]
    )


def _clock(line: HostLine, words: HostWords) -> str:
    if line.bound_ms == UNKNOWN_MS:
        return "not compared yet"
    return f"{words.clock_offset_s:+.2f} s ± {line.bound_ms} ms" if line.bound_ms else "the platform's"
