"""Boards in Kalibr's files and in a word."""

from pathlib import Path

import pytest

from gloc3.errors import InputError
from gloc3_onboard.algorithms.calibration.boards import AprilGrid, Checkerboard
from gloc3_onboard.calibrating.board_file import read_board

APRIL = "target_type: 'aprilgrid'\ntagCols: 6\ntagRows: 5\ntagSize: 0.088\ntagSpacing: 0.3\ncodeOffset: 12\n"
CHECKERS = "target_type: checkerboard\ntargetCols: 7\ntargetRows: 6\nrowSpacingMeters: 0.06\ncolSpacingMeters: 0.05\n"


def read(tmp_path: Path, text: str) -> object:
    (tmp_path / "board.yaml").write_text(text)
    return read_board(str(tmp_path / "board.yaml"))


def test_a_grid_of_kalibr_is_read(tmp_path: Path) -> None:
    board = read(tmp_path, APRIL)
    assert isinstance(board, AprilGrid)
    # Tag 0 is at the lower left; the seventh of six columns begins the second row.
    assert board.corners_m(12).tolist() == [[0, 0, 0], [0.088, 0, 0], [0.088, 0.088, 0], [0, 0.088, 0]]
    assert board.corners_m(18)[0] == pytest.approx([0.0, 0.088 * 1.3, 0.0])


def test_a_checkerboard_of_kalibr_is_read(tmp_path: Path) -> None:
    board = read(tmp_path, CHECKERS)
    assert isinstance(board, Checkerboard)
    assert board.points_m[-1] == pytest.approx([6 * 0.05, 5 * 0.06, 0.0])


def test_a_word_describes_the_same() -> None:
    board = read_board("aprilgrid:6x5:0.088:0.3")
    assert isinstance(board, AprilGrid)
    assert (board.columns, board.rows, board.tag_m, board.spacing) == (6, 5, 0.088, 0.3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            APRIL.replace("aprilgrid", "circlegrid"),
            "board.yaml:1:14: boards of the type 'circlegrid' are not supported",
        ),
        (APRIL.replace("tagSize: 0.088\n", ""), "'tagSize' is missing"),
        (APRIL.replace("0.088", "88"), "board.yaml:4:10: tagSize is 88 (a number from 0.001 to 5, in metres)"),
        (APRIL.replace("0.3", "0.0"), "tagSpacing is a share of tagSize"),
        (CHECKERS.replace("7", "1"), "board.yaml:2:13: targetCols is 1 (a whole number from 2 to 60)"),
        (APRIL.replace("12", "'12'"), "board.yaml:6:13: codeOffset is '12' (a whole number from 0 to 586)"),
        (APRIL.replace("12", "-1"), "codeOffset is -1"),
        ("tagCols: 6\n", "'target_type' is missing"),
        ("[1, 2]\n", "'target_type' is missing"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as found:
        read(tmp_path, text)
    assert said in str(found.value)
