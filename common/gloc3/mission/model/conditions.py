"""Conditions on the vehicle's state: guards of tasks and actions, and ends of loops. Plain data, not a text language.

A condition holds, does not hold, or is unknown where a quantity in it is not measured at the moment.
"""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Final

import msgspec

Readings = Mapping[str, float]
"""Current measurements, by the names of `QUANTITIES`; unknown ones are left out."""


class Quantity(msgspec.Struct, frozen=True):
    """Quantities that conditions compare."""

    words: str
    unit: str
    topic: str
    """Topic that the command interface server samples in every cycle; empty for quantities that it has itself."""
    doc: str


QUANTITIES: Final[Mapping[str, Quantity]] = {
    "battery": Quantity("battery", "%", "autopilot", "The share of the battery that is left, 0 to 1."),
    "height_m": Quantity("height", "m", "pose", "Height above home."),
    "depth_m": Quantity("depth", "m", "pose", "Depth below home."),
    "altitude_m": Quantity("altitude", "m", "height", "Distance to the ground below, by the range finder."),
    "speed_m_s": Quantity("speed", "m/s", "pose", "Speed over ground, vertical speed included."),
    "home_distance_m": Quantity("distance from home", "m", "pose", "Horizontal distance from home."),
    "pose_quality": Quantity("pose quality", "%", "pose", "Quality of the pose, 0 to 1."),
    "position_std_m": Quantity("position uncertainty", "m", "pose", "Horizontal standard deviation of the position."),
    "link_silent_s": Quantity(
        "silence of the station", "s", "", "Time since the last message from the holder of control."
    ),
}
"""By the keys of a condition."""


class Range(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """Range of a quantity: above a value, below one, or between two."""

    above: float | None = None
    below: float | None = None

    def __post_init__(self) -> None:
        if self.above is None and self.below is None:
            raise ValueError("above or below must be given")
        if self.above is not None and self.below is not None and self.above >= self.below:
            raise ValueError("above must be less than below")

    def holds(self, value: float) -> bool:
        """Whether a value is in it."""
        return (self.above is None or value > self.above) and (self.below is None or value < self.below)


class Condition(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """Exactly one key: a quantity with its range, or `all`, `any` or `not` of further conditions."""

    battery: Range | None = None
    """The share of the battery that is left, 0 to 1."""
    height_m: Range | None = None
    """Height above home."""
    depth_m: Range | None = None
    """Depth below home."""
    altitude_m: Range | None = None
    """Distance to the ground below, by the range finder."""
    speed_m_s: Range | None = None
    """Speed over ground, vertical speed included."""
    home_distance_m: Range | None = None
    """Horizontal distance from home."""
    pose_quality: Range | None = None
    """Quality of the pose, 0 to 1."""
    position_std_m: Range | None = None
    """Horizontal standard deviation of the position."""
    link_silent_s: Range | None = None
    """Time since the last message from the holder of control."""
    all: Annotated[tuple["Condition", ...], msgspec.Meta(min_length=1, max_length=20)] | None = None
    """All of them hold."""
    any: Annotated[tuple["Condition", ...], msgspec.Meta(min_length=1, max_length=20)] | None = None
    """One of them holds."""
    not_: "Condition | None" = msgspec.field(name="not", default=None)
    """It does not hold."""

    def __post_init__(self) -> None:
        given = [name for name in self.__struct_encode_fields__ if self._part(name) is not None]
        if len(given) != 1:
            raise ValueError(f"a condition has exactly one key, not {len(given)}: use all or any for several")
        (name,) = given
        if name in QUANTITIES and QUANTITIES[name].unit == "%":
            wanted = getattr(self, name)
            for value in (wanted.above, wanted.below):
                if value is not None and not 0.0 <= value <= 1.0:
                    raise ValueError(f"{name} is a share, 0 to 1: write {value / 100.0:g} for {value:g} %")

    def _part(self, name: str) -> Any:
        return getattr(self, "not_" if name == "not" else name)

    @property
    def quantities(self) -> frozenset[str]:
        """All quantities in it."""
        inner = (*(self.all or ()), *(self.any or ()), *((self.not_,) if self.not_ is not None else ()))
        own = {name for name in QUANTITIES if getattr(self, name) is not None}
        return frozenset(own).union(*(one.quantities for one in inner))

    def holds(self, readings: Readings) -> bool | None:
        """Whether it holds; None where that is not known."""
        if self.not_ is not None:
            inner = self.not_.holds(readings)
            return None if inner is None else not inner
        if self.all is not None:
            return _joined((one.holds(readings) for one in self.all), decisive=False)
        if self.any is not None:
            return _joined((one.holds(readings) for one in self.any), decisive=True)
        name, wanted = next((name, wanted) for name in QUANTITIES if (wanted := getattr(self, name)) is not None)
        value = readings.get(name)
        return None if value is None else bool(wanted.holds(value))

    def __str__(self) -> str:
        if self.not_ is not None:
            return f"not ({self.not_})"
        for parts, word in ((self.all, " and "), (self.any, " or ")):
            if parts is not None:
                return word.join(f"({one})" if one.all or one.any else str(one) for one in parts)
        name = next(name for name in QUANTITIES if getattr(self, name) is not None)
        wanted, quantity = getattr(self, name), QUANTITIES[name]
        scale = 100.0 if quantity.unit == "%" else 1.0
        ends = (("above", wanted.above), ("below", wanted.below))
        reported = [f"{word} {scale * value:g} {quantity.unit}" for word, value in ends if value is not None]
        return f"{quantity.words} {' and '.join(reported)}"


def _joined(found: Iterator[bool | None], *, decisive: bool) -> bool | None:
    """`any` (True decides) or `all` (False does) of conditions of which some may be unknown."""
    is_unknown = False
    for one in found:
        if one is decisive:
            return decisive
        is_unknown = is_unknown or one is None
    return None if is_unknown else not decisive
