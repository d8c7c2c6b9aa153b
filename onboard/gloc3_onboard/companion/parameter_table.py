"""Parameters of the onboard computer: its own, and of each component the rate and the settings that are numbers."""

import typing
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache
from typing import Annotated, Any, Final, NamedTuple

import msgspec

from gloc3.component.deployment import ComponentRow
from gloc3.component.settings import Settings, field_docs
from gloc3.mavlink.services.parameter import LONGEST_NAME
from gloc3.messages.envelope import Severity

MOST_HZ: Final = 1000.0
_VOWELS: Final = frozenset("AEIOUY")
_UNITS: Final = {
    "_s": "s",
    "_m": "m",
    "_m_s": "m/s",
    "_m_s2": "m/s/s",
    "_rad": "radians",
    "_rad_s": "rad/s",
    "_deg": "deg",
    "_hz": "Hz",
    "_px": "px",
}


class CompanionParameter(msgspec.Struct, frozen=True, kw_only=True):
    """One parameter; on the wire all are floats, so that every station reads them alike."""

    name: str
    """At most 16 characters."""
    component: str
    """Whose it is; empty for one of the onboard computer itself."""
    setting: str
    """What it is called there; empty for the rate of a component."""
    value: float
    low: float | None = None
    high: float | None = None
    is_whole: bool = False
    text: str = ""
    """For people, with the unit."""

    @property
    def unit(self) -> str:
        """As MAVLink's metadata name it; empty where it has none."""
        fitting = [suffix for suffix in _UNITS if (self.setting or "rate_hz").endswith(suffix)]
        return _UNITS[max(fitting, key=len)] if fitting else ""

    def problem(self, value: float) -> str:
        """What is wrong with a value; empty if nothing is."""
        if self.is_whole and value != int(value):
            return f"{self.name} must be a whole number, not {value:g}"
        if (self.low is not None and value < self.low) or (self.high is not None and value > self.high):
            low, high = ("" if one is None else f"{one:g}" for one in (self.low, self.high))
            return f"{self.name} must be from {low} to {high}, not {value:g}"
        return ""


def rows_of(components: Collection[ComponentRow]) -> list[CompanionParameter]:
    """The parameters of a platform's components, in their order.

    Raises:
        Gloc3Error: a class cannot be loaded.
    """
    names: set[str] = set()
    return [row for component in components for row in _rows_of(component, names)]


def _rows_of(component: ComponentRow, names: set[str]) -> Iterator[CompanionParameter]:
    if component.rate_hz is not None:
        yield CompanionParameter(
            name=short_name(f"{component.name}_rate_hz", names),
            component=component.name,
            setting="",
            value=component.rate_hz,
            low=0.01,
            high=MOST_HZ,
            text="Rate of the periodic cycles, in Hz; changed while the component is working.",
        )
    settings = component.load_class().settings_type
    docs = _docs(settings)
    for field in msgspec.structs.fields(settings):
        plain, low, high = _number(field.type)
        value = component.settings.get(field.name, field.default)
        if plain is None or not isinstance(value, bool | int | float):
            continue
        yield CompanionParameter(
            name=short_name(f"{component.name}_{field.name}", names),
            component=component.name,
            setting=field.name,
            value=float(value),
            low=0.0 if plain is bool else low,
            high=1.0 if plain is bool else high,
            is_whole=plain is not float,
            text=docs.get(field.name, ""),
        )


@cache
def _docs(settings: type[Settings]) -> dict[str, str]:
    """Docstrings of the settings, read from the source, which is slow."""
    return field_docs(settings)


def _number(kind: Any) -> tuple[type | None, float | None, float | None]:
    """The plain type of a setting and its bounds; no type where it is no single number."""
    low = high = None
    if typing.get_origin(kind) is Annotated:
        kind, *metas = typing.get_args(kind)
        for meta in metas:
            if isinstance(meta, msgspec.Meta):
                low, high = meta.ge, meta.le
    return (kind if kind in (bool, int, float) else None), low, high


def short_name(full: str, used: set[str]) -> str:
    """A name of at most 16 characters that is not taken yet, as like the full one as can be; it is taken then."""
    words = full.upper().split("_")
    while len("_".join(words)) > LONGEST_NAME:
        index = max(range(len(words)), key=lambda at: len(words[at]))
        if len(words[index]) == 1:
            words.pop()
        else:
            words[index] = _shorter(words[index])
    name = "_".join(words)
    number = 1
    while name in used:
        number += 1
        name = f"{'_'.join(words)[: LONGEST_NAME - len(str(number))]}{number}"
    used.add(name)
    return name


def _shorter(word: str) -> str:
    """Without its last vowel, but for the first letter, or without its last letter."""
    at = next((at for at in range(len(word) - 1, 0, -1) if word[at] in _VOWELS), len(word) - 1)
    return word[:at] + word[at + 1 :]


def setting_value(row: CompanionParameter, value: float, kinds: Mapping[str, Any]) -> Any:
    """A component's setting for a value from the wire."""
    plain = _number(kinds[row.setting])[0]
    return bool(value) if plain is bool else int(value) if plain is int else exact(value)


def exact(value: float) -> float:
    """Shortest decimal of a 32-bit float: 0.1 and not 0.10000000149."""
    return float(f"{value:.7g}")


class OwnParameter(NamedTuple):
    """A parameter of the onboard computer itself."""

    row: CompanionParameter
    apply: Callable[[float], None]
    """Takes a new value."""


def own_parameters(report: Callable[[Severity], None], allow: Callable[[bool], None]) -> list[OwnParameter]:
    """Own parameters: least severity of events sent as STATUSTEXT, and write access over MAVLink FTP.

    Args:
        report: called with the least severity.
        allow: called with whether files may be written.
    """
    severity = CompanionParameter(
        name="TEXT_SEVERITY",
        component="",
        setting="text_severity",
        value=float(Severity.WARNING),
        low=0.0,
        high=float(Severity.DEBUG),
        is_whole=True,
        text="Component events of at least this severity are sent as STATUSTEXT: 3 error, 4 warning, 6 information.",
    )
    writing = CompanionParameter(
        name="FTP_WRITE",
        component="",
        setting="ftp_write",
        value=1.0,
        low=0.0,
        high=1.0,
        is_whole=True,
        text="Whether files of missions can be written over MAVLink FTP.",
    )
    return [
        OwnParameter(severity, lambda value: report(Severity(int(value)))),
        OwnParameter(writing, lambda value: allow(value == 1.0)),
    ]
