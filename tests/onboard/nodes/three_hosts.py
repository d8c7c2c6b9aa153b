"""One vehicle on three hosts, each a network namespace with its own clock: the vehicle, a vision computer, a base station."""

import asyncio
import fcntl
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

import msgspec
from tests.commands.programs import program
from tests.onboard.nodes.managed import Manager, managed
from tests.onboard.nodes.patrol import begin
from tests.onboard.real_vehicle import flights, station, until

import gloc3_onboard.platforms
from gloc3.ci import Verb
from gloc3.log.reader import LogReader

LOCK: Final = Path(tempfile.gettempdir()) / "gloc3-namespaces.lock"
ROOT: Final = Path(__file__).parents[3]
VEHICLE, VISION, BASE = "vehicle", "vision", "base"
NETS: Final = {VISION: "10.77.1", BASE: "10.77.2"}
GROUND: Final = "10.77.3"
PORT, RELAYED, SENSORS, CAMERAS, AUTOPILOT, STATION = 7447, 7448, 5600, 5601, 14540, 14550
AHEAD_S: Final = {VISION: 5_000, BASE: 70_000}
"""How far their clocks are ahead."""
MISSION: Final = """\
mission: along the wall
frame: hold
geofence: {polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}
on_failure: land
on_link_loss: continue
on_low_battery: land
on_pose_lost: continue
tasks:
  depart: {actions: {up: {take_off: {height_m: 1.5}}}}
  way:
    after: [depart]
    actions:
      way: {follow_waypoints: {waypoints_m: [WAY], speed_m_s: 0.4}}
  recover: {after: [way], actions: {down: {land: {}}}}
"""


def missing() -> str:
    """Why there can be no such namespaces here; empty if there can."""
    try:
        made = _run("ip", "netns", "add", "gloc3-probe", is_checked=False)
        _run("ip", "netns", "del", "gloc3-probe", is_checked=False)
        clock = _run("unshare", "--time", "--monotonic", "1", "true", is_checked=False)
    except OSError as error:
        return f"{error.filename} is not here"
    return "network and time namespaces cannot be made here: it needs Linux and root" if made or clock else ""


def platform(odometer: str) -> str:
    """The Pelican with its stereo odometer on a host, and a quiet fusion on the vehicle that takes what it tells."""
    folder = Path(gloc3_onboard.platforms.__path__[0])
    eyes = {line.split(",")[0].strip()[9:]: line for line in (folder / "pelican.yaml").read_text().splitlines()}
    text = (folder / "pelican_rtk.yaml").read_text()
    hosts = f"hosts: {{{VEHICLE}: {{}}, {VISION}: {{}}, {BASE}: {{on_loss: hold}}}}\n"
    rows = [
        _at(eyes["front_cameras"], VISION),
        _at(eyes["features"], VISION),
        _at(eyes["stereo_odometry"], odometer),
        eyes["pose_standby"]
        .replace("[odometry/stereo, odometry/ground, odometry/laser]", "[odometry/stereo]")
        .replace("position_fix: [position_fix/tracker]", "position_fix: []"),
    ]
    cameras = [line for name, line in eyes.items() if "front_left: {width" in line or "front_right: {width" in line]
    text = text.replace("components:\n", f"{hosts}components:\n" + "\n".join(rows) + "\n", 1)
    at = text.index("\n", text.index("\ncameras:") + 1) + 1
    return text[:at] + "\n".join(cameras) + "\n" + text[at:]


def _at(row: str, host: str) -> str:
    return row.replace("{name: ", f"{{host: {host}, name: ", 1)


class Fault(NamedTuple):
    """Something that is wrong for a while."""

    name: str
    host: str
    begin: Callable[["Hosts"], None]
    end: Callable[["Hosts"], None]
    for_s: float
    is_loss: bool
    """Whether the host must be told to be lost, and then to be here again."""


