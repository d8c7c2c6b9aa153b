"""The AUV goes out of contact: silent as planned, an event below, up away from the plan, the summary, then its log."""

import asyncio
import hashlib
import json
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from math import hypot
from pathlib import Path
from typing import Any, Final

import msgspec
from tests.evidence.page import ROOT, SCRATCH, Bar, Figure, Progress
from tests.sitl.relay import Relay

from gloc3.clock import VirtualLoop
from gloc3.errors import Gloc3Error
from gloc3.exchange.acoustic import MOST_BYTES
from gloc3.mavlink.message import Address
from gloc3.mavlink.transport.memory import Conditions
from gloc3.messages.envelope import Envelope
from gloc3.mission.model.model import digest_of
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station import wording
from gloc3_groundstation.store.contact_queue import ContactQueue
from gloc3_groundstation.store.log_pull import LogPuller, Pulled, ftp_carrier
from gloc3_sitl.demo.demo import free_ports
from gloc3_sitl.faults.faults import schedule_faults
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import STATION_RADIO, FlightPlan

MISSION: Final = Path(__file__).with_name("store.yaml")
SURFACE_M: Final = 0.6
"""Deeper than that the radio's antenna is under water."""
CURRENT_M_S: Final = 0.1
END_M: Final = (40.0, 0.0)
"""Where the plan ends."""
FAULTS: Final = ("device:dvl=lost@1000..1030", "crash:height@600")
DROPS: Final = 5
DROP_S: Final = 12.0
ONE_MORE: Final = """\
mission: one more
frame: bay
on_failure: land
tasks:
  down: {actions: {dive: {dive: {depth_m: 2}}}}
  up: {after: [down], actions: {surface: {land: {}}}}
"""


class Dive(msgspec.Struct, kw_only=True):
    """What became of the dive in virtual time."""

    silent_s: float
    policies: list[str]
    """Those that were carried out onboard meanwhile."""
    words: str
    """How the station showed the silence in its middle."""
    summaries: int
    largest_bytes: int
    sound_bit_s: float
    events: int
    """That happened out of contact."""
    is_once_in_order: bool
    trouble: str
    """The worst event below, as the station was told it first."""
    off_m: float
    """From the place where the plan ends to where the vehicle came up."""
    summary_s: float
    events_s: float
    size: int
    drops: int
    is_equal: bool
    is_deleted: bool
    pull_s: float
    queued: str
    """What became of the mission that waited for contact."""


