"""The device `ros2`: a lifecycle node of ROS 2, commanded and observed by its own services."""

from contextlib import ExitStack
from enum import IntEnum
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, Final

from gloc3.errors import Gloc3Error, Refused

if TYPE_CHECKING:
    from gloc3.ros2.node import RosClient
    from gloc3.ros2.wire import Entity


PERIOD_S: Final = 0.25
"""Period at which the node is asked for its state, s."""


class LifecycleState(IntEnum):
    """States of a lifecycle node (`lifecycle_msgs/State`); those from 10 on are passed through."""

    UNKNOWN = 0
    UNCONFIGURED = 1
    INACTIVE = 2
    ACTIVE = 3
    FINALIZED = 4
    CONFIGURING = 10
    CLEANING_UP = 11
    SHUTTING_DOWN = 12
    ACTIVATING = 13
    DEACTIVATING = 14
    ERROR_PROCESSING = 15


class NodeTransition(IntEnum):
    """What a lifecycle node is asked for (`lifecycle_msgs/Transition`)."""

    CONFIGURE = 1
    CLEANUP = 2
    ACTIVATE = 3
    DEACTIVATE = 4


class RosLifecycle:
    """One lifecycle node. `open` comes first; everything else may be called from any thread."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._name = ""
        self._answer_s = 0.0
        self._state: LifecycleState | None = None
        self._alive: set[Entity] = set()
        """Nodes of its name in the graph: one that restarts may come before the old one has left."""
        self._change: RosClient | None = None
        self._get: RosClient | None = None
        self._lock = Lock()
        """Held while the node is asked or commanded."""

    @property
    def state(self) -> LifecycleState | None:
        """Its last known state; None where the node has left, or does not answer."""
        return self._state

    def open(self, name: str, router: str, domain: int, answer_s: float) -> None:
        """Joins the graph, waits for the node, and asks for its state.

        Args:
            name: absolute name of the node.
            router: Zenoh endpoint of the router; empty for the usual one.
            domain: `ROS_DOMAIN_ID`.
            answer_s: time for each of its answers, s.

        Raises:
            Gloc3Error: the package is not installed, or the node does not answer.
        """
        self.close()
        try:
            from gloc3.ros2.node import RosNetwork, open_node
            from gloc3.ros2.wire import ROUTER, absolute
        except ModuleNotFoundError as error:
            raise Gloc3Error(f'{error.name} is not installed: pip install "gloc3[ros2]"') from error
        self._name, self._answer_s = absolute(name), answer_s
        with ExitStack() as stack:
            network = RosNetwork(router=router or ROUTER, domain=domain)
            node = stack.enter_context(open_node(network, f"/gloc3/wrapper_of{self._name.replace('/', '_')}"))
            self._alive.clear()
            node.watch(self._graph_changed)
            self._change = node.client(f"{self._name}/change_state", "lifecycle_msgs/ChangeState")
            self._get = node.client(f"{self._name}/get_state", "lifecycle_msgs/GetState")
            try:
                self._state = self._asked()
            except Refused as refusal:
                raise Gloc3Error(f"{self._name} is no lifecycle node that answers: {refusal}") from refusal
            stop = Event()
            observer = Thread(target=self._observe, args=(stop,), name=f"ros2 {self._name}", daemon=True)
            stack.callback(observer.join)
            stack.callback(stop.set)
            observer.start()
            self._stack = stack.pop_all()

    def close(self) -> None:
        """Leaves the graph; the node stays as it is."""
        self._stack.close()
        self._change = self._get = self._state = None

    def request(self, transition: NodeTransition) -> None:
        """Has the node carry out a transition, and waits for its end.

        Raises:
            Gloc3Error: it fails, or the node does not answer.
        """
        if self._change is None:
            raise Gloc3Error("no lifecycle node is open")
        word = transition.name.lower()
        with self._lock:
            try:
                response = self._change.call({"transition": {"id": int(transition), "label": ""}}, self._answer_s)
            except Refused as refusal:
                raise Gloc3Error(f"{self._name}: {word}: {refusal}") from refusal
            if not response.success:
                raise Gloc3Error(f"{self._name} refuses to {word}, or fails at it")
            self._state = AFTER[transition]

    def _asked(self) -> LifecycleState:
        """The node's state, as it answers.

        Raises:
            Refused: it does not.
        """
        assert self._get is not None
        found = self._get.call({}, self._answer_s).current_state.id
        return LifecycleState(found) if found in iter(LifecycleState) else LifecycleState.UNKNOWN

    def _observe(self, stop: Event) -> None:
        """In its own thread: follows the node's state, whoever changes it."""
        while not stop.wait(PERIOD_S):
            with self._lock:
                try:
                    state = self._asked()
                except Refused:
                    state = None
                self._state = state if self._alive else None  # what is still answered of one that has left is late

    def _graph_changed(self, entity: "Entity", is_there: bool) -> None:
        """In a thread of Zenoh's: a node comes or leaves."""
        if entity.endpoint is None and entity.node_name == self._name:
            (self._alive.add if is_there else self._alive.discard)(entity)
            if not self._alive:
                self._state = None


AFTER: Final = {
    NodeTransition.CONFIGURE: LifecycleState.INACTIVE,
    NodeTransition.CLEANUP: LifecycleState.UNCONFIGURED,
    NodeTransition.ACTIVATE: LifecycleState.ACTIVE,
    NodeTransition.DEACTIVATE: LifecycleState.INACTIVE,
}
"""The state after each transition that succeeds."""
