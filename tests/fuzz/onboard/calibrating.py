"""Targets of `gloc3 calibrate`: the files that it reads beside pictures, and the rig file that it writes again."""

import numpy as np
from tests.fuzz.target import as_file, fuzz_target, refuses

from gloc3_onboard.algorithms.calibration.boards import AprilGrid, Checkerboard
from gloc3_onboard.calibrating.board_file import read_board, read_board_file
from gloc3_onboard.calibrating.field_readings import read_readings
from gloc3_onboard.calibration.rig_file import HEAD, read_sections, write_sections


@fuzz_target("gloc3_onboard.calibration", "gloc3.documents")
def rig_file(data: bytes) -> None:
    """A section that is written into any rig file is read again, with all others as they were; or the file is refused."""

    def written() -> None:
        path = as_file(data, "rig.yaml")
        before = read_sections(path)
        section = {"T_cam_imu": [[1.0, 0.0, 0.0, 0.1]], "timeshift_cam_imu": -0.01}
        write_sections(path, {"cam0": section}, drop=("T_cn_cnm1",))
        after = read_sections(path)
        kept = {key: value for key, value in before.get("cam0", {}).items() if key != "T_cn_cnm1"}
        assert repr(sorted(after.pop("cam0").items(), key=repr)) == repr(sorted((kept | section).items(), key=repr))
        before.pop("cam0", None)
        assert repr(after) == repr(before)
        assert path.read_text(encoding="utf-8").startswith(HEAD)

    refuses(written)


@fuzz_target("gloc3_onboard.calibrating.board_file", "gloc3.documents")
def calibration_board(data: bytes) -> None:
    """A board, in a word or in a file, has as many corners as it can have and a size, or is refused."""

    def whole() -> None:
        board = read_board_file(as_file(data, "board.yaml"))
        assert isinstance(board, (Checkerboard, AprilGrid))
        corners = board.points_m if isinstance(board, Checkerboard) else board.corners_m(board.first_id)
        assert len(corners)
        assert np.isfinite(corners).all()

    refuses(whole)
    text = data.decode("utf-8", "replace")
    for word in (text, f"checkerboard:{text}", f"aprilgrid:{text}"):
        if not word.endswith((".yaml", ".yml")):
            refuses(lambda word=word: read_board(word))  # type: ignore[misc]


@fuzz_target("gloc3_onboard.calibrating.field_readings")
def magnetometer_table(data: bytes) -> None:
    """A table of readings is rows of three finite numbers, or is refused with its line."""

    def whole() -> None:
        readings = read_readings(as_file(data, "turn.csv"))
        assert readings.shape[1:] == (3,)
        assert np.isfinite(readings).all()

    refuses(whole)
