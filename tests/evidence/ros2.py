"""ROS 2 without a ROS installation: bytes, hashes, a bag, a bridged vehicle, and a flight by another node's odometry."""

import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import pytest
from ros2_pyterfaces.core import hash_rihs01
from ros2_pyterfaces.core.lifecycle_msgs import srv as lifecycle
from ros2_pyterfaces.core.std_srvs import srv as standard
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from tests.common.ros2.test_wire import MESSAGES, plain, sample
from tests.evidence.page import ROOT, Bar, Figure, Progress
from tests.evidence.suites import suite
from tests.flight.card import Card
from tests.flight.ros_estimator import estimator_in_ros
from tests.flight.test_flying_by_an_external_estimator import BOXED, SWEEP
from tests.flight.test_flying_on_our_own_pose import errors_m
from tests.ros_peer import STORE, TRIGGER, Peer, peer, router, until

from gloc3.ros2.cdr import decoder, encoder
from gloc3.ros2.definitions import DEFINITIONS
from gloc3.ros2.type_hash import full_name, message_hash, service_hash
from gloc3_sitl.demo.demo import free_ports

GLOC3: Final = str(Path(sys.executable).with_name("gloc3"))
DISTRIBUTIONS: Final = (Stores.ROS2_IRON, Stores.ROS2_JAZZY, Stores.ROS2_KILTED, Stores.ROS2_LYRICAL)
SERVICES: Final = {
    "std_srvs/Trigger": standard.Trigger,
    "lifecycle_msgs/ChangeState": lifecycle.ChangeState,
    "lifecycle_msgs/GetState": lifecycle.GetState,
}
WATCHED: Final = {
    "/pelican/pose": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/pelican/battery": "sensor_msgs/msg/BatteryState",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}
WATCHED_S: Final = 10.0
MAX_M: Final = 0.25
TESTS: Final = [
    "tests/common/ros2",
    "tests/groundstation/ros2",
    "tests/onboard/ros2",
    "tests/flight/test_flying_by_an_estimator_in_ros.py",
]


def same_bytes() -> list[int]:
    """Types whose messages rosbags decodes to our values and encodes to our bytes, of how many."""
    same = 0
    for kind in MESSAGES:
        data = encoder(kind)(sample(kind))
        read = STORE.deserialize_cdr(data, full_name(kind))
        same += plain(read) == plain(decoder(kind)(data)) and STORE.serialize_cdr(read, full_name(kind)) == data
    return [same, len(MESSAGES)]


def same_hashes() -> dict[str, list[int]]:
    """By the distribution: types with its hash, of how many."""
    found = {}
    for name in DISTRIBUTIONS:
        types = get_typestore(name)
        known = [kind for kind in MESSAGES if full_name(kind) in types.types]
        same = sum(message_hash(kind) == types.hash_rihs01(full_name(kind)) for kind in known)
        found[name.name.removeprefix("ROS2_").title()] = [same, len(known)]
    same = sum(service_hash(kind) == hash_rihs01(one) for kind, one in SERVICES.items())
    return found | {"services, by ros2-pyterfaces": [same, len(SERVICES)]}


def bag() -> list[int]:
    """Messages of a flight's bag that rosbags reads by ROS's own types, of how many."""
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        for arguments in (
            ("fly", "hop", "--out", run, "--quiet"),
            ("log", "convert", run, "--to", "rosbag2", "--out", run / "bag"),
        ):
            subprocess.run([GLOC3, *map(str, arguments)], cwd=ROOT, check=True, capture_output=True)
        types = get_typestore(Stores.ROS2_JAZZY)
        with AnyReader([run / "bag"], default_typestore=types) as reader:
            read = sum(types.deserialize_cdr(data, one.msgtype) is not None for one, _, data in reader.messages())
            return [read, reader.message_count]


@contextmanager
def vehicle(endpoint: str, folder: Path) -> Iterator[None]:
    """A simulated vehicle, its companion and the bridge, each a process."""
    to_station, to_companion = free_ports(2, socket.SOCK_DGRAM)
    commands = (
        ("sitl", "--link", f"udpout://127.0.0.1:{to_companion}"),
        ("onboard", "pelican_rtk", "--autopilot", f"udpin://127.0.0.1:{to_companion}", "--out", folder / "onboard",
         "--station", f"udpout://127.0.0.1:{to_station}"),
        ("ros2", "--link", f"udpin://127.0.0.1:{to_station}", "--router", endpoint, "--mission", "hop"),
    )  # fmt: skip
    with ExitStack() as stack:
        for command in commands:
            log = stack.enter_context((folder / f"{command[0]}.log").open("w"))
            process = subprocess.Popen([GLOC3, *map(str, command)], cwd=folder, stdout=log, stderr=log)
            stack.callback(process.wait)
            stack.callback(process.terminate)
        yield


def bridged() -> dict[str, Any]:
    """What other nodes receive from the vehicle, and what becomes of the mission that they command."""
    with tempfile.TemporaryDirectory() as name, router() as endpoint:
        folder = Path(name)
        definitions = folder / "definitions"
        with peer(endpoint, definitions) as other, vehicle(endpoint, folder):
            received = {topic: other.subscribe(topic, kind) for topic, kind in WATCHED.items()}
            until(lambda: all(received.values()), 120.0)
            begin = {topic: len(found) for topic, found in received.items()}
            time.sleep(WATCHED_S)
            rates = {topic: (len(found) - begin[topic]) / WATCHED_S for topic, found in received.items()}
            until(lambda: all(one.level == 0 for one in received["/diagnostics"][-1].status), 120.0)
            components = sorted(one.name for one in received["/diagnostics"][-1].status)
            started = call(other, "start")
            until(lambda: call(other, "state")[1].startswith("running"), 60.0)
            answers = [started, *(call(other, verb) for verb in ("pause", "resume"))]
            until(lambda: call(other, "state")[1].startswith("done"), 120.0)
            highest_m = max(one.pose.pose.position.z for one in received["/pelican/pose"])
            refused = call(other, "resume")
            return {
                "rates": rates,
                "components": len(components),
                "answers": [success for success, _ in answers],
                "highest_m": highest_m,
                "refused": refused,
            }


def call(other: Peer, name: str) -> tuple[bool, str]:
    """Calls a service of the vehicle."""
    answer = other.call(f"/pelican/mission/{name}", "std_srvs/srv/Trigger", TRIGGER)
    return (answer.success, answer.message) if answer is not None else (False, "no answer")


def flown() -> dict[str, Any]:
    """A flight in virtual time by the odometry of a node, which comes over a real session."""
    with tempfile.TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        folder = Path(name)
        with estimator_in_ros(folder / "definitions", patch) as estimators:
            card = Card("px4", folder)
            try:
                card.begin(SWEEP, platform=BOXED)
                took_s = card.await_state("mission", "done", 60.0)
                states = card.received["fusion/primary"][-1].payload.sources
                found = errors_m(card)
                return {
                    "took_s": took_s,
                    "used": sorted(state.source for state in states if state.is_used),
                    "worst_m": max(found),
                    "mean_m": sum(found) / len(found),
                    "messages": estimators[0].count,
                }
            finally:
                card.close()


def figures(progress: Progress) -> list[Figure]:
    """All of them."""
    same, all_ = progress.part("bytes", same_bytes)
    found = [Figure("types whose bytes are those of rosbags", f"{same} of {all_}", "all", same == all_ > 0)]
    for name, (same, all_) in progress.part("hashes", same_hashes).items():
        found.append(Figure(f"type hashes of {name}", f"{same} of {all_}", "all", same == all_ > 0))
    found.append(Figure("definitions", str(len(DEFINITIONS))))
    read, all_ = progress.part("bag", bag)
    text = f"{read:,} of {all_:,}"
    found.append(Figure("messages of a flight's bag that rosbags reads by ROS's types", text, "all", read == all_ > 0))
    live = progress.part("bridged", bridged)
    for topic, rate_hz in live["rates"].items():
        least = 0.5 if topic == "/diagnostics" else 2.0
        found.append(Figure(f"bridged vehicle: {topic}", f"{rate_hz:.1f} Hz", f"> {least:g} Hz", rate_hz > least))
    found.append(
        Figure("components in /diagnostics, all of them well", str(live["components"]), "> 10", live["components"] > 10)
    )
    answers = live["answers"]
    found.append(Figure("services start, pause and resume", f"{sum(answers)} of 3 succeed", "all", all(answers)))
    height_m = live["highest_m"]
    found.append(
        Figure("height that the pose in ROS shows in that mission", f"{height_m:.2f} m", "> 1 m", height_m > 1.0)
    )
    success, reason = live["refused"]
    found.append(
        Figure("resume of a mission that is done", reason, "refused with a reason", not success and bool(reason))
    )
    flight = progress.part("flown", flown)
    found += [
        Figure("flight by a node's odometry", f"done after {flight['took_s']:.1f} s", "done"),
        Figure("messages over the wire in it", f"{flight['messages']:,}", "> 600", flight["messages"] > 600),
        Figure(
            "sources of the pose",
            ", ".join(flight["used"]),
            "external, height, imu",
            flight["used"] == ["external", "height", "imu"],
        ),
        Figure("mean pose error", f"{1000.0 * flight['mean_m']:.0f} mm"),
        Figure(
            "largest pose error",
            f"{1000.0 * flight['worst_m']:.0f} mm",
            f"< {1000.0 * MAX_M:.0f} mm",
            flight["worst_m"] < MAX_M,
        ),
    ]
    return [*found, *suite("ros2", TESTS)(progress)]


BARS: Final = (
    Bar(
        "ros2",
        "Nodes of ROS 2 see and command vehicles, and are sensors and components of them",
        "GLOC3 speaks the wire of rmw_zenoh without a ROS installation. Bytes and hashes are those of rosbags and "
        "ros2-pyterfaces. The nodes on the other side are those of ROBOTIS' zenoh-ros2-sdk, over real Zenoh sessions and "
        "a Zenoh router. Not tried: an installation of ROS 2, its own router, and nodes written with rclcpp or rclpy.",
        figures,
        seeds="0",
    ),
)
