"""A partial order as layers: the column of each node, the layers that lines pass, and redundant lines."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

Before = Mapping[str, Sequence[str]]
"""Name to the names that come before it. Unknown names and cycles are borne: what closes a cycle is left out."""


def acyclic(before: Before) -> dict[str, tuple[str, ...]]:
    """The same order with known names only, and without what closes a cycle."""
    kept: dict[str, tuple[str, ...]] = {}
    placed: list[str] = []
    while len(placed) < len(before):
        ready = [
            name
            for name, earlier in before.items()
            if name not in kept and all(one in kept for one in earlier if one in before and one != name)
        ]
        for name in ready or [name for name in before if name not in kept][:1]:
            kept[name] = tuple(dict.fromkeys(one for one in before[name] if one in placed))
            placed.append(name)
    return {name: kept[name] for name in placed}


def reduced(before: Before) -> dict[str, tuple[str, ...]]:
    """The transitive reduction: predecessors of predecessors are left out."""
    order = acyclic(before)
    all_before: dict[str, frozenset[str]] = {}
    for name, earlier in order.items():
        all_before[name] = frozenset(earlier).union(*(all_before[one] for one in earlier))
    return {
        name: tuple(one for one in earlier if not any(one in all_before[other] for other in earlier if other != one))
        for name, earlier in order.items()
    }


def depths(before: Before) -> dict[str, int]:
    """Name to its layer, from 0: one more than the highest of its predecessors. The order must be acyclic."""
    found: dict[str, int] = {}
    for name, earlier in before.items():
        found[name] = 1 + max((found[one] for one in earlier), default=-1)
    return found


def passed(name: str, goal: str, layer: int) -> str:
    """The name of a place where a line to `goal` only passes a layer."""
    return f"{name} > {goal} > {layer}"


def layered(before: Before) -> tuple[list[list[str]], list[tuple[str, str]]]:
    """The layers from left to right, and the lines between neighbours.

    A line over several layers is split at intermediate positions, with names from `passed`. In each layer the names are
    sorted by the mean position of their predecessors, which keeps crossings few.

    Args:
        before: a reduced order.
    """
    depth = depths(before)
    layers: list[list[str]] = [[] for _ in range(1 + max(depth.values(), default=-1))]
    for name in before:
        layers[depth[name]].append(name)
    lines: list[tuple[str, str]] = []
    for name, earlier in before.items():
        for one in earlier:
            here = one
            for number in range(depth[one] + 1, depth[name]):
                place = passed(one, name, number)
                layers[number].append(place)
                lines.append((here, place))
                here = place
            lines.append((here, name))
    came_from: dict[str, list[str]] = {}
    for origin, goal in lines:
        came_from.setdefault(goal, []).append(origin)
    for earlier_layer, layer in pairwise(layers):
        place_of = {name: index for index, name in enumerate(earlier_layer)}

        def mean(name: str, place_of: dict[str, int] = place_of) -> float:
            places = [place_of[one] for one in came_from.get(name, ()) if one in place_of]
            return sum(places) / len(places) if places else float(len(place_of))

        layer.sort(key=mean)
    return layers, lines
