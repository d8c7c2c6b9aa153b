"""Pictures to calibrate from: of a folder, a list of files, a data set or a log, and the boards in them."""

import glob
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from gloc3.errors import Finding, InputError, Refused
from gloc3.messages.vehicle import Image
from gloc3_onboard.algorithms.calibration.boards import BoardView, CalibrationBoard
from gloc3_onboard.sensors.camera_sources.camera import RECORDED, recorded_pictures
from gloc3_onboard.sensors.pictures import load_picture, pictures_in
from gloc3_onboard.sensors.replay import topic_records
from gloc3_onboard.sensors.sources import euroc

LOG: Final = ".mcap"
_LAST_NUMBER: Final = re.compile(r"(\d+)\D*$")
STAMP_DIGITS: Final = 16
"""A name of so many digits is a time in nanoseconds, as in EuRoC's folders."""
MOST_LISTED: Final = 5


class NamedPicture(NamedTuple):
    """A picture that is read when it is needed."""

    name: str
    load: Callable[[], Image]
    t_s: float | None = None
    """Its time, where it has one."""
    number: int | None = None
    """The number in its name, by which pictures of a pair belong together."""


class BoardsFound(NamedTuple):
    """The boards in pictures."""

    size: tuple[int, int]
    """Width and height of the pictures."""
    views: list[BoardView | None]
    """Of each picture; None where it does not show the board."""

    @property
    def seen(self) -> list[BoardView]:
        """The views of the pictures that show the board."""
        return [view for view in self.views if view is not None]


def find_pictures(place: str, sensor: str = "cam0") -> list[NamedPicture]:
    """The pictures of a place, in order.

    Args:
        place: a folder, a pattern such as `data/left*.jpg`, a folder in EuRoC's form, or `log.mcap#camera/front`.
        sensor: which camera of a folder in EuRoC's form, unless the place says so behind `#`.

    Raises:
        InputError: there are none, or they cannot be read.
    """
    name, _, part = place.partition("#")
    path = Path(name)
    if path.suffix == LOG:
        return _logged(path, part)
    if glob.has_magic(name):
        found = sorted(Path(each) for each in glob.glob(name))  # noqa: PTH207 # the pattern may be absolute
        if not found:
            raise _wrong(name, "no file fits this pattern", "put it in quotes, so that the shell leaves it alone")
        return _files(found)
    if not path.is_dir():
        reason = "it is a file, not a folder" if path.exists() else "there is no such folder"
        raise _wrong(name, reason, f"name a folder of pictures, a log ({LOG}), or a source such as v4l2:///dev/video0")
    if (path / "mav0").is_dir() or part:
        records = euroc.camera_records(path, part or sensor, part or sensor)
        return [NamedPicture(f"{part or sensor} at {each.log_s:.6f} s", each.load, each.log_s) for each in records]
    files = pictures_in(path)
    if not files:
        raise _wrong(name, "there are no pictures in this folder", "they end in .png, .jpg, .jpeg or .pgm")
    return _files(files)


def _logged(path: Path, part: str) -> list[NamedPicture]:
    topic = part or "camera/front"
    if topic.startswith(RECORDED):
        records = recorded_pictures(path, topic.partition("/")[2] or "front")
    else:
        records = topic_records(path, topic, Image)
    return [NamedPicture(f"{topic} at {each.log_s:.3f} s", each.load, each.log_s) for each in records]


def _files(paths: Sequence[Path]) -> list[NamedPicture]:
    return [NamedPicture(str(path), partial(load_picture, path, path.stem), *_named(path)) for path in paths]


def _named(path: Path) -> tuple[float | None, int | None]:
    """Time and number that a file's name tells."""
    if path.stem.isdecimal() and len(path.stem) >= STAMP_DIGITS:
        return int(path.stem) * 1e-9, None
    found = _LAST_NUMBER.search(path.stem)
    return None, int(found[1]) if found else None


