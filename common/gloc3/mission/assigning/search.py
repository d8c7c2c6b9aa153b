"""A division of tasks among vehicles: cheapest insertion, then moves and exchanges until none is better.

Pure and deterministic. It finds a local optimum, not always the best division; for the few tasks of a mission both are
the same in most cases (`tests/common/mission/test_mission_assignment.py` compares them with all divisions).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Final, NamedTuple

MOST_ROUNDS: Final = 30
"""Rounds of moves and exchanges; each takes the first that is better."""

Shares = Mapping[str, tuple[str, ...]]
"""Vehicle to its tasks in their order."""


class ShareCost(NamedTuple):
    """What a vehicle's share takes."""

    excess_wh: float
    """Energy that it lacks."""
    duration_s: float


def divide(
    candidates: Mapping[str, Sequence[str]],
    vehicles: Sequence[str],
    cost: Callable[[str, tuple[str, ...]], ShareCost],
    is_possible: Callable[[Shares], bool],
) -> dict[str, tuple[str, ...]]:
    """Divides tasks so that no vehicle lacks energy, then so that the last one ends early, then for the least total time.

    Args:
        candidates: task to the vehicles that can perform it, in the order in which the tasks are placed.
        vehicles: all of them.
        cost: of a vehicle's tasks in an order; the same for the same arguments.
        is_possible: whether tasks in these orders do not wait for each other for ever.

    Returns:
        Vehicle to its tasks; a task for which there is no possible place is missing.
    """

    def score(shares: Shares) -> tuple[float, float, float]:
        costs = [cost(name, tasks) for name, tasks in shares.items()]
        longest_s = max((one.duration_s for one in costs), default=0.0)
        total_s = sum(one.duration_s for one in costs)
        return round(sum(one.excess_wh for one in costs), 3), round(longest_s, 3), round(total_s, 3)

    def best(options: Iterator[Shares], than: Shares | None = None) -> Shares | None:
        found, least = than, None if than is None else score(than)
        for shares in options:
            if is_possible(shares) and (least is None or (value := score(shares)) < least):
                found, least = shares, score(shares) if least is None else value
        return found

    shares: Shares = dict.fromkeys(vehicles, ())
    for task, able in candidates.items():
        shares = best(_insertions(shares, task, able)) or shares
    placed = [task for task in candidates if any(task in tasks for tasks in shares.values())]
    for _ in range(MOST_ROUNDS):
        before = shares
        for task in placed:
            rest = {name: tuple(one for one in tasks if one != task) for name, tasks in shares.items()}
            shares = best(_insertions(rest, task, candidates[task]), shares) or shares
        shares = best(_exchanges(shares, candidates), shares) or shares
        if shares == before:
            break
    return dict(shares)


def _insertions(shares: Shares, task: str, able: Sequence[str]) -> Iterator[Shares]:
    for name in able:
        tasks = shares[name]
        for place in range(len(tasks), -1, -1):
            yield {**shares, name: (*tasks[:place], task, *tasks[place:])}


def _exchanges(shares: Shares, candidates: Mapping[str, Sequence[str]]) -> Iterator[Shares]:
    whose = {task: name for name, tasks in shares.items() for task in tasks}
    for one, other in combinations(whose, 2):
        if whose[other] in candidates[one] and whose[one] in candidates[other]:
            other_of = {one: other, other: one}
            yield {name: tuple(other_of.get(task, task) for task in tasks) for name, tasks in shares.items()}
