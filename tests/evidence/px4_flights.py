"""What befalls a real PX4 with its own physics in flight, each told as the operator at a headless station reads it."""

import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import msgspec
from tests.commands.programs import Program
from tests.evidence.px4_beside import beside
from tests.onboard.autopilot.test_real_vtols import MISSION as ON_WINGS
from tests.onboard.autopilot.test_real_vtols import PLATFORM as VTOL
from tests.onboard.autopilot.test_real_vtols import PX4 as VTOL_PARAMETERS
from tests.onboard.real_px4 import MISSION, PLATFORM, RealPx4, under_way

DONE, NOT_DONE, LANDED_BY_OTHERS = 0, 1, 3
"""Exit codes of a headless station."""
STOPPED_S: Final = 4.0
PLANE_S: Final = 400.0
BOX_S: Final = 40.0


class Told(msgspec.Struct, frozen=True):
    """How a flight went."""

    said: str
    """What an operator reads of it."""
    problem: str = ""
    """Empty where everything was as it must be."""


class Flight:
    """A PX4 that is on, an onboard process and a station that has begun a mission."""

    def __init__(self, px4: RealPx4, onboard: Program, station: Program) -> None:
        self.px4, self.onboard, self.station = px4, onboard, station

    def await_words(self, *words: str, within_s: float = 60.0) -> str:
        """The first line of the station that holds all the words."""
        return plain(self.station.await_line(lambda line: all(word in line for word in words), within_s))

    def end(self, code: int = DONE) -> str:
        """The station's last words, where it ends with this exit code."""
        assert self.station.end() == code, f"exit code {self.station.process.returncode}: {self.station.text}"
        return plain(self.station.lines[-1])


def plain(line: str) -> str:
    """A line of narration without its time and the platform's name."""
    return line.partition(" s  ")[2].removeprefix("heron").strip() or line


@contextmanager
def flying(
    px4: RealPx4, mission: str = MISSION, *, links: Sequence[str] = (), action: str = "go.way", after_s: float = 4.0
) -> Iterator[Flight]:
    """A mission that is some seconds into an action."""
    px4.make_platform()
    px4.write_mission(mission)
    with px4.onboard(*links) as onboard, px4.station() as station:
        try:
            under_way(station, action, after_s)
            yield Flight(px4, onboard, station)
        finally:
            (px4.folder / "station.txt").write_text(station.text)
            (px4.folder / "onboard.txt").write_text(onboard.text)


# --- what an operator does ---


def two_missions(px4: RealPx4) -> str:
    """One after the other, with the same boot of the autopilot and the same onboard process."""
    px4.make_platform()
    with px4.onboard():
        ends = [plain(px4.fly().lines[-1]) for _ in range(2)]
    return " · ".join(ends)


def paused(px4: RealPx4) -> str:
    """It stands while it is paused."""
    with flying(px4) as flight:
        flight.station.tell("pause")
        pause = flight.await_words("paused")
        time.sleep(6.0)
        flight.station.tell("resume")
        return f"{pause} · {flight.end()}"


def skipped(px4: RealPx4) -> str:
    """The task is left out; the tasks behind it are flown."""
    with flying(px4) as flight:
        flight.station.tell("skip go")
        skip = flight.await_words("task go", "skipped")
        return f"{skip} · {flight.end()}"


def aborted(px4: RealPx4) -> str:
    """It lands, by `on_failure`, and is disarmed."""
    with flying(px4) as flight:
        flight.station.tell("abort")
        end = flight.end(NOT_DONE)
        flight_ends(flight)
        return end


def flight_ends(flight: Flight, within_s: float = 60.0) -> None:
    """Waits until the vehicle stands disarmed, by PX4's own word."""
    limit_s = time.monotonic() + within_s
    while "Disarmed" not in flight.px4.shell("commander", "status"):
        assert time.monotonic() < limit_s, f"it is still armed: {flight.onboard.text}"
        time.sleep(1.0)


# --- pilots, and what ends in between ---


def pilot(px4: RealPx4) -> str:
    """Somebody else commands Hold; the operator resumes."""
    with flying(px4) as flight:
        px4.shell("commander", "mode", "auto:loiter")
        taken = flight.await_words("pilot has control")
        time.sleep(5.0)
        flight.station.tell("resume")
        return f"{taken} · {flight.end()}"


def pilot_lands(px4: RealPx4) -> str:
    """Somebody else lands it."""
    with flying(px4) as flight:
        px4.shell("commander", "mode", "auto:land")
        return flight.end(LANDED_BY_OTHERS)


