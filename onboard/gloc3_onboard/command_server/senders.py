"""Notices two stations that have one id: their requests come from two lives in turn."""

from typing import Final

MOST: Final = 32
"""Stations and lives that are remembered."""
LATE: Final = 2
"""So many requests of a life that is over may come late."""
AGAIN_S: Final = 60.0


class Senders:
    """The lives of the stations that ask."""

    def __init__(self) -> None:
        self._lives: dict[str, dict[int, int]] = {}
        """Station to the boots that it has spoken with, the present one last, each with how often it came back."""
        self._told_s: dict[str, float] = {}

    def hear(self, station: str, boot: int, now_s: float) -> str:
        """Takes in a request; gives what is to be told of it, once a minute: nothing where one station speaks."""
        lives = self._lives.pop(station, {})
        self._lives[station] = lives
        if len(self._lives) > MOST:
            del self._lives[next(iter(self._lives))]
        if not lives or boot == next(reversed(lives)):
            lives.setdefault(boot, 0)
            return ""
        if boot not in lives:
            lives[boot] = 0
            if len(lives) > MOST:
                del lives[next(iter(lives))]
            return ""
        lives[boot] = lives.pop(boot) + 1
        if lives[boot] <= LATE or now_s < self._told_s.get(station, float("-inf")) + AGAIN_S:
            return ""
        self._told_s[station] = now_s
        return f"two stations have the id {station}, and both are obeyed as one: give one another (--station-id)"
