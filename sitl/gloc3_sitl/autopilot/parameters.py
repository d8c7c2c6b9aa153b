"""Parameters: rows of data with real names, types and bounds; a store that keeps values and applies them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from math import isfinite
from typing import Any, Final

from gloc3.errors import Misuse, Refused, nearest
from gloc3_sitl.autopilot.tuning import Tuning


class ParameterKind(IntEnum):
    """A parameter's type, numbered as MAV_PARAM_TYPE."""

    INT8 = 2
    INT16 = 4
    INT32 = 6
    REAL32 = 9


Derive = Callable[[Callable[[str], float], Tuning], None]
"""Updates tuning that depends on several parameters at once."""

_RANGES: Final = {
    ParameterKind.INT8: (-128, 127),
    ParameterKind.INT16: (-32768, 32767),
    ParameterKind.INT32: (-(2**31), 2**31 - 1),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotParameter:
    """One parameter: name, type, bounds and the tuning figure that it sets."""

    name: str
    kind: ParameterKind
    default: float
    minimum: float
    maximum: float
    what: str
    """What it is for, in a few words."""
    sets: str = ""
    """Field of `Tuning` that follows the parameter, such as `gains.position_xy`; empty for parameters read by name."""
    scale: float = 1.0
    """Figure in `Tuning` per unit of the parameter."""
    means: Mapping[int, Any] | None = None
    """Figure in `Tuning` for each value, for parameters that choose; other values count as the default."""


def real(
    name: str, default: float, minimum: float, maximum: float, what: str, sets: str = "", scale: float = 1.0
) -> AutopilotParameter:
    """A row of a floating-point parameter."""
    return AutopilotParameter(
        name=name,
        kind=ParameterKind.REAL32,
        default=default,
        minimum=minimum,
        maximum=maximum,
        what=what,
        sets=sets,
        scale=scale,
    )


def whole(
    name: str,
    default: int,
    minimum: int,
    maximum: int,
    what: str,
    sets: str = "",
    means: Mapping[int, Any] | None = None,
    kind: ParameterKind = ParameterKind.INT32,
    scale: float = 1.0,
) -> AutopilotParameter:
    """A row of an integer parameter."""
    return AutopilotParameter(
        name=name,
        kind=kind,
        default=default,
        minimum=minimum,
        maximum=maximum,
        what=what,
        sets=sets,
        means=means,
        scale=scale,
    )


class ParameterStore:
    """The values of a style's parameters; a change is checked, kept and applied to the tuning at once."""

    def __init__(self, rows: Sequence[AutopilotParameter], tuning: Tuning, derive: Derive | None = None) -> None:
        self.rows: Final = {row.name: row for row in sorted(rows, key=lambda row: row.name)}
        if len(self.rows) != len(rows):
            raise Misuse("a parameter occurs twice in the table")
        self.tuning: Final = tuning
        self.on_change: list[Callable[[str, float], None]] = []
        """Called with name and value after each change."""
        self._values: dict[str, float] = {}
        for row in self.rows.values():
            self._values[row.name] = row.default
            self._apply(row, row.default)
        self._derive = derive
        if derive is not None:
            derive(self.__getitem__, tuning)

    def __getitem__(self, name: str) -> float:
        try:
            return self._values[name]
        except KeyError:
            raise Misuse(f"no parameter {name!r}: {nearest(name, list(self.rows))}") from None

    def __contains__(self, name: str) -> bool:
        return name in self.rows

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[str]:
        return iter(self.rows)

    def set(self, name: str, value: float) -> None:
        """Sets a value.

        Raises:
            Refused: no such parameter, not a number, or out of its bounds; the old value stays.
        """
        row = self.rows.get(name)
        if row is None:
            raise Refused(f"no parameter {name!r}: {nearest(name, list(self.rows))}")
        if not isfinite(value):
            raise Refused(f"{name} must be a number")
        if row.kind is not ParameterKind.REAL32:
            if value != int(value):
                raise Refused(f"{name} must be a whole number")
            low, high = _RANGES[row.kind]
            if not low <= value <= high:
                raise Refused(f"{name} cannot store {value:g}")
        if not row.minimum <= value <= row.maximum:
            raise Refused(f"{name} must be from {row.minimum:g} to {row.maximum:g}")
        self._values[name] = value
        self._apply(row, value)
        if self._derive is not None:
            self._derive(self.__getitem__, self.tuning)
        for listener in self.on_change:
            listener(name, value)

    def load(self, other: "ParameterStore") -> None:
        """Copies every value from another store of the same style."""
        for name in other:
            if other[name] != self[name]:
                self.set(name, other[name])

    def reset(self) -> None:
        """Resets every value to its default."""
        for row in self.rows.values():
            if self._values[row.name] != row.default:
                self.set(row.name, row.default)

    def _apply(self, row: AutopilotParameter, value: float) -> None:
        if not row.sets:
            return
        target: Any = self.tuning
        *path, last = row.sets.split(".")
        for part in path:
            target = getattr(target, part)
        if row.means is not None:
            setattr(target, last, row.means.get(int(value), row.means[int(row.default)]))
        elif isinstance(getattr(target, last), bool):
            setattr(target, last, bool(value))
        elif isinstance(getattr(target, last), int):
            setattr(target, last, int(value * row.scale))
        else:
            setattr(target, last, value * row.scale)
