"""Time series of a topic's fields in a log."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from gloc3.errors import Refused, nearest
from gloc3.log.reader import LogReader
from gloc3.log.report.figure import drawing, thin

_STEP: Final = re.compile(r"[^.\[\]]+")


class FieldSeries(msgspec.Struct, frozen=True):
    """The values of one number, from one life of one component."""

    name: str
    t_s: list[float]
    values: list[float]


def flatten(value: Any, path: str = "") -> dict[str, Any]:
    """The leaves of nested values by path, such as `position_ned_m[0]`."""
    if isinstance(value, dict):
        items = [(f"{path}.{key}" if path else str(key), inner) for key, inner in value.items()]
    elif isinstance(value, list | tuple):
        items = [(f"{path}[{index}]", inner) for index, inner in enumerate(value)]
    else:
        return {path: value}
    return {name: leaf for inner_path, inner in items for name, leaf in flatten(inner, inner_path).items()}


def read_series(reader: LogReader, topic: str, fields: Sequence[str]) -> list[FieldSeries]:
    """Numeric fields of a topic whose paths begin with any of `fields`; all of them if none is given.

    Raises:
        Refused: there is no such numeric field.
    """
    wanted = [tuple(_STEP.findall(field)) for field in fields]
    found: dict[tuple[str, str], FieldSeries] = {}
    known: dict[str, None] = {}
    for life, t_s, message in reader.values(topic):
        for path, value in flatten(message).items():
            if not isinstance(value, int | float):
                continue
            known[path] = None
            steps = tuple(_STEP.findall(path))
            if wanted and not any(steps[: len(want)] == want for want in wanted):
                continue
            series = found.setdefault((path, life), FieldSeries(path, [], []))
            series.t_s.append(t_s)
            series.values.append(float(value))
    for field, want in zip(fields, wanted, strict=True):
        if not any(tuple(_STEP.findall(path))[: len(want)] == want for path, _ in found):
            raise Refused(f"{topic} has no numeric field {field!r}; {nearest(field, list(known))}")
    if not found:
        raise Refused(f"{topic} has no numeric fields")
    return list(found.values())


def plot_series(series: Sequence[FieldSeries], file: Path, title: str) -> None:
    """Draws numbers over time, those of one array or structure together.

    Raises:
        Gloc3Error: matplotlib is not installed, or the file cannot be written.
    """
    groups: dict[str, list[FieldSeries]] = {}
    for one in series:
        groups.setdefault(re.split(r"[.\[]", one.name)[0], []).append(one)
    with drawing(file, 9.0, 1.2 + 1.8 * len(groups)) as figure:
        all_axes = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, members) in zip(all_axes, groups.items(), strict=True):
            for one in members:
                step = thin(len(one.t_s))
                axes.plot(one.t_s[::step], one.values[::step], linewidth=1.1, label=one.name, gid=one.name)
            axes.set_ylabel(name if len(members) > 1 else members[0].name)
            if len(members) > 1:
                axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
        all_axes[-1].set_xlabel("time since boot, s")
        figure.suptitle(title, x=0.02, ha="left", fontweight="bold")
