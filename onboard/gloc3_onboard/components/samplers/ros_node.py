"""SS: a lifecycle node of ROS 2 as a component: what the component is commanded, the node is."""

from collections.abc import Sequence
from typing import Annotated, Final, Protocol

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.errors import Gloc3Error
from gloc3.messages.perception import EstimatorPose
from gloc3_onboard.ros2.lifecycle import LifecycleState, NodeTransition
from gloc3_onboard.sensors.checks.estimator_check import next_pose
from gloc3_onboard.sensors.checks.timeline import StampMonitor
from gloc3_onboard.sensors.devices import ExternalEstimator, opened


class LifecycleNode(Protocol):
    """A lifecycle node."""

    @property
    def state(self) -> LifecycleState | None:
        """Its last known state; None where it has left."""

    def open(self, name: str, router: str, domain: int, answer_s: float) -> None:
        """Finds the node; raises `Gloc3Error` if it is not there."""

    def close(self) -> None:
        """Leaves it as it is."""

    def request(self, transition: NodeTransition) -> None:
        """Carries out a transition; raises `Gloc3Error` if it fails."""


class RosNodeSettings(Settings, frozen=True):
    """Settings of a wrapped node."""

    node: str = ""
    """Absolute name of the lifecycle node, such as `/openvins`."""
    router: str = ""
    """Zenoh endpoint of the router of ROS 2; empty for `tcp/localhost:7447`."""
    domain: Annotated[int, Bounds(0, 232)] = 0
    """ROS_DOMAIN_ID."""
    answer_s: Annotated[float, Bounds(0.1, 60.0)] = 2.0
    """Time for the node to carry out a transition, in seconds; `timeout_s` of the component must be longer."""
    silent_s: Annotated[float, Bounds(0.05, 60.0)] = 0.5
    """Time without a pose after which the node counts as silent, in seconds."""


class RosNodeSampler(SensorSampler[RosNodeSettings]):
    """Leads a lifecycle node through its states, and reports the poses that it estimates, if it does.

    idle is *unconfigured*, standby *inactive*, working *active*. Quiet is *active*, too: the node goes on, and what it
    reports is withheld. A node that fails, leaves, or is put into another state by somebody else makes this component
    faulty; the `initialize` or `finish` that leads out of it cleans the node up first.
    """

    loggable = ("node_state", "reason")

    estimator_pose = Output(EstimatorPose)

    def __init__(self, node: LifecycleNode, estimator: ExternalEstimator | None = None) -> None:
        self.node_state = ""
        self.reason = ""
        self._node, self._estimator = node, estimator

    # --- the local command interface ---

    def initialize(self, settings: RosNodeSettings) -> None:
        """Finds the node and has it configured; one that is configured already is cleaned up first."""
        if not settings.node:
            raise Gloc3Error("settings: node must name a lifecycle node, such as /openvins")
        self.settings = settings
        self._node.open(settings.node, settings.router, settings.domain, settings.answer_s)
        self._lead(CLEANING)
        self._lead({LifecycleState.UNCONFIGURED: NodeTransition.CONFIGURE})
        self._expect(LifecycleState.INACTIVE)

    def start(self) -> None:
        """Has the node activated."""
        self._node.request(NodeTransition.ACTIVATE)
        self._timeline = StampMonitor("pose", self.settings.silent_s)
        if self._estimator is not None:
            self.until_stop.callback(opened(self._estimator, self.request_cycle))

    def stop(self) -> None:
        """Has the node deactivated, if it is active."""
        super().stop()
        self._lead({LifecycleState.ACTIVE: NodeTransition.DEACTIVATE})

    def finish(self) -> None:
        """Has the node cleaned up, and leaves it."""
        try:
            self._lead(CLEANING)
        finally:
            self._node.close()

    # --- the cycle ---

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Observes the node; reports a pose that has not been reported yet."""
        self._expect(LifecycleState.ACTIVE)
        if self._estimator is None:
            return []
        stamped = next_pose(self._estimator, self._timeline, now_s)
        if stamped is None:
            return []
        self.reason = stamped.pose.reason
        return [self.estimator_pose.report(stamped.pose, t_s=stamped.t_s)]

    def _lead(self, steps: "dict[LifecycleState, NodeTransition]") -> None:
        """Requests transitions as long as one leads on from the node's state."""
        while (state := self._node.state) is not None and state in steps:
            self._node.request(steps[state])

    def _expect(self, wanted: LifecycleState) -> None:
        """Raises if the node is in another state."""
        state = self._node.state
        self.node_state = "left" if state is None else state.name.lower()
        if state is not wanted:
            raise Gloc3Error(f"the node {self.settings.node} is {self.node_state}, not {wanted.name.lower()}")


CLEANING: Final = {LifecycleState.ACTIVE: NodeTransition.DEACTIVATE, LifecycleState.INACTIVE: NodeTransition.CLEANUP}
"""The way to *unconfigured*."""
