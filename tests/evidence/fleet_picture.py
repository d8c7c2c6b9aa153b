"""Tracks of several vehicles from above, as an SVG picture."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from gloc3.messages.frames import Vector3

COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b")
SCALE, EDGE = 6.0, 30.0


def draw_tracks(
    file: Path,
    title: str,
    tracks: Mapping[str, Sequence[tuple[float, Vector3]]],
    areas: Mapping[str, tuple[float, float, float]],
    marks: Mapping[str, Vector3],
) -> None:
    """Writes a picture, north up.

    Args:
        file: the picture.
        title: above it.
        tracks: name to time and place (NED, m).
        areas: name to the south-west corner of a square, north and east, and its size, m.
        marks: text to a place that is marked with a cross.
    """
    places = [place for track in tracks.values() for _, place in track]
    places += [(north + up, east + up, 0.0) for north, east, size in areas.values() for up in (0.0, size)]
    west, south = min(p[1] for p in places) - 4.0, min(p[0] for p in places) - 4.0
    east, north = max(p[1] for p in places) + 4.0, max(p[0] for p in places) + 4.0
    width, height = SCALE * (east - west) + 2 * EDGE, SCALE * (north - south) + 3 * EDGE

    def at(place: Sequence[float]) -> str:
        return f"{EDGE + SCALE * (place[1] - west):.1f},{2 * EDGE + SCALE * (north - place[0]):.1f}"

    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" font-family="sans-serif" font-size="12">',
        '<rect width="100%" height="100%" fill="white"/>',
        f'<text x="{EDGE}" y="20" font-size="14">{escape(title)}</text>',
    ]
    for name, (n, e, size) in areas.items():
        x, y = at((n + size, e)).split(",")
        box = f'width="{SCALE * size:.1f}" height="{SCALE * size:.1f}" fill="#eeeeee"'
        lines.append(
            f'<rect x="{x}" y="{y}" {box}/><text x="{x}" y="{float(y) - 3:.1f}" fill="#777">{escape(name)}</text>'
        )
    for number, (name, track) in enumerate(tracks.items()):
        colour, ways = COLOURS[number % len(COLOURS)], " ".join(at(place) for _, place in track[::5])
        lines.append(f'<polyline points="{ways}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        x, y = at(track[0][1]).split(",")
        lines.append(f'<text x="{x}" y="{float(y) + 16:.1f}" fill="{colour}">{escape(name)}</text>')
    for text, place in marks.items():
        across, down = map(float, at(place).split(","))
        cross = f"M{across - 5:.1f} {down - 5:.1f}l10 10m0 -10l-10 10"
        lines.append(
            f'<path d="{cross}" stroke="black" stroke-width="2"/><text x="{across + 8:.1f}" y="{down + 4:.1f}">{escape(text)}</text>'
        )
    file.write_text("\n".join([*lines, "</svg>"]) + "\n", encoding="utf-8")
