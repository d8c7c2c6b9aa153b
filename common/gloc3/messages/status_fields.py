"""Fields of a component's status that reach the stations: one row each defines how it is measured, packed and shown.

A new field is one more row here, at the end, and a component whose `status_values` has a value of that name.
"""

from collections.abc import Callable
from math import isfinite
from typing import Final, Protocol

import msgspec

from gloc3.messages.envelope import ComponentStatus

BYTE: Final = 0xFF
WORD: Final = 0xFFFF
SLOW_PERCENT: Final = 80
"""A component that cycles slower than this share of its rate deserves attention."""
BUSY_PERCENT: Final = 80


class ShownComponent(Protocol):
    """Properties that a field's text may depend on, beside its value."""

    @property
    def nominal_rate_hz(self) -> float:
        """0 where it only works when something happens."""

    @property
    def is_triggered(self) -> bool:
        """Whether it reaches its rate only while its input comes."""

    @property
    def has_rate(self) -> bool:
        """Whether it has a nominal rate, and its actual rate is known."""

    @property
    def is_well(self) -> bool:
        """Whether it works, or is on standby for another."""


class StatusField(msgspec.Struct, frozen=True, kw_only=True):
    """One field of a component's status."""

    name: str
    title: str
    """Of its column."""
    width: int
    """Characters of the column."""
    measure: Callable[[ComponentStatus], int | None] | None = None
    """The value in a status; by default the component's own, rounded."""
    show: Callable[[int, ShownComponent], str] = lambda value, _: str(value)
    is_notable: Callable[[int, ShownComponent], bool] = lambda _value, _component: False
    """Whether a value deserves attention."""
    most: int = 32767
    """The largest value; the least is its negative, and 0 for the first fields."""

    def value(self, status: ComponentStatus) -> int | None:
        """The value in a status; None where the component does not report it."""
        if self.measure is not None:
            return self.measure(status)
        value = status.values.get(self.name)
        if value is None or not isfinite(value):
            return None
        return max(-self.most, min(self.most, round(value)))


def _rate_percent(status: ComponentStatus) -> int:
    return min(BYTE, round(100.0 * status.rate_hz / status.nominal_rate_hz)) if status.nominal_rate_hz > 0.0 else 0


def _load_percent(status: ComponentStatus) -> int:
    return min(BYTE, round(100.0 * status.cycle_mean_s * status.nominal_rate_hz)) if status.nominal_rate_hz > 0.0 else 0


def _rate(value: int, component: ShownComponent) -> str:
    if not component.has_rate:
        return "triggered" if component.is_triggered else ""
    return f"{component.nominal_rate_hz * value / 100.0:.1f}/{component.nominal_rate_hz:g} Hz"


ROW_FIELDS: Final = (
    StatusField(
        name="rate_percent",
        title="rate",
        width=13,
        measure=_rate_percent,
        show=_rate,
        is_notable=lambda value, component: component.is_well and not component.is_triggered and value < SLOW_PERCENT,
        most=BYTE,
    ),
    StatusField(
        name="load_percent",
        title="load",
        width=5,
        measure=_load_percent,
        show=lambda value, component: f"{value} %" if component.has_rate else "",
        is_notable=lambda value, _: value >= BUSY_PERCENT,
        most=BYTE,
    ),
    StatusField(
        name="overruns",
        title="late",
        width=5,
        measure=lambda status: status.overruns & WORD,
        show=lambda value, _: str(value) if value else "·",
        most=WORD,
    ),
    StatusField(
        name="errors",
        title="errors",
        width=6,
        measure=lambda status: status.errors & WORD,
        show=lambda value, _: str(value) if value else "·",
        is_notable=lambda value, _: value > 0,
        most=WORD,
    ),
)
"""The values of a `ComponentLine`, in its order: they share a row of the summary, which peers of every version read."""

COLUMN_FIELDS: Final[tuple[StatusField, ...]] = ()
"""The fields that were added since. Each has a column of the summary to itself, so that a peer without it reads the rest."""

STATUS_FIELDS: Final = (*ROW_FIELDS, *COLUMN_FIELDS)