class Hosts:
    """What a test holds of the three."""

    def __init__(self, folder: Path, relay: subprocess.Popen[str], mains: dict[str, Manager]) -> None:
        self.folder, self.relay, self.mains = folder, relay, mains

    def tell_relay(self, line: str) -> None:
        """Has the relay between vehicle and vision computer do something."""
        assert self.relay.stdin is not None
        self.relay.stdin.write(line + "\n")
        self.relay.stdin.flush()

    def signal(self, host: str, number: int) -> None:
        """Sends a signal to a host's main process and its children."""
        self.mains[host].program.interrupt(number)

    def lines(self, text: str) -> int:
        """How many lines of the vehicle hold a text."""
        return sum(text in line for line in self.mains[VEHICLE].program.lines)


FAULTS: Final = (
    Fault("relay: 0.1 s more, 250 kB/s", VISION, lambda h: h.tell_relay("delay 0.1\nrate 250000"), lambda h: h.tell_relay("heal"), 6.0, False),
    Fault("relay: parted for 10 s", VISION, lambda h: h.tell_relay("partition"), lambda h: h.tell_relay("heal"), 10.0, True),
    Fault("relay: connection reset", VISION, lambda h: h.tell_relay("reset"), lambda _: None, 3.0, False),
    Fault("token bucket of 2 Mbit/s on the line", VISION, lambda _: _tc("add"), lambda _: _tc("del"), 6.0, False),
    Fault("processes stopped for 5 s", VISION, lambda h: h.signal(VISION, signal.SIGSTOP), lambda h: h.signal(VISION, signal.SIGCONT), 5.0, True),
    Fault("processes killed", VISION, lambda h: h.signal(VISION, signal.SIGKILL), lambda _: None, 0.5, True),
)  # fmt: skip
"""In the first flight, on the way to the vision computer, whose loss is ignored."""
BASE_FAULTS: Final = (Fault("line down for 8 s", BASE, lambda _: _line("down"), lambda _: _line("up"), 8.0, True),)
"""In the second flight, on the way to the base station, whose loss means hold."""


class Report(msgspec.Struct, frozen=True):
    """How a flight went."""

    mission: str
    odometer: str
    """Its host."""
    rate_hz: float
    """Of the stereo odometry as it comes to the vehicle while nothing is wrong."""
    delay_s: float
    """Median, from the exposure to its arrival at the vehicle."""
    clock_bounds_s: dict[str, float]
    """Median, by host."""
    faults: dict[str, float]
    """Seconds from the end of each fault until its host was here, -1 where it was not lost."""
    wrong: list[str]
    """Faults that were not told, or not over within half a minute."""
    holds: int
    """How often the loss of a host has the vehicle hold."""