def find_boards(
    pictures: Sequence[NamedPicture], board: CalibrationBoard, report: Callable[[str], None]
) -> BoardsFound:
    """Looks for the board in all pictures.

    Args:
        pictures: of one camera.
        board: the board.
        report: receives a line about pictures without a board.

    Raises:
        InputError: a picture cannot be read, or has another size than those before.
        Refused: no picture shows the board.
    """
    import numpy as np

    size, first = (0, 0), ""
    views: list[BoardView | None] = []
    for picture in pictures:
        image = picture.load()
        if not image.is_valid or len(image.data) != image.width * image.height or not image.data:
            raise _wrong(picture.name, image.reason or "the picture is not whole", "take it out of the folder")
        if not views:
            size, first = (image.width, image.height), picture.name
        elif size != (image.width, image.height):
            message = f"the picture is {image.width} x {image.height}, and {first} is {size[0]} x {size[1]}"
            raise _wrong(picture.name, message, "calibrate with pictures of one camera at one size")
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)
        views.append(board.view(pixels, picture.name, picture.t_s or 0.0))
    without = [picture.name for picture, view in zip(pictures, views, strict=True) if view is None]
    if len(without) == len(views):
        hint = "a checkerboard is described by its inner corners, one less than squares; the board must be in the picture whole"
        raise Refused(f"none of {len(views)} pictures shows the board, such as {without[0]}: {hint}")
    if without:
        listed = ", ".join(without[:MOST_LISTED]) + (
            f" and {len(without) - MOST_LISTED} more" if without[MOST_LISTED:] else ""
        )
        report(f"{len(without)} of {len(views)} pictures do not show the board whole: {listed}")
    return BoardsFound(size, views)


def paired(
    left: Sequence[NamedPicture], right: Sequence[NamedPicture], within_s: float
) -> list[tuple[NamedPicture, NamedPicture]]:
    """Pictures of two cameras that belong together: by their times, else by the numbers in their names, else in order.

    Raises:
        Refused: they do not fit together; with an example.
    """
    if all(each.t_s is not None for each in (*left, *right)):
        return _paired_by_time(left, right, within_s)
    if all(each.number is not None for each in (*left, *right)):
        others = {each.number: each for each in right}
        pairs = [(each, others[each.number]) for each in left if each.number in others]
        lone = [each.name for each in left if each.number not in others]
        lone += [each.name for each in right if each.number not in {one.number for one in left}]
        if lone:
            raise Refused(
                f"{len(lone)} pictures have no partner, such as {lone[0]}: those of a pair end in the same number "
                "(left01.png and right01.png); take the others out"
            )
        return pairs
    if len(left) != len(right):
        raise Refused(f"{len(left)} left and {len(right)} right pictures: there must be as many, in the same order")
    return list(zip(left, right, strict=True))


def _paired_by_time(
    left: Sequence[NamedPicture], right: Sequence[NamedPicture], within_s: float
) -> list[tuple[NamedPicture, NamedPicture]]:
    pairs, gaps_s = [], []
    for one in left:
        other = min(right, key=lambda each: abs((each.t_s or 0.0) - (one.t_s or 0.0)))
        gaps_s.append(abs((other.t_s or 0.0) - (one.t_s or 0.0)))
        if gaps_s[-1] <= within_s:
            pairs.append((one, other))
    if 2 * len(pairs) < len(left):
        middle_ms = 1e3 * sorted(gaps_s)[len(gaps_s) // 2]
        raise Refused(
            f"the cameras are not synchronised: {len(pairs)} of {len(left)} left pictures have a right one within "
            f"{1e3 * within_s:g} ms, half of them are more than {middle_ms:.1f} ms apart. Trigger both together; or hold the "
            "board still for each picture, and allow more by --within"
        )
    return pairs


def _wrong(file: str, message: str, hint: str = "") -> InputError:
    return InputError([Finding(file=file, message=message, hint=hint)])
