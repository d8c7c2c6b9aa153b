"""From platform file and mission alone: for every component and every action, what happens if the component dies."""

from collections.abc import Iterator, Mapping
from typing import Final

import msgspec

from gloc3.component.deployment import ComponentRow, FaultPolicy, OnFault, unread_by_standby
from gloc3.documents.document import Document
from gloc3.errors import Finding
from gloc3.messages.envelope import Kind
from gloc3.messages.perception import SatelliteFix
from gloc3.mission.model.model import Action, Mission, Task, answer
from gloc3.mission.model.policy import MANOEUVRES, SEVERITY, Policy, resolved
from gloc3.mission.model.structure import PartialOrder
from gloc3.platform.platform import Capability, Platform

POSE: Final = "pose"
SERVER: Final = "command_server"
LAST: Final = "if it stays away, the process itself commands the autopilot's landing"
"""Of the onboard process, which has a watchdog that is no component."""
OTHER_SOURCES: Final = "the position rests on its other sources and says how well"
RETURN_HOME: Final = "return_home"
FALLS_BACK_TO: Final = {Policy.RETURN: Policy.LAND, Policy.HOLD: Policy.LAND}
"""What is done where a policy cannot be flown."""
FLOWN_BY: Final = {Policy.LAND: "land", Policy.HOLD: "hold", Policy.RETURN: RETURN_HOME}
"""The capabilities that policies are flown with."""


