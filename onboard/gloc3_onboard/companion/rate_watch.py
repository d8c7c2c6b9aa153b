"""Notices stations that change how often the autopilot sends on our link: what we need of it is asked for anew then.

An autopilot keeps one rate of a message for a link, whoever asks. Ground stations ask for all streams at some few Hertz,
some of them again and again.
"""

from collections.abc import Callable, Iterable
from typing import Final

from gloc3.mavlink import codec
from gloc3.mavlink.codec import Frame
from gloc3.mavlink.services.interval import SET_MESSAGE_INTERVAL

MOST: Final = 5
"""In a second: a flood of requests is not answered by a flood of ours."""
PERIOD_S: Final = 1.0


class RateWatch:
    """Looks at what stations send.

    Args:
        changed: called when the autopilot may send at other rates from now on.
        now_s: tells the time.
    """

    def __init__(self, changed: Callable[[], None], now_s: Callable[[], float]) -> None:
        self._changed, self._now_s = changed, now_s
        self._began_s, self._told = float("-inf"), 0
        self._stream_id = codec.shape("REQUEST_DATA_STREAM").id
        self._command_ids = frozenset(codec.shape(name).id for name in ("COMMAND_LONG", "COMMAND_INT"))

    def hear(self, frames: Iterable[Frame]) -> None:
        """Looks at frames of a station, which the router passes on."""
        for frame in frames:
            if frame.message_id == self._stream_id or (frame.message_id in self._command_ids and _sets_a_rate(frame)):
                now_s = self._now_s()
                if now_s - self._began_s >= PERIOD_S:
                    self._began_s, self._told = now_s, 0
                self._told += 1
                if self._told <= MOST:
                    self._changed()


def _sets_a_rate(frame: Frame) -> bool:
    message = frame.decode()
    return message is not None and message.command == SET_MESSAGE_INTERVAL