def virtual(folder: Path) -> Dive:
    """The dive, in virtual time."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(_dive(folder))


async def _dive(folder: Path) -> Dive:
    plan = FlightPlan(
        mission=str(MISSION),
        platform="auv",
        seed=1,
        world="bay",
        current_m_s=CURRENT_M_S,
        out=folder / "auv",
        radio_depth_m=SURFACE_M,
        modem_period_s=60.0,
    )
    async with Flight(plan) as flight:
        station, loop, reported, policies = flight.station, flight.loop, list[tuple[float, Any]](), set[str]()
        flight.exchange.subscribe("auv/ci/event", lambda one: reported.append((loop.time(), one.payload)))

        def note(envelope: Envelope[Any]) -> None:
            policies.add(envelope.payload.policy)

        flight.exchange.subscribe("auv/ci/mission", note)
        sound = list[int]()
        receive = flight.links.modem.a.on_data
        assert receive is not None

        def listen(data: bytes) -> None:
            sound.append(len(data))
            receive(data)

        flight.links.modem.a.on_data = listen
        schedule_faults(flight, FAULTS)
        follower = await flight.upload_and_start()
        await _until(lambda: flight.links.is_below, 120.0)
        below_s = loop.time()
        queue = ContactQueue(station)
        await asyncio.sleep(300.0)
        waiting = queue.add("auv", CheckedPlan(name="more.yaml", title="one more", text=ONE_MORE))
        await asyncio.sleep(200.0)
        words = wording.silence(station.fleet.platforms["auv"], loop.time())
        await _until(lambda: not flight.links.is_below, 1500.0)
        contact_s, shown_before = loop.time(), station.fleet.event_count
        await _until(lambda: _summary(station, shown_before) is not None, 10.0)
        summary_s = loop.time() - contact_s
        received = _between(reported, below_s, contact_s)
        await _until(lambda: _has_all(station, shown_before, received), 30.0)
        events_s = loop.time() - contact_s
        shown = [event.text.rpartition(" (")[0] for event in station.fleet.events_after(shown_before) if event.source]
        texts = [event.text for event in received]
        await flight.await_end(follower, 300.0)
        north, east, _ = flight.truth.samples[-1].position_ned_m
        refusal = await asyncio.wait_for(queue.ended(waiting), 120.0)
        mission = station.fleet.platforms["auv"].mission
        is_there = mission is not None and mission.value.digest == digest_of(ONE_MORE)
        queue.close()
        pulled, pull_s = await _pull(flight, folder)
        summary = _summary(station, shown_before) or ""
    return Dive(
        silent_s=contact_s - below_s,
        policies=sorted(policies - {""}),
        words=words,
        summaries=len(sound),
        largest_bytes=max(sound, default=0),
        sound_bit_s=8.0 * sum(sound) / (contact_s - below_s),
        events=len(texts),
        is_once_in_order=[text for text in shown if text in texts][: len(texts)] == texts,
        trouble=summary.rpartition("worst: ")[2],
        off_m=hypot(north - END_M[0], east - END_M[1]),
        summary_s=summary_s,
        events_s=events_s,
        size=pulled.size,
        drops=pulled.drops,
        is_equal=hashlib.sha256(pulled.path.read_bytes()).hexdigest() == pulled.sha256,
        is_deleted=not (folder / "auv" / "log.mcap").exists(),
        pull_s=pull_s,
        queued=str(refusal or "") or ("loaded at contact" if is_there else "not there"),
    )


def _between(reported: list[tuple[float, Any]], begin_s: float, end_s: float) -> list[Any]:
    """The events of a time, without its first second, in which something may still be under way."""
    return [event for t_s, event in reported if begin_s + 1.0 < t_s < end_s]


def _summary(station: Any, since: int) -> str | None:
    texts = [event.text for event in station.fleet.events_after(since)]
    return next((text for text in texts if text.startswith("contact after")), None)


def _has_all(station: Any, since: int, events: list[Any]) -> bool:
    shown = [event.text for event in station.fleet.events_after(since)]
    return all(any(text.startswith(event.text) for text in shown) for event in events)


async def _pull(flight: Flight, folder: Path) -> tuple[Pulled, float]:
    """Fetches the dive's log over a radio that drops five times on the way."""
    here, loop = folder / "here", flight.loop
    here.mkdir(parents=True, exist_ok=True)
    breaks = [(number + 1) / (DROPS + 1) for number in range(DROPS)]

    def came(_name: str, at: int, size: int) -> None:
        if breaks and at >= breaks[0] * size:
            breaks.pop(0)
            flight.links.radio.set_conditions(Conditions(loss=1.0))
            loop.call_later(DROP_S, flight.links.radio.set_conditions, STATION_RADIO)

    async with ftp_carrier(flight.ground.links.routes()[0][1], Address(1, 191)) as carrier:
        puller = LogPuller(flight.station, "auv", carrier, came)
        await puller.cut()
        log = next(one for one in await puller.list() if one.name == "log.mcap")
        begin_s = loop.time()
        pulled = await puller.pull(log, here)
    return pulled, loop.time() - begin_s


async def _until(condition: Any, within_s: float) -> None:
    async with asyncio.timeout(within_s):
        while not condition():
            await asyncio.sleep(0.05)


# --- real processes ---

REAL_MISSION: Final = """\
mission: two minutes out of contact
frame: bay
on_failure: land
on_link_loss: land
link_loss_after_s: 10
on_low_battery: land
on_pose_lost: continue
tasks:
  down:
    silence: {expected_s: 170}
    actions:
      dive: {dive: {depth_m: 2}}
  survey:
    after: [down]
    actions:
      drift: {wait: {duration_s: 100}}
  up:
    after: [survey]
    actions:
      surface: {land: {}}
"""
SILENT_S: Final = 120.0
RELAYED_BYTES_S: Final = 100_000
"""What the way over the network carries, so that a log takes a while."""


class Fetched(msgspec.Struct, kw_only=True):
    """What became of a log that `gloc3 log pull` was to fetch while its way was cut."""

    size: int
    drops: int
    is_equal: bool
    is_deleted: bool


class Real(msgspec.Struct, kw_only=True):
    """What became of the dive of real processes."""

    silent_s: float
    is_planned: bool
    """The station said so."""
    summary_s: float
    at_contact: str
    """The summary, as the station showed it."""
    by_radio: Fetched
    """The dive's log, over MAVLink FTP."""
    by_network: Fetched
    """The log behind it, over the network."""


