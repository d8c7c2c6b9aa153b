"""Files from elsewhere, bad input, and the state table with its mutants."""

from functools import partial
from pathlib import Path
from typing import Any

from tests.data_folders import MISSIONS
from tests.evidence.page import Bar, Figure, Progress
from tests.evidence.suites import suite

from gloc3.errors import InputError
from gloc3.mission.formats import load_plan, read_plan, read_wpl, write_plan, write_wpl

FILES = MISSIONS


def outcome(path: Path) -> str:
    """What becomes of a file: read and written back without loss, or the reason why not."""
    try:
        plan = load_plan(path)
    except InputError as error:
        return "refused: " + str(error.findings[0]).removeprefix(f"{path}:")
    again = read_plan(write_plan(plan), "again") if path.suffix == ".plan" else read_wpl(write_wpl(plan), "again")
    counts = f"{len(plan.items)} items, {len(plan.fence_items())} of the fence, {len(plan.rally_items())} rally points"
    same = (again.items, again.fence_items(), again.rally_items()) == (
        plan.items,
        plan.fence_items(),
        plan.rally_items(),
    )
    return f"read: {counts}; written back and read again {'equal' if same else 'DIFFERENT'}"


def missions(progress: Progress) -> list[Figure]:
    """Bar 3."""
    paths = sorted(path for path in FILES.rglob("*") if path.is_file())
    figures = [Figure("files", str(len(paths)), "> 0", bool(paths))]
    for path in paths:
        name = str(path.relative_to(FILES))
        text: str = progress.part(name, partial(outcome, path))
        figures.append(
            Figure(name, text.replace("|", "\\|"), "read equal, or refused with a reason", "DIFFERENT" not in text)
        )
    return figures


def state_table(progress: Progress) -> list[Figure]:
    """Bar 4."""

    def mutate() -> dict[str, Any]:
        from tests.common.component import table_mutants

        score = table_mutants.score()
        return {
            "mutants": score.mutants,
            "by_scenarios": score.by_scenarios,
            "by_drawing": score.by_drawing,
            "survivors": score.survivors,
        }

    result = progress.part("mutants", mutate)
    figures = suite("state-table", ["tests/common/component/test_state_table.py"])(progress)
    return [
        Figure("single-cell mutants of the table", str(result["mutants"])),
        Figure("caught by scenarios under the host", str(result["by_scenarios"])),
        Figure("caught by the reviewed drawing", str(result["by_drawing"])),
        Figure("caught by neither", str(len(result["survivors"])), "0", not result["survivors"]),
        *figures,
    ]


BAD_INPUT = [
    "tests/commands/test_command_line.py",
    "tests/common/documents/test_document.py",
    "tests/common/platform/test_platform.py",
    "tests/common/messages/test_wire.py",
    "tests/common/mission",
    "tests/common/mavlink/test_parser.py",
    "tests/common/exchange/mavlink/test_hostile_frames.py",
    "tests/common/log",
]

BARS = (
    Bar(
        "mission-files",
        "Mission files of other programs are read without loss, or refused with a reason",
        "Every file is read, or refused with a reason that the user can act on. A file that is written and read again "
        "loses nothing.",
        missions,
    ),
    Bar(
        "state-table",
        "Every cell of the state table is tested, and every changed cell is caught",
        "Scenarios under the host cover every cell of the state table, and mutations of single cells are caught.",
        state_table,
    ),
    Bar(
        "bad-input",
        "Bad files and frames give a clear error, never a traceback or a hang",
        "Damaged, hostile and huge mission files, platform files, MAVLink frames and logs lead to a clear error or "
        "are counted; none causes a traceback or a hang.",
        suite("bad-input", BAD_INPUT),
        seeds="hypothesis chooses, anew in every run",
    ),
)
