"""Opens a laser log of any form that is known."""

from pathlib import Path

from gloc3.errors import Refused
from gloc3_onboard.datasets.breezy import read_breezy
from gloc3_onboard.datasets.carmen import read_carmen, read_gfs
from gloc3_onboard.datasets.laser_log import LaserLog, file_of

_READERS = {".log": read_carmen, ".clf": read_carmen, ".gfs": read_gfs, ".dat": read_breezy}


def read_laser_log(dataset: Path, range_max_m: float | None = None) -> LaserLog:
    """Reads a log, told by its suffix.

    Args:
        dataset: the file, or a folder with one log.
        range_max_m: a range at or past it is nothing seen; None for what is usual for the kind of log.

    Raises:
        Refused: the file, or its kind, is not known.
        InputError: it is damaged.
    """
    path = file_of(dataset)
    if not path.is_file():
        raise Refused(f"there is no file {path}")
    reader = _READERS.get(path.suffix)
    if reader is None:
        raise Refused(f"{path} is no laser log of a known kind: {', '.join(_READERS)}")
    return reader(path) if range_max_m is None else reader(path, range_max_m)
