"""The data chain: samplers, processors, controllers, drivers, command interface, and their wiring."""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from gloc3.errors import Gloc3Error
from gloc3.messages.envelope import Kind
from gloc3.messages.summaries import Health
from gloc3.platform.platform import Platform
from gloc3_groundstation.station.snapshots import ComponentSnapshot


class ChainStage(NamedTuple):
    """The components of one kind."""

    kind: Kind
    components: tuple[ComponentSnapshot, ...]
    stops: tuple[ComponentSnapshot, ...]
    """Those that are required and deliver nothing, with no other in their place: here the data stops."""


def stages(components: Sequence[ComponentSnapshot]) -> list[ChainStage]:
    """The chain SS → DP → CC → AD → CI of a platform, without the kinds that it has none of."""
    found = []
    for kind in Kind:
        own = tuple(component for component in components if component.kind == kind.value)
        if own:
            found.append(
                ChainStage(kind, own, tuple(each for each in own if each.is_required and not delivers(each, own)))
            )
    return found


def delivers(component: ComponentSnapshot, others: Sequence[ComponentSnapshot]) -> bool:
    """Whether a component publishes its results, or another does in its place; unknown counts as true."""
    if component.health in (Health.WORKING, None):
        return True
    return any(each.standby_for == component.name and each.health is Health.WORKING for each in others)


class Wiring:
    """Data flow between components, from a platform's file."""

    def __init__(self, makers: Mapping[str, Sequence[str]], takers: Mapping[str, Sequence[str]]) -> None:
        """The wiring.

        Args:
            makers: topic to the components that publish it.
            takers: topic to the components that read it.
        """
        self._makers: Final = makers
        self._takers: Final = takers

    @classmethod
    def of(cls, platform: Platform) -> "Wiring":
        """The wiring of a platform, as far as its components' classes are installed here."""
        makers: dict[str, list[str]] = {}
        takers: dict[str, list[str]] = {}
        for row in platform.components:
            try:
                found = row.load_class()
            except Gloc3Error:
                continue
            for ports, known in ((found.outputs, makers), (found.inputs, takers)):
                for topic in dict.fromkeys(topic for port in ports for topic in row.topics(port)):
                    known.setdefault(topic, []).append(row.name)
        return cls(makers, takers)

    def gives(self, name: str) -> dict[str, Sequence[str]]:
        """What a component publishes: topic to those that read it."""
        return {topic: self._takers.get(topic, ()) for topic, makers in self._makers.items() if name in makers}

    def inputs(self, name: str) -> dict[str, Sequence[str]]:
        """What a component reads: topic to those that publish it."""
        return {topic: self._makers.get(topic, ()) for topic, takers in self._takers.items() if name in takers}

    def starved(self, components: Sequence[ComponentSnapshot]) -> dict[str, str]:
        """Components that do not receive a topic, to that topic: its producer publishes nothing."""
        known = {component.name: component for component in components}
        found: dict[str, str] = {}
        for topic, takers in self._takers.items():
            makers = [known[name] for name in self._makers.get(topic, ()) if name in known]
            if makers and not any(maker.health in (Health.WORKING, None) for maker in makers):
                found |= {
                    receiver: topic
                    for receiver in takers
                    if receiver in known and known[receiver].health is Health.WORKING
                }
        return found