async def fly(
    folder: Path, odometer: str, faults: tuple[Fault, ...], say: Callable[[str], None], calm_s: float = 8.0
) -> Report:
    """Flies with the stereo odometer on a host, and with faults one after the other, after a while without any."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "p.yaml").write_text(platform(odometer))
    length = calm_s + sum(fault.for_s + 10.0 for fault in faults)
    there_and_back = ", ".join(["[3, 0, 1.5], [0, 0, 1.5]"] * max(1, round(length * 0.4 / 6.0)))
    healed: dict[str, float] = {}
    wrong: list[str] = []
    async with three_hosts(folder) as hosts, station(f"udpin://{GROUND}.2:{STATION}", 255) as operator:
        name = await flights.await_platform(operator, None)
        await until(lambda: all(hosts.lines(f"host {host} is here") for host in NETS), 90.0, "all hosts are here")
        await begin(operator, name, MISSION.replace("WAY", there_and_back))

        def known(what: str) -> str:
            found = operator.fleet.get(name)
            told = found.mission.value if found is not None and found.mission is not None else None
            return "" if told is None else str(told.state if what == "mission" else told.tasks.get(what, ""))

        await until(lambda: known("way") == "running", 60.0, "it flies")
        await asyncio.sleep(calm_s)
        begun_s = time.monotonic()
        for fault in faults:
            say(fault.name)
            lost, here = hosts.lines(f"host {fault.host} is lost"), hosts.lines(f"host {fault.host} is here")
            fault.begin(hosts)
            await asyncio.sleep(fault.for_s)
            fault.end(hosts)
            ended_s = time.monotonic()
            try:
                if fault.is_loss:
                    await until(lambda: hosts.lines(f"host {fault.host} is lost") > lost, 10.0, "lost")  # noqa: B023
                    await until(lambda: hosts.lines(f"host {fault.host} is here") > here, 30.0, "here")  # noqa: B023
            except AssertionError as error:
                wrong.append(f"{fault.name}: {error}")
            is_told = hosts.lines(f"host {fault.host} is lost") > lost
            healed[fault.name] = round(time.monotonic() - ended_s, 1) if is_told else -1.0
            if known("mission") == "paused":
                await operator.client.steer(name, Verb.RESUME)
            await asyncio.sleep(5.0)
        await until(lambda: known("mission") in ("done", "failed"), 300.0, "the mission ends")
        end = known("mission")
        await asyncio.to_thread(hosts.mains[VEHICLE].end)
    return _measured(folder, odometer, end, begun_s, healed, wrong)


def _measured(
    folder: Path, odometer: str, end: str, faulted_s: float, healed: dict[str, float], wrong: list[str]
) -> Report:
    with LogReader(folder / "out" / "log-vehicle.mcap") as reader:
        entries = list(reader.entries())
    by_topic: dict[str, list[tuple[float, msgspec.Struct, float]]] = {}
    for entry in entries:
        topic = entry.envelope.topic.partition("/")[2]
        by_topic.setdefault(topic, []).append((entry.now_s, entry.envelope.payload, entry.envelope.t_s))
    way = [now_s for now_s, _, _ in by_topic.get("action_status/waypoints", [])]
    calm = [(now_s, t_s) for now_s, _, t_s in by_topic.get("odometry/stereo", []) if way[0] < now_s < faulted_s]
    bounds = {
        host: round(median(status.clock_bound_s for _, status, _ in by_topic[f"hosts/{host}"]), 5)  # type: ignore[attr-defined]
        for host in NETS
    }
    told = [event.text for _, event, _ in by_topic.get("ci/event", [])]  # type: ignore[attr-defined]
    return Report(
        mission=end,
        odometer=odometer,
        rate_hz=round(len(calm) / max(1.0, faulted_s - way[0]), 1),
        delay_s=round(median(now_s - t_s for now_s, t_s in calm), 3) if calm else -1.0,
        clock_bounds_s=bounds,
        faults=healed,
        wrong=wrong,
        holds=sum("is lost" in text and "policy: hold" in text for text in told),
    )


@asynccontextmanager
async def three_hosts(folder: Path) -> AsyncIterator[Hosts]:
    """The namespaces, the simulated vehicle, the relay, and the three main processes."""
    with ExitStack() as stack:
        stack.enter_context(namespaces())
        _network(folder)
        inside = _in(VEHICLE)
        link = f"companion=udpout://127.0.0.1:{AUTOPILOT}"
        sitl = ("sitl", "--link", link, "--sensors", str(SENSORS))
        stack.enter_context(program(*sitl, folder=folder, before=inside))
        stack.enter_context(_relay(inside, f"{NETS[VISION]}.1:{CAMERAS}", f"127.0.0.1:{SENSORS}"))
        relay = stack.enter_context(_relay(_in(VISION), f"127.0.0.1:{RELAYED}", f"{NETS[VISION]}.1:{PORT}"))
        mains = {}
        for host in (VEHICLE, *NETS):
            words = ["onboard", "p.yaml", "--host", host, "--network", f"net/pelican.{host}/network.yaml"]
            words += ["--out", "out"]
            if host == VEHICLE:
                words += ["--autopilot", f"udpin://127.0.0.1:{AUTOPILOT}"]
                words += ["--station", f"udpout://{GROUND}.2:{STATION}"]
            if host == VISION:
                words += ["--device", f"stereo_camera=tcp://{NETS[VISION]}.1:{CAMERAS}"]
            clock = ("unshare", "--time", "--monotonic", str(AHEAD_S[host])) if host in AHEAD_S else ()
            mains[host] = stack.enter_context(managed(words, folder, (*_in(host), *clock)))
        yield Hosts(folder, relay, mains)
        for host in NETS:
            await asyncio.to_thread(mains[host].end)


@contextmanager
def namespaces() -> Iterator[None]:
    """Three hosts, the vehicle joined with each of the others and with this computer by a line of its own.

    Their names and addresses are this computer's: one test at a time has them.
    """
    with LOCK.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield from _joined()


def _joined() -> Iterator[None]:
    _clear()
    try:
        for host in (VEHICLE, *NETS):
            _run("ip", "netns", "add", _name(host))
            _run("ip", "-n", _name(host), "link", "set", "lo", "up")
        for host, net in NETS.items():
            _run("ip", "link", "add", host[:6] + "-v", "netns", _name(VEHICLE), "type", "veth", "peer", "name", "wire", "netns", _name(host))  # fmt: skip
            _raise(_name(VEHICLE), host[:6] + "-v", f"{net}.1")
            _raise(_name(host), "wire", f"{net}.2")
        _run("ip", "link", "add", "gloc3-g", "type", "veth", "peer", "name", "ground", "netns", _name(VEHICLE))
        _raise(_name(VEHICLE), "ground", f"{GROUND}.1")
        _run("ip", "addr", "add", f"{GROUND}.2/24", "dev", "gloc3-g")
        _run("ip", "link", "set", "gloc3-g", "up")
        yield
    finally:
        _clear()


def _raise(space: str, device: str, address: str) -> None:
    _run("ip", "-n", space, "addr", "add", f"{address}/24", "dev", device)
    _run("ip", "-n", space, "link", "set", device, "up")


def _clear() -> None:
    for host in (VEHICLE, *NETS):
        _run("ip", "netns", "del", _name(host), is_checked=False)
    _run("ip", "link", "del", "gloc3-g", is_checked=False)


def _tc(word: str) -> None:
    more = ("tbf", "rate", "2mbit", "burst", "16kb", "latency", "200ms") if word == "add" else ()
    _run("tc", "-n", _name(VISION), "qdisc", word, "dev", "wire", "root", *more)


def _line(word: str) -> None:
    _run("ip", "-n", _name(BASE), "link", "set", "wire", word)


def _network(folder: Path) -> None:
    """Network files: the vision computer connects through the relay."""
    reach = (f"127.0.0.1:{RELAYED}", f"{NETS[BASE]}.1:{PORT}")
    for words in (
        ("init", "net"),
        (
            "add",
            "net",
            f"pelican.{VEHICLE}",
            "--role",
            "platform",
            "--listen",
            f"0.0.0.0:{PORT}",
            "--reached-at",
            "HERE",
        ),
        ("add", "net", f"pelican.{VISION}", "--role", "platform"),
        ("add", "net", f"pelican.{BASE}", "--role", "platform"),
    ):
        with program("network", *(reach[0] if word == "HERE" else word for word in words), folder=folder) as done:
            assert done.end() == 0, done.text
    file = folder / "net" / f"pelican.{BASE}" / "network.yaml"
    file.write_text(file.read_text().replace(*reach))


@contextmanager
def _relay(before: tuple[str, ...], listen: str, to: str) -> Iterator["subprocess.Popen[str]"]:
    words = [*before, sys.executable, "-m", "tests.onboard.nodes.relay", listen, to]
    running = subprocess.Popen(words, cwd=ROOT, stdin=subprocess.PIPE, text=True)
    try:
        yield running
    finally:
        running.kill()
        running.wait()
        assert running.stdin is not None
        running.stdin.close()


def _in(host: str) -> tuple[str, ...]:
    return ("ip", "netns", "exec", _name(host))


def _name(host: str) -> str:
    return f"gloc3-{host}"


def _run(*words: str, is_checked: bool = True) -> int:
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert not (is_checked and done.returncode), f"{' '.join(words)}: {done.stderr}"
    return done.returncode


__all__ = ["BASE", "BASE_FAULTS", "FAULTS", "VISION", "Report", "fly", "missing"]