class StaticCell(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What happens if one component dies for good while one action runs."""

    component: str
    phase: str
    """`TASK.ACTION`."""
    capability: str = ""
    """Of the action."""
    answer: str
    """In words: who takes over, or which policy flies."""
    by: str = ""
    """The component that takes over."""
    policy: str = ""
    """The policy that flies in the end; empty where the mission goes on."""
    problem: str = ""
    """Why there is no answer; empty where there is one."""

    @property
    def signature(self) -> tuple[str, ...]:
        """What cells share that one flight shows for all of them: the component, what is being done, the answer."""
        return self.component, self.capability, self.policy, self.by


class StaticProof(msgspec.Struct, frozen=True, kw_only=True):
    """All cells of a platform and a mission, and what is wrong with them."""

    platform: str
    mission: str
    cells: tuple[StaticCell, ...]
    findings: tuple[Finding, ...]


def prove_statically(platform: Platform, mission: Mission, document: Document) -> StaticProof:
    """Answers every cell.

    Args:
        platform: with classes that can be loaded.
        mission: one that passed the check.
        document: the platform's, for the places of findings.
    """
    reasoning = _Reasoning(platform, mission)
    cells = [
        msgspec.structs.replace(
            reasoning.cell(row, f"{task.name}.{action.name}", task, action), capability=action.ability
        )
        for row in platform.components
        for task in mission.tasks.values()
        for action in task.actions.values()
    ]
    findings = [*_without_answer(cells, platform, document), *_without_end(platform, document)]
    return StaticProof(
        platform=platform.platform, mission=mission.name, cells=tuple(cells), findings=tuple(sorted(findings))
    )


class _Reasoning:
    """What platform and mission say of a component's death."""

    def __init__(self, platform: Platform, mission: Mission) -> None:
        self._platform, self._mission = platform, mission
        self._order: Final = PartialOrder.of(mission)
        self._rows: Final = {row.name: row for row in platform.components}
        self._producers: Final[dict[str, set[str]]] = {}
        for row in platform.components:
            for port in row.load_class().outputs:
                for topic in row.topics(port):
                    self._producers.setdefault(topic, set()).add(row.name)
        self._pose: Final = self._feeders(POSE)

    def cell(self, row: ComponentRow, phase: str, task: Task, action: Action) -> StaticCell:
        """One cell."""
        if row.standby_for:
            text = f"nothing changes: it is the standby of {row.standby_for}, which works"
            return StaticCell(component=row.name, phase=phase, answer=text)
        on_fault = row.on_fault if isinstance(row.on_fault, OnFault) else OnFault(then=row.on_fault)
        again = ""
        if on_fault.reinitialize is not None:
            again = (
                f"brought up again {on_fault.reinitialize.times} times from {on_fault.reinitialize.back_off_s:g} s on"
            )
        if standby := self._standby_of(row):
            text = f"{standby} takes over within 0.1 s" + (f"; {row.name} is {again}" if again else "")
            return StaticCell(component=row.name, phase=phase, answer=text, by=standby)
        if row.name == SERVER:
            return self._server(phase, again)
        policy, why = self._policy(row, on_fault.then, task, action)
        if policy not in MANOEUVRES:
            why = why or "no action and no position rests on it"
            text = f"{again}; then the mission goes on: {why}" if again else f"the mission goes on: {why}"
            return StaticCell(component=row.name, phase=phase, answer=text)
        flown, steps, problem = self._flown(policy, row.name)
        chain = " → ".join([f"policy {policy}", *steps])
        text = f"{again}; then {chain} ({why})" if again else f"{chain} ({why})"
        return StaticCell(component=row.name, phase=phase, answer=text, policy=flown, problem=problem)

    def _server(self, phase: str, again: str) -> StaticCell:
        """The command interface: nobody carries out a policy without it, but its process watches over it and lands."""
        answer = f"{again or 'lost'}; meanwhile the action goes on and ends in the hold; {LAST}"
        return StaticCell(component=SERVER, phase=phase, answer=answer, policy=Policy.LAND)

    # --- which policy ---

    def _policy(self, row: ComponentRow, then: FaultPolicy, task: Task, action: Action) -> tuple[Policy, str]:
        """The most severe policy that follows, and why."""
        policies = self._mission.policies
        found: list[tuple[Policy, str]] = [(Policy.CONTINUE, "")]
        if then is not FaultPolicy.IGNORE:
            found.append((resolved(Policy(then), policies.on_failure), f"on_fault of {row.name}: {then}"))
            found.append((resolved(answer(policies.on_component_fault), policies.on_failure), "on_component_fault"))
        if row.name in self._pose or row.name in self._aids():
            wanted = resolved(answer(policies.on_pose_lost), policies.on_failure)
            found.append((wanted, f"on_pose_lost: {policies.on_pose_lost}"))
        found += self._failing(row.name, f"{task.name}.{action.name}")
        if row.name in self._other_sources():
            found.append((Policy.CONTINUE, OTHER_SOURCES))
        return max(found, key=lambda one: (SEVERITY.get(one[0], 0), bool(one[1])))

    def _failing(self, dead: str, target: str) -> Iterator[tuple[Policy, str]]:
        """What follows from each action that needs a component and has not ended when another one runs."""
        policies = self._mission.policies
        for other, action in self._mission.actions().items():
            capability = self._platform.capabilities.get(action.ability)
            if other in self._order.ended[target] or capability is None or dead not in self._closure(capability):
                continue
            task = self._mission.tasks[other.partition(".")[0]]
            levels = (action.options.on_failure, task.options.on_failure, policies.on_failure)
            wanted = next(level for level in levels if level is not None)
            yield resolved(wanted, policies.on_failure), f"{other} fails: on_failure: {wanted}"

    def _flown(self, policy: Policy, dead: str) -> tuple[str, list[str], str]:
        """What is flown in the end without a component: the policy, the steps to it, why there is none."""
        steps: list[str] = []
        wanted: Policy | None = policy
        while wanted is not None:
            capability = self._platform.capabilities.get(FLOWN_BY[wanted])
            if capability is not None and dead not in self._closure(capability):
                return wanted, steps, ""
            wanted = FALLS_BACK_TO.get(wanted)
            steps += [f"{wanted}, since that needs {dead}"] if wanted is not None else []
        last = "the autopilot's own way down"
        return last, [*steps, f"{last}, since {FLOWN_BY[Policy.LAND]} needs {dead}, too"], self._last_problem(dead)

    def _last_problem(self, dead: str) -> str:
        """Why nothing is left; empty where it is brought up again often enough for the way down to be tried."""
        row = self._rows[dead]
        on_fault = row.on_fault if isinstance(row.on_fault, OnFault) else OnFault(then=row.on_fault)
        if on_fault.reinitialize is not None:
            return ""
        return f"every way down needs {dead}, and nothing brings it up again"

    # --- what rests on what ---

    def _standby_of(self, row: ComponentRow) -> str:
        """The standby that takes over from it; empty without. One that reads less than it does not count."""
        name = row.on_fault.standby if isinstance(row.on_fault, OnFault) else None
        standby = self._rows.get(name or "")
        return standby.name if standby is not None and not unread_by_standby(row, standby) else ""

    def _closure(self, capability: Capability) -> set[str]:
        """The components without which a capability cannot be performed."""
        found = {capability.performed_by} if capability.performed_by else set()
        for need in capability.needs:
            if need in self._rows:
                found.add(need)
            elif need in self._platform.capabilities:
                found |= self._closure(self._platform.capabilities[need])
            elif need != POSE:
                producers = {name for name in self._producers.get(need, ()) if not self._rows[name].standby_for}
                found |= producers
        return found - {SERVER}

    def _feeders(self, topic: str) -> set[str]:
        """The components whose death silences a topic: its producer, and what alone wakes that."""
        found: set[str] = set()
        for name in self._producers.get(topic, ()):
            row = self._rows[name]
            if row.standby_for or self._standby_of(row):
                continue
            found.add(name)
            for trigger in row.triggers:
                topics = row.topics(trigger)
                if len(topics) == 1 and row.rate_hz is None:
                    found |= self._feeders(topics[0])
        return found

    def _aids(self) -> set[str]:
        """The components without which the position is lost, though others feed it: under water no satellites do."""
        dives = (self._platform.limits.survey_height_m or 0.0) < 0.0
        found: set[str] = set()
        for name in self._producers.get(POSE, ()):
            row = self._rows[name]
            inputs = {port: row.load_class().inputs[port] for port in row.load_class().needs_one_of}
            ports = [port for port, given in inputs.items() if not (dives and given.message is SatelliteFix)]
            producers = {one for port in ports for topic in row.topics(port) for one in self._producers.get(topic, ())}
            found |= producers if len(producers) == 1 else set()
        return found

    def _other_sources(self) -> set[str]:
        """The components that feed the position beside others."""
        found: set[str] = set()
        waiting = [POSE]
        seen: set[str] = set()
        while waiting:
            topic = waiting.pop()
            for name in self._producers.get(topic, ()):
                row = self._rows[name]
                if name not in seen and row.load_class().kind in (Kind.SAMPLER, Kind.PROCESSOR):
                    seen.add(name)
                    found.add(name)
                    waiting += [one for port in row.load_class().inputs for one in row.topics(port)]
        return found


# --- findings ---


def _without_answer(cells: list[StaticCell], platform: Platform, document: Document) -> Iterator[Finding]:
    """A finding for each component that has cells without an answer."""
    phases: dict[tuple[str, str], list[str]] = {}
    for cell in cells:
        if cell.problem:
            phases.setdefault((cell.component, cell.problem), []).append(cell.phase)
    for (component, problem), where in phases.items():
        index = next(index for index, row in enumerate(platform.components) if row.name == component)
        yield document.finding(
            ("components", index),
            f"if {component} dies during {', '.join(where)}: {problem}",
            "give it on_fault: {reinitialize: {times: 10}}, a standby, or a policy that does without it",
        )


def _without_end(platform: Platform, document: Document) -> Iterator[Finding]:
    """A finding for each component that only an input wakes, and on whose outputs something rests."""
    awaited = _awaited(platform)
    for index, row in enumerate(platform.components):
        outputs = {topic for port in row.load_class().outputs for topic in row.topics(port)}
        if row.triggers and row.rate_hz is None and outputs & set(awaited):
            topics = [topic for trigger in row.triggers for topic in row.topics(trigger)]
            readers = sorted({name for topic in outputs for name in awaited.get(topic, ())})
            yield document.finding(
                ("components", index, "trigger"),
                f"{row.name} stops for good when {' and '.join(topics)} stops, and with it {', '.join(readers)}",
                "give it a rate_hz beside its trigger, so that it can say that nothing comes",
                is_warning=True,
            )


def _awaited(platform: Platform) -> Mapping[str, list[str]]:
    """The topics that alone wake other components, with those."""
    found: dict[str, list[str]] = {}
    for row in platform.components:
        if row.rate_hz is None:
            for trigger in row.triggers:
                topics = row.topics(trigger)
                if len(topics) == 1:
                    found.setdefault(topics[0], []).append(row.name)
    return found
