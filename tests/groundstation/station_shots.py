"""Pictures of every screen and dialogue, to be looked at.

`python -m tests.groundstation.station_shots OUT [GROUP…] [--theme=…] [--size=250x70]`: groups are those of `poses`, such
as `mission`; without one, all. Without a size, the three that every screen is made for.
"""

import asyncio
import sys
from pathlib import Path
from typing import get_args

from gloc3_groundstation.store.configuration import ThemeName

from .poses import poses, problems
from .station_scene import shoot

SIZES = ((80, 24), (120, 40), (200, 60))


async def shots(out: Path, size: tuple[int, int], theme: ThemeName, wanted: tuple[str, ...]) -> list[str]:
    """One size in one theme; what a program finds wrong with them."""
    found = []
    tag = f"{size[0]}x{size[1]}" + (f"_{theme}" if theme != "dark" else "")
    async for name, here in poses(size, theme, wanted):
        found += [f"{tag}_{name}: {each}" for each in await problems(here)]
        shoot(here.app, out / f"{tag}_{name}")
    return found


def main(arguments: list[str]) -> None:
    """Makes them."""
    out = Path(arguments[0])
    out.mkdir(parents=True, exist_ok=True)
    wanted = tuple(each for each in arguments[1:] if not each.startswith("--"))
    themes = [name for name in get_args(ThemeName) if f"--theme={name}" in arguments] or ["dark"]
    named = [each.removeprefix("--size=").split("x") for each in arguments if each.startswith("--size=")]
    for size in [(int(width), int(height)) for width, height in named] or SIZES:
        for theme in themes:
            for finding in asyncio.run(shots(out, size, theme, wanted)):
                sys.stdout.write(finding + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
