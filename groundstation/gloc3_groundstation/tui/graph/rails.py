"""The actions of one task as a list, with rails that show which run in sequence and which in parallel."""

from typing import NamedTuple

from gloc3_groundstation.tui.graph.order import Before, reduced

MOST_LANES = 4
"""With more actions abreast there are no rails."""
NODE = "●"
"""Stands where the sign of the row's own action goes."""


class RailRow(NamedTuple):
    """One line."""

    name: str
    """The action; empty in a line that only has rails."""
    rails: str
    """Two characters a lane, with `NODE` in that of the action."""


def rail_rows(before: Before) -> list[RailRow]:
    """The lines, all with rails of the same width.

    An action is in the lane of its predecessor; a fork opens lanes, and a join closes them. Actions in the same
    lane follow each other, actions in different lanes may run at the same time.
    """
    order = reduced(before)
    after: dict[str, list[str]] = {name: [] for name in order}
    for name, earlier in order.items():
        for one in earlier:
            after[one].append(name)
    lanes: list[str] = []  # the action that each lane leads to; empty for a free one
    used = 0
    drawn: list[tuple[str, list[str]]] = []
    waiting = list(order)
    is_placed: set[str] = set()
    while waiting:
        ready = [name for name in waiting if all(one in is_placed for one in order[name])]
        name = min(ready, key=lambda one: (lanes.index(one) if one in lanes else len(lanes), waiting.index(one)))
        waiting.remove(name)
        is_placed.add(name)
        mine = [index for index, goal in enumerate(lanes) if goal == name]
        if len(mine) > 1:
            drawn.append(("", _tie(lanes, mine, closes=True)))
            for index in mine[1:]:
                lanes[index] = ""
        if not mine:  # one that nothing comes before: in a lane in which nobody has stood
            lanes += [""] * (used + 1 - len(lanes))
        lane = mine[0] if mine else used
        lanes[lane] = name
        used = max(used, lane + 1)
        drawn.append((name, [NODE if index == lane else "│" if goal else " " for index, goal in enumerate(lanes)]))
        followers = after[name]
        lanes[lane] = followers[0] if followers else ""
        if len(followers) > 1:
            opened = [lane]
            for follower in followers[1:]:
                index = _free(lanes)
                lanes[index] = follower
                opened.append(index)
                used = max(used, index + 1)
            drawn.append(("", _tie(lanes, opened, closes=False)))
        while lanes and not lanes[-1]:
            lanes.pop()
    widest = max((len(cells) for _, cells in drawn), default=0)
    if widest > MOST_LANES:
        return [RailRow(name, f"{NODE} ") for name in order]
    return [RailRow(name, _spelled(cells).ljust(2 * widest)) for name, cells in drawn]


def _free(lanes: list[str]) -> int:
    if "" in lanes:
        return lanes.index("")
    lanes.append("")
    return len(lanes) - 1


def _tie(lanes: list[str], joined: list[int], *, closes: bool) -> list[str]:
    """The cells of a line in which lanes open from the first one, or close into it."""
    first, last = min(joined), max(joined)
    cells = []
    for index in range(max(len(lanes), last + 1)):
        is_active = index < len(lanes) and bool(lanes[index])
        if index == first:
            cells.append("├─")
        elif index == last:
            cells.append("╯" if closes else "╮")
        elif index in joined:
            cells.append("┴─" if closes else "┬─")
        elif first < index < last:
            cells.append("┼─" if is_active else "──")
        else:
            cells.append("│" if is_active else " ")
    return cells


def _spelled(cells: list[str]) -> str:
    return "".join(f"{cell:<2}" for cell in cells)
