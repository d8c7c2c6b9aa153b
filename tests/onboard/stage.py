"""A stage for one component without its host: messages go into its real mailbox, cycles are run by hand."""

from typing import Any

from gloc3.component.action import ActionPerformer
from gloc3.component.component import ActuatorDriver, Component
from gloc3.component.cycle import Mailbox
from gloc3.component.ports import Actuation, PortReport
from gloc3.messages.envelope import Message
from gloc3.mission.model.messages import ActionStatus

from .messages import at


class Stage:
    """Runs the cycles of a working (or quiet) component and keeps what it reports, by type."""

    def __init__(self, component: Component[Any], settings: Any = None) -> None:
        self.component = component
        self.now_s = 0.0
        self.is_quiet = False
        self.received: list[Message] = []
        """Everything that was reported, oldest first."""
        self.new: list[Message] = []
        """What the last cycle reported."""
        self.valid_s: dict[type[Message], float] = {}
        """Time of validity of the newest report of each type."""
        self._mailbox = Mailbox(list(type(component).inputs.values()))
        component.initialize(settings or type(component).settings_type())
        component.start()

    def put(self, t_s: float | None = None, **messages: Message) -> None:
        """Delivers messages: port to message, valid now unless said otherwise."""
        for port, message in messages.items():
            self._mailbox.put(port, at(self.now_s if t_s is None else t_s, message))

    def cycle(self) -> list[Message]:
        """Runs one cycle now."""
        self.new = []
        for result in self.component.work(self.now_s, self._mailbox.drain()):
            if isinstance(result, Actuation):
                if isinstance(self.component, ActuatorDriver) and not self.is_quiet:
                    self.component.actuate(result.write)
            else:
                message = result.message if isinstance(result, PortReport) else result
                stated_s = result.t_s if isinstance(result, PortReport) else None
                self.valid_s[type(message)] = self.now_s if stated_s is None else stated_s
                self.new.append(message)
        self.received += self.new
        return self.new

    def step(self, seconds: float = 0.05, **messages: Message) -> list[Message]:
        """Lets time pass, delivers messages and runs a cycle."""
        self.now_s = round(self.now_s + seconds, 6)
        self.put(None, **messages)
        return self.cycle()

    def last(self, kind: type[Message]) -> Any:
        """The newest report of a type; None before the first."""
        return next((message for message in reversed(self.received) if type(message) is kind), None)

    def all(self, kind: type[Message]) -> list[Any]:
        """All reports of a type."""
        return [message for message in self.received if type(message) is kind]

    def call(self, function: str, **arguments: Any) -> Message:
        """Calls a function of the component, as its host would."""
        entry = type(self.component).functions[function]
        reply: Message = getattr(self.component, entry.method)(entry.request(**arguments), self.now_s)
        return reply

    def begin(self, capability: str, action_id: str = "go", progress: float = 0.0, **arguments: Any) -> None:
        """Starts an action."""
        assert isinstance(self.component, ActionPerformer)
        self.call("action.start", action_id=action_id, capability=capability, arguments=arguments, progress=progress)

    @property
    def status(self) -> ActionStatus:
        """The last report on the action."""
        found = self.last(ActionStatus)
        assert isinstance(found, ActionStatus)
        return found
