"""`docs/pictures/rooms.svg`: the four packages, their rooms with the number of modules in each, and who imports whom."""

import ast
from collections import Counter
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Final, NamedTuple

from tests.house.measure import PACKAGES, Module, imports_of, read_modules

ROOT: Final = Path(__file__).parents[2]
PICTURE: Final = ROOT / "docs" / "pictures" / "rooms.svg"
FLOOR: Final = "gloc3"
ABOVE: Final = ("gloc3_onboard", "gloc3_sitl", "gloc3_groundstation")
"""Side by side; the simulation in the middle, because it alone may import its neighbours."""
COLOURS: Final = {
    "gloc3": "#2fb98f",
    "gloc3_onboard": "#56b4e9",
    "gloc3_sitl": "#e7a33d",
    "gloc3_groundstation": "#c98bdb",
}
CHIP_WIDTH, CHIP_HEIGHT, GAP, HEAD, BETWEEN = 146, 26, 6, 34, 70
COLUMNS: Final = 2
WIDE_COLUMNS: Final = 7
"""Of the floor, as wide as the three packages above it."""


class Box(NamedTuple):
    """A package on the picture."""

    x: int
    y: int
    columns: int
    rooms: Mapping[str, int]
    """Modules by room of the first level."""

    @property
    def width(self) -> int:
        """In pixels."""
        return self.columns * (CHIP_WIDTH + GAP) + GAP

    @property
    def height(self) -> int:
        """In pixels."""
        return HEAD + -(-len(self.rooms) // self.columns) * (CHIP_HEIGHT + GAP) + GAP


def svg(root: Path = ROOT) -> str:
    """The picture for a tree."""
    modules = read_modules(root)
    boxes, x = {}, 0
    for name in ABOVE:
        boxes[name] = Box(x, 0, COLUMNS, _rooms(name, modules))
        x += boxes[name].width + BETWEEN
    bottom = max(box.height for box in boxes.values()) + BETWEEN
    boxes[FLOOR] = Box(0, bottom, WIDE_COLUMNS, _rooms(FLOOR, modules))
    width, height = x - BETWEEN, bottom + boxes[FLOOR].height
    parts = [
        line
        for name, box in boxes.items()
        for line in _drawn(name, box, width if name == FLOOR else box.width, modules)
    ]
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="-8 -8 {width + 16} {height + 16}" font-family="sans-serif" font-size="13">',
            "<title>The rooms of GLOC3</title>",
            '<defs><marker id="tip" markerWidth="8" markerHeight="8" refX="6" refY="3" orient="auto"><path d="M0 0L7 3L0 6z" fill="#667"/></marker></defs>',
            f'<rect x="-8" y="-8" width="{width + 16}" height="{height + 16}" fill="#fff"/>',
            *parts,
            *_arrows(boxes, modules),
            "</svg>",
            "",
        ]
    )


def _rooms(package: str, modules: Mapping[str, Module]) -> Mapping[str, int]:
    """The modules below each room of the first level."""
    count = Counter(
        name.split(".")[1]
        for name, module in modules.items()
        if name.startswith(f"{package}.") and not module.is_package
    )
    return {
        room: count[room]
        for room in sorted(count)
        if f"{package}.{room}" in modules and modules[f"{package}.{room}"].is_package
    }


def _drawn(package: str, box: Box, width: int, modules: Mapping[str, Module]) -> list[str]:
    colour = COLOURS[package]
    lines = [
        f'<rect x="{box.x}" y="{box.y}" width="{width}" height="{box.height}" rx="6" fill="{colour}" fill-opacity="0.12" stroke="{colour}"/>',
        f'<text x="{box.x + 10}" y="{box.y + 22}"><tspan font-weight="bold">{package}</tspan>  in {PACKAGES[package]}/</text>',
    ]
    for number, (room, count) in enumerate(box.rooms.items()):
        x = box.x + GAP + number % box.columns * (CHIP_WIDTH + GAP)
        y = box.y + HEAD + number // box.columns * (CHIP_HEIGHT + GAP)
        about = (ast.get_docstring(modules[f"{package}.{room}"].tree) or "").partition("\n")[0]
        lines += [
            f"<g><title>{escape(about)}</title>",
            f'<rect x="{x}" y="{y}" width="{CHIP_WIDTH}" height="{CHIP_HEIGHT}" rx="4" fill="#fff" stroke="{colour}"/>',
            f'<text x="{x + 8}" y="{y + 18}">{room}</text>',
            f'<text x="{x + CHIP_WIDTH - 8}" y="{y + 18}" text-anchor="end" fill="#667">{count}</text></g>',
        ]
    return lines


def _arrows(boxes: Mapping[str, Box], modules: Mapping[str, Module]) -> list[str]:
    """One from each package to each that a module of it imports."""
    pairs = {
        (name.partition(".")[0], other.partition(".")[0])
        for name, module in modules.items()
        for other in imports_of(module, modules)
    }
    lines = []
    for importer, imported in sorted(pairs):
        one, two = boxes[importer], boxes[imported]
        if importer == imported:
            continue
        if imported == FLOOR:
            x = one.x + one.width // 2
            path = f"M{x} {one.y + one.height}V{two.y}"
        else:
            begin, end = (one.x + one.width, two.x) if one.x < two.x else (one.x, two.x + two.width)
            path = f"M{begin} {HEAD + 40}H{end}"
        lines.append(f'<path d="{path}" stroke="#667" stroke-width="1.5" marker-end="url(#tip)"/>')
    return lines
