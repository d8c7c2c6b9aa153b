"""On the clock host: follows the other hosts, and tells the command interface of those that are lost or here again."""

from collections.abc import Callable
from typing import Any

from gloc3.context import HostContext
from gloc3.exchange import Publisher
from gloc3.host_messages import HOST_PRESENCE, HOSTS, HostPresence, HostStatus
from gloc3.messages import Envelope, Severity
from gloc3.readiness import SensorCondition


class HostWatch:
    """Follows the tokens of the other hosts.

    Args:
        context: of the clock host's main process.
        host: its name.
        say: takes what a person should know.
    """

    def __init__(self, context: HostContext, host: str, say: Callable[[Severity, str], None]) -> None:
        self._context, self._own, self._say = context, host, say
        self._publisher = Publisher(context.exchange, context.platform, "host_watch", context.random.getrandbits(32))
        self._topic = f"{context.platform}/{HOST_PRESENCE}"
        self._here: dict[str, bool] = {}
        """What was told last."""
        self._sensors: dict[str, list[SensorCondition]] = {}
        hosts = f"{context.platform}/{HOSTS}/*"
        self._ends = [context.exchange.watch(hosts, self._changed), context.exchange.subscribe(hosts, self._take)]

    def close(self) -> None:
        """Tells nothing any more."""
        for end in self._ends:
            end()

    def sensors(self) -> list[SensorCondition]:
        """How the sensors of the other hosts are, as they told last."""
        return [sensor for sensors in self._sensors.values() for sensor in sensors]

    def _take(self, envelope: Envelope[Any]) -> None:
        status = envelope.payload
        if isinstance(status, HostStatus) and status.host != self._own:
            self._sensors[status.host] = status.sensors
            if self._here.get(status.host):
                self._tell(HostPresence(host=status.host, is_here=True, status=status))

    def _changed(self, token: str, is_here: bool) -> None:
        host = token.rpartition("/")[2]
        if host == self._own or self._here.get(host, False) == is_here:
            return
        self._here[host] = is_here
        if not is_here:
            self._sensors.pop(host, None)
        self._say(Severity.NOTICE if is_here else Severity.ERROR, f"host {host} is {'here' if is_here else 'lost'}")
        self._tell(HostPresence(host=host, is_here=is_here))

    def _tell(self, presence: HostPresence) -> None:
        self._publisher.publish(self._topic, presence, self._context.loop.time())
