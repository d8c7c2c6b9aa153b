"""A lifecycle node of another library, led by a component's commands over real Zenoh sessions."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.ros_peer import LifecycleNode, Peer, peer, router, until

from gloc3.component.deployment import Begin, ComponentRow
from gloc3.component.lci import Command, State
from gloc3.component.test_bench import Bench
from gloc3.messages.perception import EstimatorPose
from gloc3_onboard.components.samplers.ros_node import RosNodeSampler
from gloc3_onboard.ros2.lifecycle import LifecycleState, NodeTransition, RosLifecycle
from gloc3_onboard.sensors.devices import Bell, StampedEstimatorPose, Unwatch

pytestmark = pytest.mark.sockets
CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE = map(int, NodeTransition)


class Poses:
    """An estimator as a test sets it."""

    def __init__(self) -> None:
        self.now: StampedEstimatorPose | None = None
        self.is_open = False
        self.bell = Bell()

    def open(self) -> None:
        self.is_open = True

    def close(self) -> None:
        self.is_open = False

    def on_new_data(self, ready: object) -> Unwatch:
        return lambda: None

    def estimated_pose(self) -> StampedEstimatorPose | None:
        return self.now


class Scene:
    """A node, and the component that leads it."""

    def __init__(self, bench: Bench, other: Peer, endpoint: str) -> None:
        self.bench = bench
        self.node = LifecycleNode(other, "/vio")
        self.device, self.poses = RosLifecycle(), Poses()
        settings = {"node": "/vio", "router": endpoint}
        row = ComponentRow(name="vio", class_name="x:Y", rate_hz=20.0, settings=settings, begin=Begin.IDLE)
        bench.host(row, lambda: RosNodeSampler(self.device, self.poses))

    def command(self, command: Command) -> State | None:
        """Commands the component; its state then."""
        self.bench.command("vio", command)
        return self.bench.state("vio")

    def work(self) -> None:
        for command in (Command.INITIALIZE, Command.START):
            self.command(command)
        assert self.bench.state("vio") is State.WORKING

    @property
    def cause(self) -> str:
        return str(self.bench.last("components/vio/status").cause)


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    with router() as endpoint, peer(endpoint, tmp_path) as other, Bench() as bench:
        found = Scene(bench, other, endpoint)
        yield found
        found.device.close()


def test_each_command_leads_the_node_into_the_state_of_the_component(scene: Scene) -> None:
    expected = [
        (Command.INITIALIZE, State.STANDBY, 2),
        (Command.START, State.WORKING, 3),
        (Command.GOQUIET, State.QUIET, 3),
        (Command.RESUME, State.WORKING, 3),
        (Command.STOP, State.STANDBY, 2),
        (Command.INITIALIZE, State.STANDBY, 2),
        (Command.FINISH, State.IDLE, 1),
    ]
    for command, state, of_node in expected:
        assert scene.command(command) is state, scene.cause
        assert scene.node.state == of_node
    assert scene.node.requests == [CONFIGURE, ACTIVATE, DEACTIVATE, CLEANUP, CONFIGURE, CLEANUP]


def test_while_it_is_quiet_the_node_is_active_and_its_poses_are_withheld(scene: Scene) -> None:
    scene.work()
    assert scene.poses.is_open

    def next_pose() -> int:
        """One more pose comes; how many were reported."""
        scene.poses.now = StampedEstimatorPose(scene.bench.loop.time(), EstimatorPose(position_m=(1.0, 0.0, 0.0)))
        scene.bench.run(0.1)
        return len(scene.bench.all("estimator_pose"))

    assert next_pose() == 1
    scene.command(Command.GOQUIET)
    assert next_pose() == 1
    assert (scene.bench.state("vio"), scene.node.state) == (State.QUIET, 3)
    scene.command(Command.RESUME)
    assert next_pose() == 2
    scene.command(Command.STOP)
    assert not scene.poses.is_open


def test_a_node_that_cannot_be_configured_makes_the_component_faulty_and_it_is_tried_again(scene: Scene) -> None:
    scene.node.fails = {CONFIGURE}
    assert scene.command(Command.INITIALIZE) is State.FAULTY
    assert "/vio refuses to configure, or fails at it" in scene.cause
    scene.node.fails = set()
    assert scene.command(Command.INITIALIZE) is State.STANDBY


@pytest.mark.parametrize(("state", "word"), [(15, "error_processing"), (2, "inactive"), (4, "finalized")])
def test_a_node_that_leaves_its_state_makes_the_component_faulty(scene: Scene, state: int, word: str) -> None:
    scene.work()
    scene.node.put(state)
    until(lambda: scene.device.state == state)
    scene.bench.run(0.1)
    assert scene.bench.state("vio") is State.FAULTY
    assert f"the node /vio is {word}, not active" in scene.cause


def test_a_node_that_has_failed_is_cleaned_up_and_led_on(scene: Scene) -> None:
    scene.work()
    scene.node.put(2)
    until(lambda: scene.device.state == LifecycleState.INACTIVE)
    scene.bench.run(0.1)
    assert scene.command(Command.INITIALIZE) is State.STANDBY
    assert scene.command(Command.START) is State.WORKING
    assert scene.node.requests == [CONFIGURE, ACTIVATE, CLEANUP, CONFIGURE, ACTIVATE]


def test_a_node_that_leaves_the_graph_makes_the_component_faulty(scene: Scene) -> None:
    scene.work()
    scene.node.leave()
    until(lambda: scene.device.state is None)
    scene.bench.run(0.1)
    assert scene.bench.state("vio") is State.FAULTY
    assert "the node /vio is left, not active" in scene.cause


def test_without_the_node_the_component_is_faulty_with_its_name(tmp_path: Path) -> None:
    with router() as endpoint, Bench() as bench:
        settings = {"node": "/nobody", "router": endpoint}
        row = ComponentRow(name="vio", class_name="x:Y", rate_hz=20.0, settings=settings, begin=Begin.IDLE)
        bench.host(row, lambda: RosNodeSampler(RosLifecycle()))
        bench.command("vio", Command.INITIALIZE)
        assert bench.state("vio") is State.FAULTY
        assert "/nobody is no lifecycle node that answers" in bench.last("components/vio/status").cause