def onboard_killed(px4: RealPx4) -> str:
    """By SIGKILL; another is started 3 s later."""
    px4.make_platform()
    with px4.station() as station:
        with px4.onboard() as first:
            under_way(station)
            first.interrupt(signal.SIGKILL)
            first.end()
        time.sleep(3.0)
        with px4.onboard() as second:
            flight = Flight(px4, second, station)
            back = flight.await_words("restarted", within_s=30.0)
            return f"{back} · {flight.end()}"


def onboard_stopped(px4: RealPx4) -> str:
    """By SIGSTOP."""
    with flying(px4) as flight:
        flight.onboard.interrupt(signal.SIGSTOP)
        time.sleep(STOPPED_S)
        flight.onboard.interrupt(signal.SIGCONT)
        end = flight.end()
        assert "pilot has control" not in flight.station.text, flight.station.text
        return f"{flight.await_words('stalled')} · {end}"


def rebooted_on_the_ground(px4: RealPx4) -> str:
    """Its program ends and is started again between two missions of one onboard process."""
    px4.make_platform()
    with px4.onboard(), px4.watcher() as watcher:
        px4.fly()
        px4.kill()
        gone = plain(watcher.await_line(lambda line: "autopilot has gone" in line, 20.0))
        px4.start()
        back = plain(watcher.await_line(lambda line: "autopilot has restarted" in line, 60.0))
        return f"{gone} · {back} · {plain(px4.fly().lines[-1])}"


def killed_in_the_air(px4: RealPx4) -> str:
    """The simulated vehicle ends with it: after its start it stands at home. The next mission is flown."""
    with flying(px4) as flight, px4.watcher() as watcher:
        px4.kill()
        gone = flight.await_words("autopilot has gone", within_s=20.0)
        px4.start()
        end = flight.end(NOT_DONE)
        back = plain(watcher.await_line(lambda line: "autopilot has restarted" in line, 60.0))
        return f"{gone} · {end} · {back} · {plain(px4.fly().lines[-1])}"


# --- what fails ---


def link_lost(px4: RealPx4) -> str:
    """The station is killed; with `on_link_loss: return` it comes home, lands and is disarmed."""
    mission = MISSION.replace("on_link_loss: continue", "on_link_loss: return").replace(
        "[8, 8, 3]", "[8, 8, 3], [0, 8, 3]"
    )
    with flying(px4, mission) as flight, px4.watcher() as watcher:
        watcher.await_line(lambda line: "heard" in line)
        flight.station.interrupt(signal.SIGKILL)
        lost = plain(watcher.await_line(lambda line: "policy" in line or "link loss" in line, 30.0))
        flight_ends(flight)
        return f"{lost} · {plain(watcher.lines[-1])}"


def battery_low(px4: RealPx4) -> str:
    """Its simulated battery drains; with `on_low_battery: return` it comes home and lands."""
    with flying(px4, after_s=2.0) as flight:
        px4.shell("param", "set", "SIM_BAT_DRAIN", "12")
        low = flight.await_words("low battery", "is left", within_s=90.0)
        return f"{low} · {flight.end(NOT_DONE)}"


def satellites_lost(px4: RealPx4) -> str:
    """Its receiver falls silent: its own failsafe lands it at once."""
    with flying(px4) as flight:
        px4.shell("sensor_gps_sim", "stop")
        end = flight.end(LANDED_BY_OTHERS)
        flight_ends(flight)
        return end


# --- what PX4 does by itself, and other people's software ---


