"""Where the data of the tests lie: our own, and those of other people, which tests with the mark `outside` need."""

import os
from pathlib import Path
from typing import Final

OWN: Final = Path(__file__).parent / "data"
OUTSIDE: Final = Path(__file__).parents[2] / "shared" / "data"
"""Beside the repository, and not in it: captured links, laser logs, mission files and pictures."""
LINKS: Final = OUTSIDE / "links"
LASER_LOGS: Final = OUTSIDE / "lidar"
MISSIONS: Final = OUTSIDE / "missions"
PICTURES: Final = OUTSIDE / "images"
PLANS: Final = Path(os.environ.get("GLOC3_PLANS", OUTSIDE / "plans"))
"""Public plans of other programs, many more of them; by the environment, because they are of no use for tests."""
RELATIONS: Final = Path(os.environ.get("GLOC3_RELATIONS", OUTSIDE / "lidar" / "relations"))
"""Public laser logs with published relations, for a page of evidence; by the environment, because they are too large."""
CALIBRATIONS: Final = Path(os.environ.get("GLOC3_CALIBRATIONS", OUTSIDE / "calibration"))
"""Public pictures of calibration boards, with published results; for the evidence only."""
STEREO: Final = Path(os.environ.get("GLOC3_STEREO", OUTSIDE / "stereo"))
"""Public stereo pictures with their truth, a folder a set; by the environment, because they are too large."""
REASON: Final = "needs data from outside the repository, and ../shared/data is not here"
