"""The output folder of a simulated flight."""

import re
from pathlib import Path
from typing import Final

from gloc3.errors import Refused

FILES: Final = (
    "log.mcap",
    "log.tlog",
    "truth.mcap",
    "report.json",
    "path.svg",
    "foxglove-layout.json",
    "mission-converted.yaml",
    "sitl.txt",
    "onboard.txt",
)
"""What flights write, besides pictures."""
PROBE_BYTES: Final = 1 << 18
"""Free space that the folder must have before a flight starts."""

_AUTOPILOT_LOG: Final = re.compile(r"flight_\d{3,}\.(?:ulg|BIN)")
_KEPT: Final = re.compile(r"(requests\.journal|progress\.state|events\.store|memory\.state)\.(\d+|new)")
_PICTURE: Final = re.compile(r"[a-z0-9_]+-\d{5,}\.(?:jpg|png)|poses\.jsonl")


def recreate(folder: Path) -> None:
    """Creates a folder, or removes the files of an earlier flight from it; other files stay.

    Raises:
        Refused: the folder cannot be had.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in FILES:
            (folder / name).unlink(missing_ok=True)
        for path in sorted(folder.iterdir()):
            if _KEPT.fullmatch(path.name) or _AUTOPILOT_LOG.fullmatch(path.name):
                path.unlink()
        images = folder / "images"
        if images.is_dir():
            for path in sorted(images.iterdir()):
                if _PICTURE.fullmatch(path.name):
                    path.unlink()
        probe = folder / "log.mcap"
        probe.write_bytes(bytes(PROBE_BYTES))
        probe.unlink()
    except OSError as error:
        reason = "it is a file" if isinstance(error, FileExistsError) else error.strerror
        raise Refused(f"the folder {folder} cannot be written: {reason}") from error
