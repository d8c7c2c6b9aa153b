"""The driver as its host sees it: a stop in flight is refused, a fault leaves hold, a standby takes over in time."""

from typing import Any

from tests.onboard.messages import LIMITS, autopilot_pose, grant, pose, setpoint
from tests.onboard.scripted_autopilot import ScriptedAutopilot

from gloc3.component.deployment import ComponentRow
from gloc3.component.lci import State
from gloc3.component.test_bench import Bench
from gloc3.messages.vehicle import DriverState, FlightMode, Setpoint, TakeOver
from gloc3_onboard.components.drivers.autopilot import AutopilotDriver

PORTS: dict[str, str | list[str]] = {"primary": "driver"}


class Flight:
    """A primary and a quiet standby on one flying autopilot."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.autopilot = ScriptedAutopilot("px4")
        rows: list[dict[str, Any]] = [
            {"name": "driver"},
            {"name": "standby", "begin": "quiet", "standby_for": "driver"},
        ]
        for row in rows:
            given = ComponentRow(class_name="x:Driver", rate_hz=20.0, trigger="setpoint", ports=PORTS, **row)
            bench.host(given, lambda: AutopilotDriver(self.autopilot))
        self.wanted: Setpoint = setpoint()
        bench.send("limits", LIMITS)
        bench.send("grant", grant())
        self.run(0.2)
        self.autopilot.fly()
        self.run(0.2)
        bench.send("take_over", TakeOver(is_resumed=True))
        self.run(2.0)
        assert bench.last("driver").is_guided

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            state = self.autopilot.tick(self.bench.loop.time())
            for topic, message in (("pose", pose()), ("autopilot_pose", autopilot_pose()), ("autopilot", state)):
                self.bench.send(topic, message)
            self.bench.send("setpoint", self.wanted)
            self.bench.run(0.05)


def test_a_stop_in_flight_is_refused_until_hold_is_confirmed() -> None:
    with Bench() as bench:
        flight = Flight(bench)
        reply = bench.command("driver", "stop")
        assert not reply.is_accepted
        assert "ask again when it is confirmed" in reply.reason
        assert bench.state("driver") is State.WORKING
        flight.run(0.5)
        assert flight.autopilot.reported.mode is FlightMode.HOLD
        assert bench.command("driver", "stop").is_accepted


def test_a_fault_in_flight_leaves_hold_and_a_standby_goes_on_within_a_tenth_of_a_second() -> None:
    with Bench() as bench:
        flight = Flight(bench)
        flight.autopilot.setpoints.clear()

        def fail(*_: object) -> None:
            raise OSError("line broken")

        works, flight.autopilot.send_setpoint = flight.autopilot.send_setpoint, fail  # type: ignore[method-assign,assignment]
        flight.run(0.05)
        failed_s = bench.loop.time()
        assert bench.state("driver") is State.FAULTY
        assert flight.autopilot.commands[-1] == "mode hold"
        flight.autopilot.send_setpoint = works  # type: ignore[method-assign]
        assert bench.command("standby", "resume").is_accepted
        flight.run(0.1)
        assert flight.autopilot.setpoints[0][0] - failed_s <= 0.1
        flight.run(2.0)
        last = bench.last("driver")
        assert isinstance(last, DriverState)
        assert last.is_guided
        assert not last.has_pilot_control
