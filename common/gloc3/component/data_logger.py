"""The data logger of a component (paper §IV-A): selected items of its internal state, at the end of every cycle."""

from collections.abc import Sequence
from typing import Any, Final

import msgspec

from gloc3.component.component import Component
from gloc3.component.error_handler import CountedError, one_line
from gloc3.component.workers import guard
from gloc3.errors import Refused, nearest

_PLAIN: Final = frozenset((float, int, str, bool, type(None)))


class DataLogger:
    """Knows which items are recorded, and reads them."""

    def __init__(self, component: type[Component[Any]], items: Sequence[str]) -> None:
        self._loggable = component.loggable
        self._chosen = self._check(items)
        self.items: tuple[str, ...] = self._chosen
        """What is recorded; empty while it is switched off."""

    def choose(self, items: Sequence[str] | None, is_enabled: bool) -> list[str]:
        """Changes which items are recorded (None: unchanged) and whether; returns the items now recorded.

        Raises:
            Refused: an item is not among the component's loggable ones; nothing is changed.
        """
        if items is not None:
            self._chosen = self._check(items)
        self.items = self._chosen if is_enabled else ()
        return list(self.items)

    def _check(self, items: Sequence[str]) -> tuple[str, ...]:
        for item in items:
            if item not in self._loggable:
                raise Refused(f"{item!r} cannot be logged; {nearest(item, self._loggable)}")
        return tuple(dict.fromkeys(items))


def read_items(component: Component[Any], items: Sequence[str], failures: list[CountedError]) -> dict[str, Any]:
    """The items' values as plain data, a snapshot; one that cannot be read is None and adds to the failures."""
    read, _ = guard(_read_all, component, items)
    if read is not None:
        return read
    values: dict[str, Any] = {}
    for item in items:  # one by one, to find out which of them it is
        values[item], error = guard(_read, component, item)
        if error is not None:
            failures.append(CountedError(f"log item {item}", error))
    return values


def _read_all(component: Component[Any], items: Sequence[str]) -> dict[str, Any]:
    return {item: _read(component, item) for item in items}


def _read(component: Component[Any], item: str) -> Any:
    value = getattr(component, item)
    return value if type(value) in _PLAIN else msgspec.to_builtins(value, enc_hook=_plain, str_keys=True)


def _plain(value: Any) -> Any:
    """Arrays and numbers of numerical libraries as lists and numbers, anything else as its short description."""
    as_list = getattr(value, "tolist", None)
    return as_list() if callable(as_list) else one_line(repr(value))
