"""Link events: logged, narrated, and sent to the stations like those of a component."""

from collections.abc import Callable
from typing import Final

from gloc3.exchange import Publisher
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Event, Severity
from gloc3.messages.summaries import AUTOPILOT_SAYS
from gloc3_onboard.autopilot.telemetry import PREARM_WORDS

SOURCE = "autopilot_link"
SAID_S: Final = 30.0
"""A text of the autopilot that it repeats within this time is reported once, s."""
MOST_TEXTS: Final = 32


class LinkReports:
    """Publishes events in the name of the link.

    Args:
        exchange: the platform's middleware.
        platform: the platform's name.
        boot: random number of this start of the process.
        time_s: returns the time.
        source: the link's name; the autopilot's where none is given.
    """

    def __init__(
        self, exchange: Exchange, platform: str, boot: int, time_s: Callable[[], float], source: str = SOURCE
    ) -> None:
        self._publisher = Publisher(exchange, platform, source, boot)
        self._topic = f"{platform}/components/{source}/event"
        self._time_s = time_s

    def report(self, severity: Severity, text: str, /, *, cause: str = "") -> None:
        """Publishes an event."""
        self._publisher.publish(self._topic, Event(severity=severity, text=text, cause=cause), self._time_s())


class AlertRelay:
    """Reports the autopilot's own warnings in its words; reasons against arming are in the pre-flight list.

    Args:
        report: called with each.
    """

    def __init__(self, report: Callable[[Severity, str], None]) -> None:
        self._report = report
        self._said: dict[str, float] = {}
        """When each text came last, oldest first."""

    def relay(self, severity: int, text: str, now_s: float) -> None:
        """Handles a status text or an event of the autopilot, of any severity."""
        text = text.strip()
        if severity > Severity.WARNING or not text or text.lower().startswith(PREARM_WORDS):
            return
        said_s = self._said.pop(text, None)
        self._said[text] = now_s if said_s is None or now_s - said_s >= SAID_S else said_s
        while len(self._said) > MOST_TEXTS:
            del self._said[next(iter(self._said))]
        if self._said[text] == now_s:
            self._report(Severity(severity), f"{AUTOPILOT_SAYS}{text}")
