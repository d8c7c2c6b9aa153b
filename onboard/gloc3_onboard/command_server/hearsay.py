"""What stations tell of the other platforms of the loaded mission."""

from collections.abc import Callable
from typing import Final

from gloc3.messages.command_interface import Elsewhere
from gloc3.messages.envelope import Severity
from gloc3.mission.executing.executor import MissionExecutor
from gloc3.mission.model.model import digest_of
from gloc3.mission.model.states import ActionState
from gloc3_onboard.command_server.control import ControlAuthority

MOST_STRANGERS: Final = 32
"""Of so many stations it is told that they are not believed."""

_STATES: Final = {state.value: state for state in ActionState}


class Hearsay:
    """Believes whoever commands this platform, about the mission that is loaded here, and nobody else."""

    def __init__(self, authority: ControlAuthority, say: Callable[[Severity, str], None]) -> None:
        self._authority, self._say = authority, say
        self._strangers: set[str] = set()

    def take(self, executor: MissionExecutor, sender: str, body: Elsewhere, now_s: float) -> None:
        """Takes in how far another platform is."""
        program = executor.mission
        if program is None or body.digest != digest_of(program.mission.text) or body.state not in _STATES:
            return
        if sender != self._authority.holder:
            if sender not in self._strangers and len(self._strangers) < MOST_STRANGERS:
                self._strangers.add(sender)
                self._say(Severity.WARNING, f"station {sender} tells of {body.platform} without control: not believed")
            return
        tasks = {name: _STATES[state] for name, state in body.tasks.items() if state in _STATES}
        executor.elsewhere(body.platform, _STATES[body.state], tasks, now_s)
