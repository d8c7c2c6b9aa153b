"""The motor test on the desk: typed confirmation, settings, and what became of each motor."""

from collections.abc import Callable
from typing import Final

from gloc3.errors import Gloc3Error
from gloc3_groundstation.desk.service_jobs import JobStarter, ServiceKind
from gloc3_groundstation.services.motor_test import MotorTestService, MotorTestSettings
from gloc3_groundstation.services.progress import OnProgress

CONFIRMED_S: Final = 120.0
"""So long after a test the confirmation holds for the next one."""
PROPS_OFF: Final = "props off"


class MotorDesk:
    """The motor test of one vehicle.

    Args:
        begin: begins what takes time.
        service: of the vehicle.
        now_s: the station's time.
    """

    def __init__(
        self,
        begin: JobStarter,
        service: MotorTestService,
        now_s: Callable[[], float],
    ) -> None:
        self.settings = MotorTestSettings()
        self.outcomes: dict[int, str] = {}
        """By motor, in a word."""
        self._begin, self._service, self._now_s = begin, service, now_s
        self._confirmed_until_s = float("-inf")

    @property
    def is_confirmed(self) -> bool:
        """Whether the operator has confirmed lately that the propellers are off."""
        return self._now_s() < self._confirmed_until_s

    def confirm(self, typed: str, name: str) -> str:
        """Takes a typed confirmation; returns why it is none.

        Args:
            typed: by the operator.
            name: of the vehicle.
        """
        if typed.strip().lower() not in (name.lower(), PROPS_OFF):
            return f"type {name} or {PROPS_OFF}"
        self._confirmed_until_s = self._now_s() + CONFIRMED_S
        return ""

    def revoke(self) -> None:
        """Has the next test asked about again: another vehicle may be there now."""
        self._confirmed_until_s = float("-inf")

    def test(self, motor: int) -> None:
        """Turns a motor, if it was confirmed that it may."""
        if not self.is_confirmed:
            return
        settings = self.settings
        self.outcomes[motor] = "not tested"

        async def work(report: OnProgress) -> str:
            self.outcomes[motor] = "stopped"
            try:
                await self._service.run(motor, settings, report)
            except Gloc3Error:
                self.outcomes[motor] = "refused"
                raise
            self.outcomes[motor] = "tested"
            self._confirmed_until_s = self._now_s() + CONFIRMED_S
            return f"motor {motor} was tested: {settings.percent:g} %, {settings.seconds:g} s"

        self._begin(ServiceKind.MOTORS, f"testing motor {motor}", work, is_change=True)
