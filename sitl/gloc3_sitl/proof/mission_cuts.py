"""Shorter missions: the same file without a task, an action or some waypoints."""

from collections.abc import Iterator
from copy import deepcopy
from typing import Any, Final

import yaml

_LISTS: Final = ("waypoints", "waypoints_m")
_SHORT_S: Final = 2.0
_BOOL: Final = "tag:yaml.org,2002:bool"


class _Loader(yaml.SafeLoader):
    """Reads keys as missions do: `off` and `on` are names."""

    yaml_implicit_resolvers = {
        first: [(tag, pattern) for tag, pattern in resolvers if tag != _BOOL or first in "tTfF"]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


def shorter(text: str) -> Iterator[str]:
    """The missions that lack one part of this one, the largest part first; each is still to be checked.

    A mission that includes others is left as it is.
    """
    document = yaml.load(text, Loader=_Loader)
    if not isinstance(document, dict) or "include" in document:
        return
    for cut in _cuts(document):
        yield yaml.safe_dump(cut, sort_keys=False, default_flow_style=None, allow_unicode=True, width=110)


def _cuts(document: dict[str, Any]) -> Iterator[dict[str, Any]]:
    tasks: dict[str, Any] = document.get("tasks", {})
    for task in reversed(tasks):
        if len(tasks) > 1:
            cut = deepcopy(document)
            _remove(cut["tasks"], task)
            yield cut
    for task, written in tasks.items():
        actions = written.get("actions") or {}
        for action in reversed(actions):
            if len(actions) > 1:
                cut = deepcopy(document)
                _remove(cut["tasks"][task]["actions"], action)
                yield cut
    for task, written in tasks.items():
        for action, options in (written.get("actions") or {}).items():
            yield from _shorter_actions(document, task, action, options)


def _shorter_actions(document: dict[str, Any], task: str, action: str, options: Any) -> Iterator[dict[str, Any]]:
    """The mission with fewer waypoints, or with a shorter time, in one action."""
    for capability, arguments in options.items() if isinstance(options, dict) else ():
        if not isinstance(arguments, dict):
            continue
        for name in _LISTS:
            points = arguments.get(name) or []
            for kept in _fewer(points):
                cut = deepcopy(document)
                cut["tasks"][task]["actions"][action][capability][name] = kept
                yield cut
        if float(arguments.get("duration_s", 0.0) or 0.0) > _SHORT_S:
            cut = deepcopy(document)
            cut["tasks"][task]["actions"][action][capability]["duration_s"] = _SHORT_S
            yield cut


def _fewer(points: list[Any]) -> Iterator[list[Any]]:
    half = len(points) // 2
    if half:
        yield points[:half]
        if half > 1:
            yield points[:-1]


def _remove(items: dict[str, Any], name: str) -> None:
    """Removes an item; what came after it comes after what it came after."""
    before = items.pop(name).get("after", [])
    for other in items.values():
        if isinstance(other, dict) and name in other.get("after", ()):
            other["after"] = [one for one in dict.fromkeys([*other["after"], *before]) if one != name]
        if isinstance(other, dict) and other.get("until") == name:
            del other["until"]
