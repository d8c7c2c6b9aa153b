"""Boards as they are described: in a word, or in a YAML file of Kalibr's form."""

from pathlib import Path
from typing import Final

from gloc3.documents.document import load_bytes, parse
from gloc3.errors import InputError, Refused
from gloc3_onboard.algorithms.calibration.boards import AprilGrid, CalibrationBoard, Checkerboard
from gloc3_onboard.calibration.numbers import Values

EXAMPLES: Final = (
    "checkerboard:9x6:0.025 (inner corners, side in metres), aprilgrid:6x6:0.088:0.3 (tags, side, gap as share of it)"
)
FILES: Final = (".yaml", ".yml")
COUNTS: Final = (2, 60)
LENGTHS_M: Final = (0.001, 5.0)
TAGS: Final = 587
"""Of the family 36h11."""


def read_board(text: str) -> CalibrationBoard:
    """The board that a command's option describes.

    Args:
        text: `checkerboard:COLUMNSxROWS:SIDE_M`, `aprilgrid:COLUMNSxROWS:SIDE_M:GAP`, or a file of Kalibr's form.

    Raises:
        Refused: it is none.
        InputError: the file is wrong, with everything that is wrong in it.
    """
    if text.endswith(FILES):
        return read_board_file(Path(text))
    kind, *parts = text.split(":")
    try:
        if kind == "checkerboard" and len(parts) == 2:
            columns, rows = _counts(parts[0])
            side_m = _within(parts[1], LENGTHS_M)
            return Checkerboard(columns, rows, (side_m, side_m))
        if kind == "aprilgrid" and len(parts) == 3:
            columns, rows = _counts(parts[0])
            return AprilGrid(columns, rows, _within(parts[1], LENGTHS_M), _within(parts[2], (0.01, 1.0)))
    except ValueError as error:
        raise Refused(f"--board {text!r}: {error}; write {EXAMPLES}") from error
    raise Refused(f"--board {text!r} is no board; write {EXAMPLES}, or name a YAML file of Kalibr's")


def _counts(text: str) -> tuple[int, int]:
    columns, _, rows = text.partition("x")
    return int(_within(columns, COUNTS)), int(_within(rows, COUNTS))


def _within(text: str, bounds: tuple[float, float]) -> float:
    low, high = bounds
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{text!r} is not a number") from None
    if not low <= value <= high:
        raise ValueError(f"{text} must be from {low:g} to {high:g}")
    return value


def read_board_file(path: Path) -> CalibrationBoard:
    """A board in Kalibr's form: `target_type` is aprilgrid or checkerboard.

    Raises:
        InputError: with everything that is wrong in it.
    """
    values = Values(parse(load_bytes(path), str(path)))
    board: CalibrationBoard | None = None
    kind = values.value(("target_type",))
    if kind == "checkerboard":
        columns, rows = _whole(values, "targetCols"), _whole(values, "targetRows")
        across_m, up_m = _number(values, "colSpacingMeters"), _number(values, "rowSpacingMeters")
        if None not in (columns, rows, across_m, up_m):
            board = Checkerboard(columns or 0, rows or 0, (across_m or 0.0, up_m or 0.0))
    elif kind == "aprilgrid":
        columns, rows = _whole(values, "tagCols"), _whole(values, "tagRows")
        side_m, gap = _number(values, "tagSize"), _number(values, "tagSpacing", (0.01, 1.0))
        first = 0 if values.value(("codeOffset",)) is None else _whole(values, "codeOffset", (0, TAGS - 1))
        if None not in (columns, rows, side_m, gap, first):
            board = AprilGrid(columns or 0, rows or 0, side_m or 0.0, gap or 0.0, first or 0)
    elif kind is None:
        values.missing((), "target_type")
    else:
        hint = "known: aprilgrid, checkerboard; grids of circles are found less exactly"
        values.wrong(("target_type",), f"boards of the type {kind!r} are not supported", hint)
    if board is None:
        raise InputError(sorted(values.findings))
    return board


def _whole(values: Values, name: str, bounds: tuple[int, int] = COUNTS) -> int | None:
    value, (low, high) = values.value((name,)), bounds
    if value is None:
        values.missing((), name)
    elif isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        values.wrong((name,), f"{name} is {value!r}", f"a whole number from {low} to {high}")
    else:
        return value
    return None


def _number(values: Values, name: str, bounds: tuple[float, float] = LENGTHS_M) -> float | None:
    value, (low, high) = values.value((name,)), bounds
    if value is None:
        values.missing((), name)
    elif isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        hint = f"a number from {low:g} to {high:g}" + (
            "; tagSpacing is a share of tagSize" if low == 0.01 else ", in metres"
        )
        values.wrong((name,), f"{name} is {value!r}", hint)
    else:
        return float(value)
    return None