IN_A_FENCE: Final = """\
mission: in a fence
frame: geo
on_failure: land
on_link_loss: continue
on_low_battery: return
on_pose_lost: land
geofence: {polygon: [[47.3976, 8.5454], [47.3976, 8.5459], [47.39795, 8.5459], [47.39795, 8.5454]]}
tasks:
  depart: {actions: {climb: {take_off: {height_m: 3}}}}
  go: {after: [depart], actions: {way: {go_to: {position: [47.39785, 8.545594, 3], speed_m_s: 1}}}}
  recover: {after: [go], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""


AREA: Final = "frame: site\ngeofence: {polygon_m: [[-15, -15], [25, -15], [25, 25], [-15, 25]]}"


def sent_beyond_the_fence(px4: RealPx4) -> str:
    """Another station sends it beyond the fence that PX4 holds, too; the operator resumes."""
    with flying(px4, MISSION.replace("frame: site", AREA), links=[px4.other_link]) as flight, beside(px4) as other:
        other.go_to(40.0, 0.0)
        refused = flight.await_words("outside geofence", within_s=10.0)
        time.sleep(5.0)
        assert "fence breached" not in flight.station.text, flight.station.text
        flight.station.tell("resume")
        return f"{refused} · {flight.end()}"


def led_out_of_the_fence(px4: RealPx4) -> str:
    """Another station clears PX4's fence, sends the vehicle beyond ours, and leaves: nobody is in charge."""
    with flying(px4, MISSION.replace("frame: site", AREA), links=[px4.other_link]) as flight:
        with beside(px4) as other:
            other.clear_fence()
            other.go_to(40.0, 0.0)
            breach = flight.await_words("fence breached", within_s=40.0)
        left = flight.await_words("neither a transmitter nor another station", within_s=45.0)
        return f"{breach} · {left} · {flight.end(NOT_DONE)}"


def fence_without_action(px4: RealPx4) -> str:
    """A mission that has a fence is not started."""
    px4.make_platform()
    px4.shell("param", "set", "GF_ACTION", "0")
    px4.write_mission(IN_A_FENCE)
    with px4.onboard(), px4.station() as station:
        assert station.end() == NOT_DONE, station.text
        return plain(next(line for line in station.lines if "GF_ACTION" in line))


def plan(px4: RealPx4) -> str:
    """The way is a plan that PX4 flies in its mission mode."""
    by_px4 = MISSION.replace("go: {after: [depart],", "go: {after: [depart], flown_by: autopilot,")
    with flying(px4, by_px4, after_s=0.0) as flight:
        mode = flight.await_words("AUTO.MISSION", within_s=20.0)
        return f"{mode} · {flight.end()}"


def services(px4: RealPx4) -> str:
    """MAVSDK on a link of the onboard process, while a mission is flown: telemetry, parameters, files, and then the ULog."""
    with flying(px4, links=[px4.other_link]) as flight, beside(px4) as other:
        found = [other.height(), other.parameter("MPC_XY_VEL_MAX", 9.0), other.file("etc/extras/all_events.json.xz")]
        end = flight.end()
        return " · ".join([end, *found, other.ulog(px4.folder / "fetched.ulg")])


