"""A message as a list of fields, each with the unit from its name."""

from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

import msgspec

from gloc3.cli.counting import counted
from gloc3.messages.units import split_unit

GEO: Final = ("geo", "origin_geo")
LONG: Final = 8
"""More items than this are counted, not shown."""
DEEPEST: Final = 6


class FieldValue(NamedTuple):
    """One value, or a short row of numbers that belong together."""

    path: str
    """Such as `position_ned_m` or `items.clamped`."""
    depth: int
    label: str
    """The last part of the path, without its unit."""
    value: Any
    unit: str
    is_group: bool = False
    """It has no value of its own; its fields follow."""

    @property
    def numbers(self) -> tuple[float, ...]:
        """The value as numbers; empty where it has none."""
        if isinstance(self.value, list | tuple):
            return tuple(float(item) for item in self.value if _is_number(item))
        return (float(self.value),) if _is_number(self.value) else ()


def fields_of(message: Any) -> list[FieldValue]:
    """All fields of a message; a structure is followed by its own fields, one level deeper."""
    plain = msgspec.to_builtins(_named(message), builtin_types=(bytes,), enc_hook=str)
    return list(_walk(plain, "", 0)) if isinstance(plain, dict) else []


def numbers_of(message: Any) -> dict[str, tuple[float, ...]]:
    """The fields that can be plotted, by path; of a message that says that it is not valid, yes and no alone.

    What such a message holds besides, as a range finder's 41 m where there is no echo, would press all else flat.
    """
    is_valid = getattr(message, "is_valid", True)
    return {
        field.path: numbers
        for field in fields_of(message)
        if (numbers := field.numbers) and (is_valid or isinstance(field.value, bool))
    }


def _named(value: Any) -> Any:
    """A structure by the names of its fields, also where it travels without them; a short row of structures is numbered."""
    if isinstance(value, msgspec.Struct):
        return {name: _named(getattr(value, name)) for name in value.__struct_fields__}
    if isinstance(value, list | tuple) and 0 < len(value) <= LONG and isinstance(value[0], msgspec.Struct):
        return {str(number): _named(one) for number, one in enumerate(value, 1)}
    return value


def _walk(values: Mapping[Any, Any], path: str, depth: int) -> Iterator[FieldValue]:
    for name, value in values.items():
        label, unit = split_unit(str(name))
        place = f"{path}.{name}" if path else str(name)
        is_tree = isinstance(value, dict) and value and depth < DEEPEST
        yield FieldValue(place, depth, label, None if is_tree else _short(value), unit, bool(is_tree))
        if is_tree:
            yield from _walk(value, place, depth + 1)


def _short(value: Any) -> Any:
    """A value that has room in a line."""
    if isinstance(value, bytes):
        return f"{len(value):,} bytes"
    if isinstance(value, list | tuple):
        if len(value) > LONG or any(isinstance(item, dict | list | tuple) for item in value):
            return counted(len(value), "item")
        return list(value)
    return value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)
