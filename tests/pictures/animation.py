"""Pictures of a terminal: one screenshot, or several in their order as an animated SVG, which keeps a line once while it stays."""

import re
from collections import defaultdict
from html import unescape
from typing import Final, NamedTuple
from xml.sax.saxutils import escape

BRAILLE: Final = re.compile("[\u2800-\u28ff]")
_TEXT: Final = re.compile(
    r'<text class="terminal-\d+-(r\d+)" x="([\d.]+)" y="([\d.]+)" textLength="([\d.]+)"[^>]*>([^<]*)</text>'
)
_RECT: Final = re.compile(r'<rect fill="(#\w+)" x="([\d.]+)" y="([\d.]+)" width="([\d.]+)" height="([\d.]+)"[^>]*/>')
_RULE: Final = re.compile(r"\.terminal-\d+-(r\d+) \{([^}]*)\}")
_SIZE: Final = re.compile(r'viewBox="0 0 ([\d.]+) ([\d.]+)"')
_LINE_PX: Final = 24.4


class Screenshot(NamedTuple):
    """A screenshot, taken apart."""

    width: float
    height: float
    ground: str
    """The colour of most of it."""
    lines: dict[int, str]
    """What is on each line, as SVG without its height."""


class Animation:
    """Screenshots with the times for which each is shown.

    Args:
        title: read aloud for those who do not see it.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._shots: list[tuple[float, Screenshot]] = []
        self._styles: dict[str, str] = {}
        self.length_s = 0.0

    def add(self, screenshot: str, for_s: float) -> None:
        """Adds what `App.export_screenshot` gives."""
        self._shots.append((self.length_s, self._taken_apart(screenshot)))
        self.length_s += for_s

    def _taken_apart(self, svg: str) -> Screenshot:
        size = _SIZE.search(svg)
        assert size is not None
        classes = {
            name: self._styles.setdefault(rule.strip(), f"s{len(self._styles)}") for name, rule in _RULE.findall(svg)
        }
        lines: dict[int, list[str]] = defaultdict(list)
        grounds: dict[tuple[int, str], list[tuple[float, float]]] = defaultdict(list)
        for fill, x, y, width, _ in _RECT.findall(svg):
            spans, begin, end = grounds[round((float(y) - 1.5) / _LINE_PX), fill], float(x), float(x) + float(width)
            if spans and abs(spans[-1][1] - begin) < 1.0:
                begin = spans.pop()[0]
            spans.append((begin, end))
        areas: dict[str, float] = defaultdict(float)
        for (_, fill), spans in grounds.items():
            areas[fill] += sum(end - begin for begin, end in spans)
        ground = max(areas, key=lambda fill: areas[fill])
        for (number, fill), spans in grounds.items():
            if fill == ground:
                continue
            shape = "".join(f"M{_px(begin)} -18.5H{_px(end)}v24.9H{_px(begin)}z" for begin, end in spans)
            lines[number].append(f'<path fill="{fill}" d="{shape}"/>')
        for name, x, y, length, text in _TEXT.findall(svg):
            lines[round((float(y) - 20.0) / _LINE_PX)].append(
                _text(classes[name], float(x), float(length), unescape(text))
            )
        return Screenshot(
            float(size[1]), float(size[2]), ground, {number: "".join(parts) for number, parts in lines.items()}
        )

    def svg(self) -> str:
        """The whole, which begins anew at its end."""
        width, height, ground = self._shots[0][1][:3]
        groups, lengths = [], set[float]()
        for number in sorted({number for _, shot in self._shots for number in shot.lines}):
            for begin_s, end_s, line in self._runs(number):
                shown_s = round(end_s - begin_s, 2)
                moving = ""
                if shown_s < self.length_s:
                    lengths.add(shown_s)
                    begins = " f" if begin_s == 0.0 else ""
                    moving = f' class="a{begins}" style="animation:k{_name(shown_s)} {self.length_s:g}s {begin_s:g}s infinite"'
                groups.append(f'<g transform="translate(0 {20 + _LINE_PX * number:.1f})"{moving}>{line}</g>')
        rules = [f".{name}{{{rule}}}" for rule, name in self._styles.items()]
        frames = [
            f"@keyframes k{_name(each)}{{0%{{visibility:visible}}{100.0 * each / self.length_s:.2f}%,to{{visibility:hidden}}}}"
            for each in sorted(lengths)
        ]
        return "\n".join(
            [
                f'<svg viewBox="0 0 {width:g} {height:g}" xmlns="http://www.w3.org/2000/svg" role="img">',
                f"<title>{escape(self._title)}</title>",
                "<style>text{font:20px Fira Code,DejaVu Sans Mono,monospace;white-space:pre}",
                ".a{visibility:hidden;animation-timing-function:step-end!important}",
                "@media (prefers-reduced-motion:reduce){.a{animation:none!important}.f{visibility:visible}}",
                *rules,
                *frames,
                "</style>",
                f'<rect width="{width:g}" height="{height:g}" rx="8" fill="{ground}" stroke="#888"/>',
                '<circle cx="22" cy="22" r="7" fill="#ff5f57"/><circle cx="44" cy="22" r="7" fill="#febc2e"/><circle cx="66" cy="22" r="7" fill="#28c840"/>',
                '<g transform="translate(9 41)">',
                *groups,
                "</g>",
                "</svg>",
                "",
            ]
        )

    def _runs(self, number: int) -> list[tuple[float, float, str]]:
        """What is on a line from when to when; nothing is left out."""
        runs: list[tuple[float, float, str]] = []
        ends = [begin_s for begin_s, _ in self._shots[1:]] + [self.length_s]
        for (begin_s, shot), end_s in zip(self._shots, ends, strict=True):
            line = shot.lines.get(number, "")
            if runs and runs[-1][2] == line:
                runs[-1] = (runs[-1][0], end_s, line)
            else:
                runs.append((begin_s, end_s, line))
        return [(round(begin_s, 2), round(end_s, 2), line) for begin_s, end_s, line in runs if line]


def _text(style: str, x: float, length: float, text: str) -> str:
    """Text with its length; braille sign by sign, since in many fonts it is wider or narrower than the rest."""
    cell = length / len(text)
    bare = text.strip("\u00a0 ")
    if not bare:
        return ""
    x += cell * text.index(bare)
    if BRAILLE.search(bare):
        signs = [(number, sign) for number, sign in enumerate(bare) if sign not in "\u2800\u00a0 "]
        places = " ".join(_px(x + cell * number) for number, _ in signs)
        return f'<text class="{style}" x="{places}">{escape("".join(sign for _, sign in signs))}</text>'
    return f'<text class="{style}" x="{_px(x)}" textLength="{_px(cell * len(bare))}">{escape(bare)}</text>'


def _px(number: str | float) -> str:
    return f"{float(number):.1f}".removesuffix(".0")


def _name(seconds: float) -> str:
    return f"{seconds:g}".replace(".", "_")
