"""Documents with a few things changed at random: keys lost, renamed or added, values of another kind or out of bounds."""

from random import Random
from typing import Any

STRANGE: tuple[Any, ...] = (None, True, -1, 0, 1, 0.5, 1e9, "", "strange", "$p", [], [1, 2, 3], {}, {"strange": 1})


def damaged(value: Any, random: Random) -> Any:
    """A copy of plain values with one to three changes."""
    made = _copy(value)
    for _ in range(random.randint(1, 3)):
        holders = [one for one in _all(made) if isinstance(one, dict | list) and one]
        holder = random.choice(holders)
        key = random.choice(sorted(holder) if isinstance(holder, dict) else range(len(holder)))
        match random.randrange(4):
            case 0:
                del holder[key]
            case 1 if isinstance(holder, dict):
                holder[random.choice([f"{key}_x", "after", "until", "on_failure", "strange"])] = holder.pop(key)
            case 2:
                others = [one for one in _all(made) if not isinstance(one, dict | list)]
                holder[key] = random.choice(others or [1])
            case _:
                holder[key] = _copy(random.choice(STRANGE))
        if not made:
            return made
    return made


def _copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copy(one) for key, one in value.items()}
    return [_copy(one) for one in value] if isinstance(value, list) else value


def _all(value: Any) -> list[Any]:
    found, waiting = [], [value]
    while waiting:
        one = waiting.pop()
        found.append(one)
        waiting += one.values() if isinstance(one, dict) else one if isinstance(one, list) else ()
    return found
