"""Guided calibration from live pictures: still views with something new are kept, and the next one is advised."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.onboard.algorithms.calibration.rendered import CAMERA, CHECKERBOARD, BoardRenderer
from tests.onboard.calibrating.picture_sets import BOARD, pair_folder

from gloc3.cli.program import run
from gloc3.errors import InputError
from gloc3.messages.vehicle import Image
from gloc3_onboard.algorithms.calibration.boards import CalibrationBoard, Floats, Pixels
from gloc3_onboard.calibrating import live
from gloc3_onboard.calibrating.live import PictureGuide
from gloc3_onboard.calibration.rig_file import read_sections


class Pretended(CalibrationBoard):
    """A board that is seen where the picture's first bytes say."""

    def __init__(self, places: list[Floats]) -> None:
        self.places = places

    def find(self, pixels: Pixels) -> tuple[Floats, Floats] | None:
        number = int(pixels[0, 0])
        return None if number >= len(self.places) else (CHECKERBOARD.points_m, self.places[number])


def image(number: int, width: int = 480) -> Image:
    return Image(camera="front", width=width, height=360, data=bytes([number]) + bytes(width * 360 - 1))


def places(count: int) -> list[Floats]:
    from gloc3_onboard.algorithms.calibration.bundle import project

    own = np.array([*CAMERA.focal_px, *CAMERA.center_px, *CAMERA.distortion])
    poses = BoardRenderer(CAMERA, CHECKERBOARD).poses(count, seed=3)
    return [project(CAMERA.lens, CHECKERBOARD.points_m, pose, own)[0] for pose in poses]


def test_views_are_kept_when_the_board_is_still_and_shows_something_new(capsys: pytest.CaptureFixture[str]) -> None:
    guide = PictureGuide(Pretended(places(3)))
    for t_s, number in enumerate((0, 1, 1, 1, 9, 2, 2, 1, 1)):
        guide.receive([image(number)], float(t_s))
    (found,) = guide.found()
    assert [view.t_s for view in found.seen] == [2.0, 6.0], "moving boards, and the same view again, are left out"
    said = capsys.readouterr().err
    assert said.count("next: hold the board in the ") == 2
    assert "pictures  2" in said


def test_it_ends_when_enough_has_been_shown() -> None:
    shown = places(30)
    guide = PictureGuide(Pretended(shown))
    count = 0
    while not guide.is_done and count < len(shown):
        guide.receive([image(count)], 2.0 * count)
        guide.receive([image(count)], 2.0 * count + 1.0)
        count += 1
    assert guide.is_done
    assert len(guide.found()[0].seen) >= live.ENOUGH


def test_another_size_is_refused() -> None:
    guide = PictureGuide(Pretended(places(1)))
    guide.receive([image(0)], 0.0)
    with pytest.raises(InputError, match="front: the picture is 640 x 360, and those before 480 x 360"):
        guide.receive([image(0, 640)], 1.0)


@pytest.mark.sockets
def test_a_pair_of_live_sources_is_calibrated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(live, "SILENT_S", 2.0)
    for side in ("left", "right"):
        for number in range(8):
            for again in range(3):
                shutil.copy(pair_folder() / f"{side}{number + 1:02}.png", f"{side}{3 * number + again:03}.png")
    urls = [f"video://{side}%03d.png?rate_hz=5" for side in ("left", "right")]
    code = run(["calibrate", "stereo", *urls, "--board", BOARD, "--within", "0.09", "--rig", "rig.yaml", "--force"])
    said = capsys.readouterr().err
    assert code == 0, said
    assert "next: " in said
    assert read_sections(Path("rig.yaml"))["cam1"]["T_cn_cnm1"][0][3] == pytest.approx(-0.07, abs=3e-3)
