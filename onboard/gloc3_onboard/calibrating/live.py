"""Guided calibration from live pictures: views are kept when they show something new, and the next one is advised."""

import asyncio
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from gloc3.camera.model import Lens
from gloc3.cli.narration import narrate
from gloc3.clock import passed
from gloc3.errors import Finding, InputError
from gloc3.messages.vehicle import Image
from gloc3_onboard.algorithms.calibration.boards import BoardView, CalibrationBoard
from gloc3_onboard.algorithms.calibration.coverage import BoardCoverage
from gloc3_onboard.algorithms.calibration.lens_fit import board_pose, model_of
from gloc3_onboard.calibrating.drawing import coverage_lines
from gloc3_onboard.calibrating.pictures import BoardsFound
from gloc3_onboard.sensors.registry import SourceHost, make_sources

ENOUGH: Final = 15
"""Views that are taken at least."""
MOST: Final = 60
STILL: Final = 0.004
"""Share of the picture's width by which the board may move from one picture to the next."""
SILENT_S: Final = 5.0
"""Without a new picture for so long, the source has ended."""
POLL_S: Final = 0.01
ROUGH_FOCAL: Final = 0.8
"""Focal length by which views are judged before there is a calibration, as a share of the width."""


def is_live(place: str) -> bool:
    """Whether pictures come from a source, and not from files."""
    return "://" in place


def watch(urls: Mapping[str, str], device: str, board: CalibrationBoard) -> list[BoardsFound]:
    """Takes views from a live camera or stereo camera until enough has been shown, the source ends, or Ctrl-C.

    Args:
        urls: sources by device, as in a platform file.
        device: the one that is read: a camera or a stereo camera.
        board: the board.

    Returns:
        One for each camera of the device.

    Raises:
        Gloc3Error: a source cannot be opened.
    """
    guide = PictureGuide(board)
    narrate("hold the board into the picture, and still for a moment at each place; Ctrl-C ends")
    with suppress(KeyboardInterrupt):
        asyncio.run(_watch(urls, device, guide))
    return guide.found()


async def _watch(urls: Mapping[str, str], device: str, guide: "PictureGuide") -> None:
    loop = asyncio.get_running_loop()
    source = make_sources(urls, SourceHost(loop, Path.cwd(), lambda _: None))[device]
    source.open()
    try:
        last_s, new_s = float("-inf"), loop.time()
        while not guide.is_done and loop.time() - new_s < SILENT_S:
            taken = _taken(source)
            if taken is not None and taken[0] > last_s:
                last_s, new_s = taken[0], loop.time()
                guide.receive(taken[1], last_s)
            await passed(POLL_S)
    finally:
        source.close()


def _taken(source: Any) -> tuple[float, list[Image]] | None:
    """The latest pictures of a camera or a stereo camera, with their time."""
    if hasattr(source, "pair"):
        pair = source.pair()
        return None if pair is None else (pair.t_s, [pair.left, pair.right])
    frame = source.frame()
    return None if frame is None else (frame.t_s, [frame.image])


class PictureGuide:
    """Keeps views that show something new."""

    def __init__(self, board: CalibrationBoard) -> None:
        self._board = board
        self._coverages: list[BoardCoverage] = []
        self._kept: list[list[BoardView]] = []
        self._before: list[BoardView | None] = []

    @property
    def is_done(self) -> bool:
        """Whether enough has been shown to all cameras."""
        count = len(self._kept[0]) if self._kept else 0
        return count >= MOST or (count >= ENOUGH and not self._advice())

    def found(self) -> list[BoardsFound]:
        """The views of each camera."""
        return [
            BoardsFound(coverage.size, list(views)) for coverage, views in zip(self._coverages, self._kept, strict=True)
        ]

    def receive(self, images: list[Image], t_s: float) -> None:
        """Looks at the pictures of one moment."""
        if not self._coverages:
            self._coverages = [BoardCoverage((image.width, image.height)) for image in images]
            self._kept = [[] for _ in images]
            self._before = [None for _ in images]
        views = [self._view(image, coverage, t_s) for image, coverage in zip(images, self._coverages, strict=True)]
        is_still = all(
            view is not None and before is not None and _is_still(view, before, coverage.size[0])
            for view, before, coverage in zip(views, self._before, self._coverages, strict=True)
        )
        self._before = views
        if not is_still:
            return
        whole = [view for view in views if view is not None]
        poses = [board_pose(_rough(coverage.size), view) for view, coverage in zip(whole, self._coverages, strict=True)]
        seen = list(zip(whole, poses, self._coverages, self._kept, strict=True))
        if any(coverage.is_new(view, pose) for view, pose, coverage, _ in seen):
            for view, pose, coverage, kept in seen:
                coverage.add(view, pose)
                kept.append(view)
            self._show()

    def _view(self, image: Image, coverage: BoardCoverage, t_s: float) -> BoardView | None:
        if (image.width, image.height) != coverage.size:
            message = f"the picture is {image.width} x {image.height}, and those before {coverage.size[0]} x {coverage.size[1]}"
            raise InputError([Finding(file=image.camera, message=message, hint="set the camera to one size")])
        if len(image.data) != image.width * image.height:
            return None
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)
        return self._board.view(pixels, f"{image.camera} at {t_s:.3f} s", t_s)

    def _advice(self) -> str:
        return next((advice for coverage in self._coverages if (advice := coverage.advice())), "")

    def _show(self) -> None:
        advice = self._advice() or "show the board from other sides and distances"
        narrate(
            "\n".join([*(line for coverage in self._coverages for line in coverage_lines(coverage)), f"next: {advice}"])
        )


def _is_still(view: BoardView, before: BoardView, width: int) -> bool:
    if view.points_m.shape != before.points_m.shape or not np.array_equal(view.points_m, before.points_m):
        return False
    return float(np.abs(view.pixels - before.pixels).mean()) < STILL * width


def _rough(size: tuple[int, int]) -> Any:
    own = np.array([ROUGH_FOCAL * size[0], ROUGH_FOCAL * size[0], 0.5 * size[0], 0.5 * size[1]])
    return model_of(own, size, Lens.PINHOLE)