FIELD: Final = """\
mission: a field
frame: site
on_failure: land
on_link_loss: continue
on_low_battery: return
on_pose_lost: land
on_restart: continue
tasks:
  depart: {actions: {off: {take_off: {height_m: 50}}}}
  go:
    after: [depart]
    actions: {way: {follow_waypoints: {waypoints_m: [[300, 0, 60], [300, 200, 60], [0, 200, 60]], speed_m_s: 15}}}
  wait: {after: [go], actions: {stay: {hold: {duration_s: 15}}}}
  recover: {after: [wait], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""


def airplane(px4: RealPx4) -> str:
    """Its ways are plans of PX4."""
    with flying(px4, FIELD, after_s=0.0) as flight:
        limit_s = time.monotonic() + PLANE_S
        while flight.station.process.poll() is None and time.monotonic() < limit_s:
            time.sleep(1.0)
        return flight.end()


BOX: Final = """\
mission: a box
frame: site
on_failure: land
on_link_loss: continue
on_low_battery: return
on_pose_lost: land
tasks:
  depart: {actions: {climb: {take_off: {height_m: 3}}}}
  go:
    after: [depart]
    actions: {way: {follow_waypoints: {waypoints_m: [[5, 0, 3], [5, 5, 3], [0, 5, 3]], speed_m_s: 1.5}}}
  recover: {after: [go], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""


def box(px4: RealPx4) -> str:
    """How long it takes with the platform file that `gloc3 platform new` makes."""
    px4.make_platform()
    px4.write_mission(BOX)
    with px4.onboard(), px4.station() as station:
        code = station.end()
        (px4.folder / "station.txt").write_text(station.text)
        assert code == DONE, station.text

        def at_s(words: str) -> float:
            return float(next(line for line in station.lines if words in line).split()[0])

        whole_s = float(station.lines[-1].split()[0]) - at_s("the mission is started")
        legs_s = at_s("action go.way: done") - at_s("action go.way: running")
    said = f"{whole_s:.0f} s from the start until it stands disarmed, {legs_s:.0f} s of them for the three legs"
    assert whole_s <= BOX_S, said
    return said


def vtol(px4: RealPx4) -> str:
    """The forms in which it flies, as the station names them."""
    (px4.folder / f"{PLATFORM}.yaml").write_text(VTOL.format(cruise=10.0, least=7.0, most=12.0, transition=80.0))
    px4.write_mission(ON_WINGS)
    with px4.onboard(), px4.station() as station:
        limit_s = time.monotonic() + PLANE_S
        while station.process.poll() is None and time.monotonic() < limit_s:
            time.sleep(1.0)
        (px4.folder / "station.txt").write_text(station.text)
        assert station.end() == DONE, station.text
        modes = [
            "AUTO" + line.partition(" mode AUTO")[2].partition(", autopilot")[0]
            for line in station.lines
            if " mode AUTO" in line
        ]
        assert any("on wings" in mode for mode in modes), station.text
        return f"{', then '.join(dict.fromkeys(modes))} · {plain(station.lines[-1])}"


FLIGHTS: Final[Mapping[str, tuple[Callable[[RealPx4], str], str]]] = {
    "two missions in one boot": (two_missions, "both done"),
    "pause, and resume": (paused, "it stands; then done"),
    "skip a task": (skipped, "skipped; the tasks behind it done"),
    "abort": (aborted, "aborted, landed, disarmed"),
    "a pilot takes over, and gives back": (pilot, "named as a pilot; resumed, done"),
    "a pilot lands": (pilot_lands, "ends with exit code 3"),
    "onboard process killed in flight, another started after 3 s": (onboard_killed, "done"),
    "onboard process stopped for 4 s in flight": (onboard_stopped, "no pilot; done"),
    "autopilot restarted on the ground": (rebooted_on_the_ground, "gone, back; the next mission done"),
    "autopilot killed in the air": (killed_in_the_air, "gone, failed, back; the next mission done"),
    "link to the station lost": (link_lost, "returned, landed, disarmed"),
    "battery low": (battery_low, "returned, landed"),
    "satellites lost": (satellites_lost, "landed by PX4's failsafe, named as it: exit code 3"),
    "sent beyond the fence by another station": (sent_beyond_the_fence, "PX4 refuses, and the operator reads it; done"),
    "led out of the fence by another station that clears PX4's, and leaves": (
        led_out_of_the_fence,
        "told; lands after 30 s with nobody there",
    ),
    "PX4 does nothing at its fence": (fence_without_action, "not started; why, and what to set"),
    "plan flown by the autopilot": (plan, "in its mission mode; done"),
    "MAVSDK, parameters, files and ULog through the router": (services, "all of them beside a mission that is done"),
    "a box of three legs of 5 m at 1.5 m/s": (box, f"done within {BOX_S:g} s, take-off and landing included"),
    "airplane: take-off, way, hold, return, landing": (airplane, "done"),
    "standard VTOL: take-off on rotors, way on rotors and on wings, return, landing": (vtol, "done"),
}
"""By what befalls it, with what must be. Those that are no quadrotors say so."""
MODELS: Final = {
    "airplane: take-off, way, hold, return, landing": "sihsim_airplane",
    "standard VTOL: take-off on rotors, way on rotors and on wings, return, landing": "sihsim_standard_vtol",
}
PARAMETERS: Final[Mapping[str, Mapping[str, float]]] = {
    "battery low": {"SIM_BAT_MIN_PCT": 5.0, "COM_LOW_BAT_ACT": 0.0},
    "standard VTOL: take-off on rotors, way on rotors and on wings, return, landing": VTOL_PARAMETERS,
    "airplane: take-off, way, hold, return, landing": {"MIS_TKO_LAND_REQ": 0.0, "LNDFW_ROT_MAX": 5.0},
}
"""What PX4 is to be set to for one of them. The noise of the plane's simulated gyros (0.1 to 0.8 °/s) is above the 0.5 °/s below
which PX4's detector takes a plane for landed, so that no landing of it would ever end."""


def what_must_be(title: str) -> str:
    """Of a flight."""
    return FLIGHTS[title][1]


def fly(title: str, folder: Path, instance: int) -> Told:
    """One of them, with a PX4 of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        model = MODELS.get(title, "sihsim_quadx")
        with RealPx4(folder, model, instance, PARAMETERS.get(title)) as px4:
            return Told(FLIGHTS[title][0](px4))
    except (AssertionError, subprocess.TimeoutExpired) as error:
        (folder / "problem.txt").write_text(str(error))
        return Told("", "; ".join(str(error).strip().splitlines()[-2:]))
