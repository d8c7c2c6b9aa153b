"""Relays the progress of one mission between its platforms, by the station that commands them."""

from typing import Final

from gloc3.messages.command_interface import Elsewhere
from gloc3.messages.summaries import MissionSummary
from gloc3_groundstation.station.command_client import CommandClient
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot


class Relay:
    """Tells each platform in our control of the others in its mission, as soon as anything is heard of these.

    What is not heard here is not passed on: a platform that falls silent does so for all.
    """

    def __init__(self, client: CommandClient) -> None:
        self._client: Final = client

    def pass_on(self, name: str, mission: MissionSummary, fleet: Fleet) -> None:
        """A platform has told how far it is.

        Args:
            name: the platform.
            mission: what it told.
            fleet: what is known now.
        """
        if not mission.digest:
            return
        for other in fleet:
            if other.name != name and self._waits_for(other, name, mission.digest):
                assert other.mission is not None
                theirs = [task for task, whose in other.mission.value.elsewhere.items() if whose == name]
                states = {task: mission.tasks[task] for task in theirs if task in mission.tasks}
                body = Elsewhere(platform=name, digest=mission.digest, state=mission.state, tasks=states)
                self._client.send(other.name, body)

    def _waits_for(self, platform: PlatformSnapshot, name: str, digest: str) -> bool:
        if platform.mission is None or platform.control is None:
            return False
        mission, holder = platform.mission.value, platform.control.value.holder
        return holder == self._client.station and mission.digest == digest and name in mission.elsewhere.values()