def real(folder: Path) -> Real:
    """Simulator, onboard process, station and `gloc3 log pull` as processes, on links through relays that are cut."""
    folder.mkdir(parents=True, exist_ok=True)
    gloc3 = str(Path(sys.executable).with_name("gloc3"))
    mission = folder / "dive.yaml"
    mission.write_text(REAL_MISSION)
    main, relayed = free_ports(2, socket.SOCK_STREAM)
    for words in (
        "init yard",
        f"add yard auv.main --role platform --listen 127.0.0.1:{main} --reached-at 127.0.0.1:{relayed}",
        "add yard ops --role operator",
    ):
        subprocess.run([gloc3, "network", *words.split()], cwd=folder, check=True, capture_output=True)
    relay = Relay(19550, loss=0.0, delay_s=0.02, seed=1)
    relay.start()
    processes: list[subprocess.Popen[str]] = []
    lines: list[tuple[float, dict[str, Any]]] = []

    def begin(*arguments: str, stdout: Any = subprocess.DEVNULL) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [gloc3, *arguments], cwd=folder, stdout=stdout, stderr=(folder / f"{arguments[0]}.txt").open("w"), text=True
        )
        processes.append(process)
        return process

    try:
        begin("sitl", "--vehicle", "auv", "--world", "bay", "--current", "0.1", "--link", "udpout://127.0.0.1:19540")
        station_url = f"udpout://127.0.0.1:{relay.port}"
        begin(
            *("onboard", "auv", "--autopilot", "udpin://127.0.0.1:19540", "--station", station_url),
            *("--device", "dvl=none://", "--device", "ground_camera=none://", "--out", "auv"),
            *("--network", "yard/auv.main/network.yaml"),
        )
        station = begin(
            *("station", "--headless", "--json", "--no-record", "--link", "udpin://127.0.0.1:19550"),
            *("--mission", str(mission), "--platform", "auv"),
            stdout=subprocess.PIPE,
        )
        assert station.stdout is not None
        stdout = station.stdout

        def read() -> None:
            lines.extend((time.monotonic(), json.loads(line)) for line in stdout)

        reading = threading.Thread(target=read)
        reading.start()

        def wait(text: str, within_s: float, since: int = 0) -> float:
            end_s = time.monotonic() + within_s
            while time.monotonic() < end_s:
                for at_s, line in lines[since:]:
                    if text in line["text"]:
                        return at_s
                time.sleep(0.02)
            raise Gloc3Error(f"{text!r} was not told within {within_s:g} s: {[line['text'] for _, line in lines[-5:]]}")

        wait("task survey: running", 180.0)
        relay.is_cut, cut_s = True, time.monotonic()
        while time.monotonic() < cut_s + SILENT_S:
            time.sleep(0.1)
        is_planned = any("silent as planned (down)" in line["text"] for _, line in lines)
        since = len(lines)
        relay.is_cut, back_s = False, time.monotonic()
        summary_s = wait("contact after", 20.0, since) - back_s
        at_contact = next(line["text"] for _, line in lines[since:] if "contact after" in line["text"])
        wait("mission 'two minutes out of contact': done", 60.0)
        station.send_signal(signal.SIGTERM)
        station.wait(20.0)
        reading.join()
        radio = ["udpin://127.0.0.1:19550", "--platform", "auv"]
        by_radio = _fetched(folder, begin, radio, "log.mcap", partial(setattr, relay, "is_cut"))
        with _network_relay(relayed, main) as report:

            def cut(is_cut: bool) -> None:
                report(*(("partition", "reset") if is_cut else ("heal", f"rate {RELAYED_BYTES_S}")))

            cut(False)
            by_network = _fetched(folder, begin, ["yard/ops/network.yaml"], "log-2.mcap", cut)
    finally:
        for process in reversed(processes):
            process.send_signal(signal.SIGTERM)
        for process in processes:
            process.wait(20.0)
        relay.stop()
    return Real(
        silent_s=back_s - cut_s,
        is_planned=is_planned,
        summary_s=summary_s,
        at_contact=at_contact,
        by_radio=by_radio,
        by_network=by_network,
    )


def _fetched(
    folder: Path, begin: Callable[..., subprocess.Popen[str]], way: list[str], name: str, cut: Callable[[bool], None]
) -> Fetched:
    """Fetches a log with `gloc3 log pull`, whose way is cut five times meanwhile."""
    there, here = folder / "auv" / name, folder / "here/auv" / name
    pulling = begin("log", "pull", *way, "--out", "here", *([name] if there.exists() else []))
    digest, drops = "", 0
    while pulling.poll() is None:
        part = next((folder / "here/auv").glob(f"{name}.*.part"), None)
        if part is not None and there.exists():
            size = int(part.name.split(".")[-2])
            digest = digest or hashlib.sha256(there.read_bytes()).hexdigest()
            if drops < DROPS and part.exists() and part.stat().st_size > size * (drops + 1) / (DROPS + 2):
                drops += 1
                cut(True)
                time.sleep(DROP_S)
                cut(False)
        time.sleep(0.02)
    is_here = here.exists()
    return Fetched(
        size=here.stat().st_size if is_here else 0,
        drops=drops,
        is_equal=is_here and hashlib.sha256(here.read_bytes()).hexdigest() == digest,
        is_deleted=not there.exists(),
    )


