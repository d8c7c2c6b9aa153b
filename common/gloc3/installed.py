"""Entry points of installed packages."""

import sys
from functools import cache
from importlib.metadata import EntryPoint, entry_points


def installed_points(group: str) -> tuple[EntryPoint, ...]:
    """The entry points of a group, by name. What is installed while a process runs is there for the next one."""
    return _read(group, tuple(sys.path))


@cache
def _read(group: str, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:  # noqa: ARG001 - part of the key
    """Reads entry points, cached: it takes milliseconds, and some groups are needed with every file."""
    return tuple(sorted(entry_points(group=group), key=lambda point: (point.name, point.value)))
