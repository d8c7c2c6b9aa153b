"""What is announced of the alerts: each one that is new, has become worse or has returned, but no repeats."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Final, Literal

from gloc3.messages.envelope import Severity

if TYPE_CHECKING:
    from gloc3_groundstation.station.alerts import Alert, Alerts

AlertLevel = Literal["off", "critical", "error", "warning"]
"""The mildest severity that is announced."""
REPEAT_S: Final = 30.0
"""An alert that returns is announced again after this time at the earliest, s."""
BELL_S: Final = 2.0
"""The bell rings once in this time, s."""


def severity_of(level: AlertLevel) -> Severity | None:
    """The mildest severity of a level; None for none at all."""
    return None if level == "off" else Severity[level.upper()]


class Announcements:
    """Announces the alerts of a station.

    Args:
        bell: alerts that ring the bell, this severity and worse; None for none.
        speech: alerts that are spoken.
        speak: speaks a text.
    """

    def __init__(
        self,
        *,
        bell: Severity | None = None,
        speech: Severity | None = None,
        speak: Callable[[str], object] = lambda _: None,
    ) -> None:
        self._bell, self._speech, self._speak = bell, speech, speak
        self._announced: dict[tuple[str, str], tuple[Alert, float]] = {}
        self._rang_s = float("-inf")

    def update(self, alerts: "Alerts", now_s: float) -> bool:
        """Speaks what has changed since the last time, the oldest first.

        Args:
            alerts: as they are.
            now_s: the station's time.

        Returns:
            Whether the bell is to ring.
        """
        fresh = [alert for alert in alerts.all.values() if self._is_fresh(alert, now_s)]
        self._announced = {
            key: one for key, one in self._announced.items() if key in alerts.all or self._is_recent(one, now_s)
        }
        for alert in sorted(fresh, key=lambda alert: alert.last_s):
            self._announced[alert.key] = alert, now_s
            if self._speech is not None and alert.severity <= self._speech:
                self._speak(f"{alert.platform or 'station'}, {alert.severity.name.lower()}: {alert.text}")
        if self._bell is None or now_s - self._rang_s < BELL_S or all(alert.severity > self._bell for alert in fresh):
            return False
        self._rang_s = now_s
        return True

    def _is_fresh(self, alert: "Alert", now_s: float) -> bool:
        if alert.is_acknowledged:
            return False
        known = self._announced.get(alert.key)
        if known is None or alert.severity < known[0].severity:
            return True
        return alert.count > known[0].count and not self._is_recent(known, now_s)

    @staticmethod
    def _is_recent(known: "tuple[Alert, float]", now_s: float) -> bool:
        return now_s - known[1] < REPEAT_S