@contextmanager
def _network_relay(own: int, to: int) -> Iterator[Callable[..., None]]:
    """A relay between a station on the network and the platform, which does what it is told."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.onboard.hosts.relay", f"127.0.0.1:{own}", f"127.0.0.1:{to}"],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        text=True,
    )
    stdin = process.stdin
    assert stdin is not None

    def report(*lines: str) -> None:
        stdin.write("".join(f"{line}\n" for line in lines))
        stdin.flush()

    try:
        yield report
    finally:
        stdin.close()
        process.wait(20.0)


def run(progress: Progress) -> list[Figure]:
    """Both dives."""
    folder = SCRATCH / "store"
    progress.report("virtual time: 20 minutes of silence")
    dive = msgspec.convert(progress.part("virtual", lambda: virtual(_fresh(folder / "virtual"))), Dive)
    progress.report("real processes: 2 minutes of silence")
    found = msgspec.convert(progress.part("real", lambda: real(_fresh(folder / "real"))), Real)
    return [
        Figure("virtual: out of contact", f"{dive.silent_s:.0f} s", "≥ 1,200 s", dive.silent_s >= 1200.0),
        Figure("policies carried out meanwhile", ", ".join(dive.policies) or "none", "none", not dive.policies),
        Figure("the station in the middle of it", dive.words, "as planned", dive.words.startswith("silent as planned")),
        Figure("summaries by sound", f"{dive.summaries}, {dive.sound_bit_s:.1f} bit/s"),
        Figure("largest", f"{dive.largest_bytes} bytes", "≤ 32", 0 < dive.largest_bytes <= MOST_BYTES),
        Figure("worst event below", dive.trouble, "told", bool(dive.trouble)),
        Figure("came up off the plan's end", f"{dive.off_m:.1f} m", "away", dive.off_m > 2.0),
        Figure("summary after contact", f"{dive.summary_s:.2f} s", "≤ 2 s", dive.summary_s <= 2.0),
        Figure(
            "events below, each shown once and in order",
            f"{dive.events} within {dive.events_s:.1f} s",
            "all",
            dive.is_once_in_order and dive.events > 0,
        ),
        Figure("mission queued below", dive.queued, "loaded", dive.queued == "loaded at contact"),
        Figure(
            "log",
            f"{dive.size / 1e6:.1f} MB in {dive.pull_s:.0f} s, the radio dropped {dive.drops} times",
            "5",
            dive.drops == DROPS,
        ),
        Figure("its digest", "equal" if dive.is_equal else "differs", "equal", dive.is_equal),
        Figure("onboard", "deleted" if dive.is_deleted else "kept", "deleted", dive.is_deleted),
        Figure("real processes: out of contact", f"{found.silent_s:.0f} s", "≥ 120 s", found.silent_s >= SILENT_S),
        Figure(
            "the station meanwhile",
            "silent as planned" if found.is_planned else "alarmed",
            "as planned",
            found.is_planned,
        ),
        Figure("summary after contact", f"{found.summary_s:.2f} s", "≤ 2 s", found.summary_s <= 2.0),
        Figure("the summary", found.at_contact, "with the mission", "two minutes out of contact" in found.at_contact),
        *_fetched_figures("log over MAVLink FTP", found.by_radio),
        *_fetched_figures("the next one over the network", found.by_network),
    ]


def _fetched_figures(title: str, log: Fetched) -> list[Figure]:
    return [
        Figure(title, f"{log.size / 1e6:.1f} MB, the way was cut {log.drops} times", "5", log.drops == DROPS),
        Figure("its digest", "equal" if log.is_equal else "differs", "equal", log.is_equal),
        Figure("onboard", "deleted" if log.is_deleted else "kept", "deleted", log.is_deleted),
    ]


def _fresh(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


BARS: Final = (
    Bar(
        name="store-and-forward",
        title="After twenty minutes out of contact, every event and the log arrive once",
        claim="The AUV gets its mission at the surface, dives, and is out of contact for 20 minutes in virtual time (2 "
        "minutes as real processes, whose link is cut): this is planned silence, not a fault. Under water its Doppler "
        "log is lost for 30 s and a component fails; a current of 0.1 m/s carries it away from the planned end. A "
        "summary of at most 32 bytes arrives by sound once a minute. At contact the summary arrives first, then all "
        "events once and in order; a mission that was queued meanwhile is loaded. The log is fetched over a link that "
        "drops five times for 12 s, compared by its digest, and deleted onboard. The logs of the real processes "
        "are fetched once over MAVLink FTP and once over the network.",
        run=run,
        seeds="1",
    ),
)
