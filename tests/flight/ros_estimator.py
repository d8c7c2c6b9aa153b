"""An estimator of another maker in ROS 2, for flights in virtual time: its poses go over the wire, one at a time."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.ros_peer import Peer, peer, router, until

from gloc3.clock import VIRTUAL_EPOCH_S
from gloc3_onboard.ros2.sources import RosEstimator
from gloc3_onboard.sensors.devices import Bell, StampedEstimatorPose, Unwatch
from gloc3_onboard.sensors.registry import parse_source
from gloc3_sitl.faults.device_faults import Estimated
from gloc3_sitl.flight import flight as flights
from gloc3_sitl.flight.sim_devices import SimEstimator
from gloc3_sitl.flight.sim_rig import SimRig

TOPIC = "/vio/odometry"


class EstimatorInRos:
    """The simulated estimator's pose, published by another library's node and received by our source.

    Virtual time stands still until a message has arrived, so that every flight receives the same.

    Args:
        simulated: measures.
        source: receives.
        other: publishes.
    """

    def __init__(self, simulated: SimEstimator, source: RosEstimator, other: Peer) -> None:
        self.count = 0
        """Messages that have come over the wire."""
        self._simulated, self._source = simulated, source
        self._publisher = other.publisher(TOPIC, "nav_msgs/msg/Odometry")
        self._other = other
        self._bell = Bell()
        self._now: StampedEstimatorPose | None = None
        simulated.on_new_data(self._pass_on)

    def open(self) -> None:
        self._source.open()
        self._simulated.open()

    def close(self) -> None:
        self._simulated.close()
        self._source.close()

    def on_new_data(self, ready: Callable[[], None]) -> Unwatch:
        return self._bell.listen(ready)

    def estimated_pose(self) -> StampedEstimatorPose | None:
        return self._now

    def _pass_on(self) -> None:
        stamped = self._simulated.estimated_pose()
        if stamped is None or (self._now is not None and stamped.t_s <= self._now.t_s):
            return
        before = self._source.estimated_pose()

        def came() -> StampedEstimatorPose | None:
            now = self._source.estimated_pose()
            if now is before and before is None:
                self._publish(stamped)  # until the subscription is known there
            return now if now is not before else None

        if before is not None:
            self._publish(stamped)
        self._now = until(came)
        self.count += 1
        self._bell.ring()

    def _publish(self, stamped: Estimated) -> None:
        message, pose = self._other.message, stamped.pose
        x, y, z = pose.position_m
        w, i, j, k = pose.world_from_body
        utc_s = VIRTUAL_EPOCH_S + stamped.t_s
        stamp = message("builtin_interfaces/msg/Time", sec=int(utc_s), nanosec=round(stamped.t_s % 1.0 * 1e9) % 10**9)
        turn = message("geometry_msgs/msg/Quaternion", x=i, y=-j, z=-k, w=w)
        at = message("geometry_msgs/msg/Point", x=x, y=-y, z=-z)
        zero = message("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        covariance = np.zeros(36) if not pose.covariance else np.array(pose.covariance)
        placed = message("geometry_msgs/msg/Pose", position=at, orientation=turn)
        twist = message("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        self._publisher.publish(
            header=message("std_msgs/msg/Header", stamp=stamp, frame_id="odom"),
            child_frame_id="base_link",
            pose=message("geometry_msgs/msg/PoseWithCovariance", pose=placed, covariance=covariance),
            twist=message("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )


@contextmanager
def estimator_in_ros(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[EstimatorInRos]]:
    """Has the estimators of flights that begin in the block speak ROS 2; lists them."""
    made: list[EstimatorInRos] = []
    with router() as endpoint, peer(endpoint, folder) as other:

        def rig(*arguments: Any) -> SimRig:
            found, now_s = SimRig(*arguments), arguments[1].time
            url = parse_source("estimator", f"ros2:/{TOPIC}?router={endpoint}")
            simulated = found.devices["estimator"]
            assert isinstance(simulated, SimEstimator)
            made.append(EstimatorInRos(simulated, RosEstimator("estimator", url, now_s), other))
            found.devices["estimator"] = made[-1]  # type: ignore[assignment]
            return found

        monkeypatch.setattr(flights, "SimRig", rig)
        yield made
        for one in made:
            one.close()
