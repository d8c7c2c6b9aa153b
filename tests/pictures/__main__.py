"""`make pictures`: the pictures in the docs and the README; `NAME=demo` makes one set of them. Look at them."""

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from tests.pictures import commands, station

FOLDER: Final = Path(__file__).parents[2] / "docs" / "pictures"
LARGEST_BYTES: Final = 300_000
Make = Callable[[Path, Path], None]
"""Makes pictures in the first folder; the second one is for what is not kept."""
SETS: Final[Mapping[str, tuple[tuple[str, ...], Make]]] = {
    "demo": (("demo.svg",), station.demo_picture),
    "flight": (("daylight.svg", "health.svg", "map.svg", "mission.svg", "overview.svg"), station.flight_pictures),
    "checks": (("checks.svg",), station.checks_picture),
    "silence": (("silence.svg",), station.silence_picture),
    "missions": (("mission-inspection.svg",), commands.missions),
    "inspection": (("report-contact.jpg", "report-coverage.svg"), commands.inspection),
    "components": (("components.svg",), commands.components),
    "found": (("proof-found.svg",), commands.found),
}
"""The pictures of each set, and what makes them."""


def main(names: list[str]) -> int:
    """Makes all sets, or those that are named."""
    if unknown := sorted(set(names) - set(SETS)):
        sys.exit(f"no pictures called {', '.join(unknown)}; there are {', '.join(SETS)}")
    for name in names or list(SETS):
        with TemporaryDirectory() as scratch:
            files, make = SETS[name]
            make(FOLDER, Path(scratch))
        sizes = {file: (FOLDER / file).stat().st_size for file in files}
        sys.stdout.write(f"{name}: {', '.join(f'{file} {size / 1e3:.0f} kB' for file, size in sizes.items())}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
