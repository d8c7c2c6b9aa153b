"""Link events: logged, narrated, and sent to the stations like those of a component."""

from collections.abc import Callable

from gloc3.exchange import Publisher
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Event, Severity

SOURCE = "autopilot_link"


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

    def report(self, severity: Severity, text: str) -> None:
        """Tells one thing."""
        self._publisher.publish(self._topic, Event(severity=severity, text=text), self._time_s())
