"""Control of the platform: one station holds it at a time, with request, grant, refuse, time-out and take-over."""

from typing import Final

from gloc3.errors import Refused
from gloc3.messages.command_interface import Control, ControlVerb
from gloc3.messages.summaries import ControlState

ANSWER_S: Final = 10.0
"""A request that the holder does not answer within this time is granted if the holder is gone, else refused."""

GONE_AFTER_S: Final = 5.0
"""A holder of whom nothing was heard for so long is gone (DESIGN §6, link loss)."""
MOST_HEARD: Final = 32
"""Stations of whom it is remembered when they were heard."""


class ControlAuthority:
    """Grants control, and knows when its holder was last heard."""

    def __init__(self) -> None:
        self.holder = ""
        self.requested_by = ""
        self._requested_s = 0.0
        self._heard_s: dict[str, float] = {}

    def state(self) -> ControlState:
        """For the stations."""
        return ControlState(holder=self.holder, requested_by=self.requested_by)

    def restore(self, holder: str, now_s: float) -> None:
        """Whoever held control before a restart holds it still; it counts as heard now, and must be heard again."""
        self.holder = holder
        self._heard_s.setdefault(holder, now_s)

    def hear(self, station: str, now_s: float) -> None:
        """A station has been heard: by its heartbeat, or by a request."""
        self._heard_s.pop(station, None)
        self._heard_s[station] = now_s
        if len(self._heard_s) > MOST_HEARD:
            del self._heard_s[next(one for one in self._heard_s if one != self.holder)]

    def is_heard(self, station: str, now_s: float, within_s: float) -> bool:
        """Whether something has been heard of a station lately."""
        return now_s - self._heard_s.get(station, float("-inf")) <= within_s

    def silent_s(self, now_s: float) -> float:
        """How long nothing has been heard of the holder; 0 while nobody holds control."""
        return now_s - self._heard_s.get(self.holder, now_s) if self.holder else 0.0

    def require(self, station: str) -> None:
        """Refuses a station that does not hold control."""
        if station != self.holder:
            held = f"station {self.holder} holds control" if self.holder else "no station holds control"
            raise Refused(f"{held}; ask for control first")

    def handle(self, station: str, body: Control, gone_after_s: float, now_s: float) -> str:
        """Carries out a request about control; returns what to tell the station.

        Raises:
            Refused: with the reason.
        """
        match body.verb:
            case ControlVerb.REQUEST:
                return self._request(station, gone_after_s, now_s)
            case ControlVerb.RELEASE:
                self.require(station)
                self.holder, self.requested_by = self.requested_by, ""
                return "released"
            case ControlVerb.GRANT:
                self.require(station)
                if not self.requested_by or body.station not in ("", self.requested_by):
                    raise Refused(f"station {body.station or '?'} has not asked for control")
                self.holder, self.requested_by = self.requested_by, ""
                return f"granted to station {self.holder}"
            case ControlVerb.REFUSE:
                self.require(station)
                self.requested_by = ""
                return "refused"
            case ControlVerb.TAKE_OVER:
                was, self.holder, self.requested_by = self.holder, station, ""
                return f"taken over from station {was}" if was and was != station else "taken"

    def _request(self, station: str, gone_after_s: float, now_s: float) -> str:
        if self.holder in ("", station):
            self.holder = station
            return "granted"
        if self.silent_s(now_s) > gone_after_s:
            was, self.holder, self.requested_by = self.holder, station, ""
            return f"granted: station {was} is gone"
        if self.requested_by not in ("", station):
            raise Refused(f"station {self.requested_by} has asked already, and waits for the answer")
        self.requested_by, self._requested_s = station, now_s
        return f"station {self.holder} has been asked"

    def tick(self, now_s: float, gone_after_s: float = GONE_AFTER_S) -> bool:
        """Ends a request that has not been answered; returns whether something has changed."""
        if not self.requested_by or now_s - self._requested_s <= ANSWER_S:
            return False
        if self.silent_s(now_s) > gone_after_s:
            self.holder = self.requested_by
        self.requested_by = ""
        return True
