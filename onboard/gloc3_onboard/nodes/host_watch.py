"""On the clock host: tells the command interface of hosts that are lost, and of those that are here again."""

from gloc3.context import HostContext
from gloc3.exchange import Publisher
from gloc3.host_messages import HOST_PRESENCE, HOSTS, HostPresence


class HostWatch:
    """Follows the tokens of the other hosts.

    Args:
        context: of the clock host's main process.
        host: its name.
    """

    def __init__(self, context: HostContext, host: str) -> None:
        self._context, self._own = context, host
        self._publisher = Publisher(context.exchange, context.platform, "host_watch", context.random.getrandbits(32))
        self._topic = f"{context.platform}/{HOST_PRESENCE}"
        self._here: dict[str, bool] = {}
        """What was told last."""
        self._end = context.exchange.watch(f"{context.platform}/{HOSTS}/*", self._changed)

    def close(self) -> None:
        """Tells nothing any more."""
        self._end()

    def _changed(self, token: str, is_here: bool) -> None:
        host = token.rpartition("/")[2]
        if host == self._own or self._here.get(host, False) == is_here:
            return
        self._here[host] = is_here
        presence = HostPresence(host=host, is_here=is_here)
        self._publisher.publish(self._topic, presence, self._context.loop.time())
