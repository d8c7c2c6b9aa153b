"""`gloc3 log`: inspect, plot, report and recover logs, and replay a component."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Final

import msgspec
from cyclopts import App, Parameter

from gloc3.cli.narration import narrate
from gloc3.documents.characters import printable
from gloc3.errors import Gloc3Error, Refused
from gloc3.installed import installed_points
from gloc3.log.causes import TOPICS as HAPPENINGS
from gloc3.log.causes import causes_of, find_happening, read_happenings, render_causes
from gloc3.log.commands import list_commands, render_commands
from gloc3.log.convert.conversion import LogFormat, convert, read_origin
from gloc3.log.fields import plot_series, read_series
from gloc3.log.info import render, require_topic, summarize
from gloc3.log.reader import LogReader, find_log
from gloc3.log.record import PLATFORM_FILE
from gloc3.log.recover import recover
from gloc3.log.replay import render_replay, replay
from gloc3.log.report.flight_path import POSITIONS, read_flight_path
from gloc3.log.report.plot import plot_flight
from gloc3.log.report.timeline import plot_timelines, read_timelines
from gloc3.messages.topics import TopicTable

app = App(
    name="gloc3 log",
    help="""Inspect, plot, report, recover and replay logs.

    For example, after `gloc3 fly inspection --out runs/inspection`:

    - `gloc3 log info runs/inspection`: duration, topics, events, and what is missing
    - `gloc3 log plot runs/inspection`: the path flown and the path requested
    - `gloc3 log plot runs/inspection pose velocity_ned_m_s[2]`: numbers over time
    - `gloc3 log plot runs/inspection --autopilot FILE.ulg`: beside the autopilot's own log, on one time axis
    - `gloc3 log commands runs/inspection`: the commands of stations, and their outcomes
    - `gloc3 log why runs/inspection "policy land"`: what led there: messages, faults, commands, back to the root
    - `gloc3 log report runs/inspection --wall "0,12,0 20,12,0 20,0,0 0,0,0"`: how much of the floor was seen
    - `gloc3 log replay runs/inspection limiter`: run a component again on its recorded inputs
    - `gloc3 log convert runs/inspection --to kml`: for maps, tables (csv, parquet) and ROS 2 (rosbag2)
    - `gloc3 log pull udpin://0.0.0.0:14550`: download a vehicle's logs, resuming the last attempt

    A log is an MCAP file, which Foxglove opens as it is.""",
    help_format="markdown",
    version_flags=[],
)

for _point in installed_points("gloc3.log_commands"):
    app.command(_point.load(), name=_point.name)

DONE: Final = 0
IMPERFECT: Final = 1
"""It worked, and something about the log is not as it should be."""


@app.command
def info(
    file: Path,
    /,
    *,
    json: Annotated[bool, Parameter(negative="")] = False,
    events: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Show what a log holds: duration, topics and rates, events and faults, and what is missing.

    The exit code is 1 if the log is not finished or messages are lost.

    Args:
        file: The log, or the folder of a run: its last one.
        json: Print JSON for programs.
        events: Show all events, not only warnings and worse.
    """
    topics = TopicTable.installed()
    with LogReader(find_log(file), topics.types) as reader, _progress("reading") as progress:
        found = summarize(reader, topics, progress)
    print(  # noqa: T201
        msgspec.json.format(msgspec.json.encode(found)).decode()
        if json
        else printable(render(found, has_all_events=events))
    )
    return DONE if found.is_finished and not found.losses else IMPERFECT


@app.command(name="commands")
def commands_(
    file: Path,
    /,
    *,
    looks: Annotated[bool, Parameter(negative="")] = False,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """List the requests of stations: when and how they arrived, and their outcomes.

    Args:
        file: The platform's log, or the folder of a run: its last one that has any.
        looks: Also show requests that only read.
        json: Print JSON for programs.
    """
    with LogReader(find_log(file, "ci/request"), TopicTable.installed().types) as reader:
        reader.require_ours("requests of stations", "ci/*")
        found = list_commands(reader, has_queries=looks)
        _warn(reader)
    print(msgspec.json.format(msgspec.json.encode(found)).decode() if json else printable(render_commands(found)))  # noqa: T201
    return DONE


@app.command(usage="gloc3 log why FILE TIME|EVENT")
def why(file: Path, what: str, /) -> int:
    """Tell why something happened: the chain of causes through the log, back to its root.

    Args:
        file: The log, or the folder of a run: its last one.
        what: A time in seconds, for the last event until then, or part of an event's text.
    """
    with LogReader(find_log(file), TopicTable.installed().types) as reader:
        reader.require_ours("events", *HAPPENINGS)
        happenings = read_happenings(reader)
        print(printable(render_causes(causes_of(happenings, find_happening(happenings, what)))))  # noqa: T201
        _warn(reader)
    return DONE


@app.command(usage="gloc3 log plot [OPTIONS] FILE [WHAT] [FIELDS...]")
def plot(
    file: Path,
    what: str = "path",
    /,
    *fields: str,
    out: Path | None = None,
    autopilot: Path | None = None,
    field: Annotated[list[str], Parameter(negative=())] | None = None,
    offset: float | None = None,
) -> int:
    """Draw a picture of a log.

    With --autopilot, position and speed of the pose and of the autopilot's own estimate on one time axis. How the clocks
    differ is found by the motion.

    Args:
        file: The log, or the folder of a run: its last one.
        what: `path` (flown and requested), `components` (their states over time), or a topic.
        fields: With a topic, its fields to draw, such as position_ned_m or velocity_ned_m_s[2]; default: all numbers.
        out: The picture (.svg, .png, .pdf); by default beside the log.
        autopilot: The autopilot's log of the flight: ULog (.ulg) of PX4 or DataFlash (.BIN) of ArduPilot.
        field: With --autopilot, a field of its log, such as battery_status.voltage_v or BAT.Volt; may be repeated.
        offset: With --autopilot, seconds added to its times, instead of finding them by the motion.
    """
    file = find_log(file)
    if autopilot is not None:
        return _plot_beside(file, what, autopilot, field or [], offset, out)
    if field or offset is not None:
        raise Refused("--field and --offset belong to --autopilot FILE")
    with LogReader(file) as reader:
        target = out or file.with_name(f"{file.stem}-{what.replace('/', '-')}.svg")
        if what == "path":
            reader.require_ours("position", *POSITIONS)
            path = read_flight_path(reader)
            if not path.flown:
                raise Gloc3Error(f"{file}: no position was recorded")
            plot_flight(path, target)
        elif what == "components":
            reader.require_ours("states of components", "components/*/status")
            plot_timelines(read_timelines(reader), target, f"{reader.platform}: states of the components")
        else:
            topic = require_topic(reader, what)
            plot_series(read_series(reader, topic, fields), target, f"{reader.platform or file.name}/{topic}")
        _warn(reader)
    print(target)  # noqa: T201
    return DONE


def _plot_beside(
    file: Path, what: str, autopilot: Path, fields: list[str], offset_s: float | None, out: Path | None
) -> int:
    from gloc3.log.autopilot_log import read_autopilot_log
    from gloc3.log.report.beside_autopilot import in_words, plot_beside, read_beside

    if what != "path":
        raise Refused(f"--autopilot draws the path; its own fields are named by --field, not {what!r}")
    log = read_autopilot_log(autopilot)
    with LogReader(file, TopicTable.installed().types) as reader:
        found = read_beside(reader, log, fields, offset_s)
        target = out or file.with_name(f"{file.stem}-{autopilot.stem}.svg")
        plot_beside(found, log.form, target, f"{reader.platform}: GLOC3 and autopilot")
        _warn(reader)
    print(f"{target}: {in_words(found)}")  # noqa: T201
    return DONE


@app.command(name="recover", usage="gloc3 log recover FILE [OUT]")
def recover_(file: Path, out: Path | None = None, /) -> int:
    """Make a finished log, with its index, from an unfinished or damaged one.

    Args:
        file: The damaged log, or the folder of a run: its last one; it is not changed.
        out: The new log; by default `NAME-recovered.mcap` beside it.
    """
    file = find_log(file)
    target = out or file.with_name(f"{file.stem}-recovered{file.suffix}")
    with _progress("recovering") as progress:
        report = recover(file, target, progress)
    for loss in report.losses:
        print(f"lost: {loss}", file=sys.stderr)  # noqa: T201
    print(f"{target}: {report.messages:,} messages")  # noqa: T201
    return DONE


@app.command(usage="gloc3 log send FOLDER --by COMMAND")
def send(folder: Path, /, *, by: str) -> int:
    """Send the logs of a folder elsewhere, each once, when it is complete: by rclone, rsync, scp, curl or any other command.

    - `gloc3 log send /var/log/gloc3/pelican --by "rclone copy {} remote:logs"`
    - `gloc3 log send runs/hop --by "rsync --partial {} flights@server:logs/"`

    What was sent is noted in FOLDER/sent.txt. A log that is still written waits until it is finished, one that its process
    has left unfinished until ten minutes have passed. The exit code is 1 if a file could not be sent: the next call tries
    again. `gloc3 onboard install --send-logs` calls it every few minutes while the vehicle is disarmed.

    Args:
        folder: The folder with the logs.
        by: The command; {} is the file. It has sent the file if it ends with 0.
    """
    from gloc3.log.sending import send_logs

    found = send_logs(folder, by, narrate)
    for name in found.running:
        narrate(f"{name} is still written")
    return DONE if not found.failed else IMPERFECT


@app.command(name="replay")
def replay_(file: Path, component: str, /, *, platform: str = "") -> int:
    """Run a component again on its recorded inputs, and compare its outputs with the recorded ones.

    Inputs that are not recorded are named. The exit code is 1 if the outputs differ by more than rounding.

    Args:
        file: The log, or the folder of a run: its last one.
        component: Its name on the platform.
        platform: The platform, by name or file; by default the platform file in the log.
    """
    from gloc3.platform.reader import load_platform, read_platform

    topics = TopicTable.installed()
    file = find_log(file)
    with LogReader(file, topics.types) as reader:
        reader.require_ours("recorded inputs")
        attached = reader.attachments.get(PLATFORM_FILE)
        if platform:
            found = load_platform(platform)
        elif attached is not None:
            found = read_platform(attached, f"{file.name}/{PLATFORM_FILE}")
        else:
            raise Gloc3Error(f"{file} holds no platform file: set --platform")
        result = replay(reader, found, component, topics)
        _warn(reader)
    print(printable(render_replay(result)))  # noqa: T201
    return DONE if result.is_same else IMPERFECT


@app.command(name="convert", usage="gloc3 log convert FILE --to FORMAT [OPTIONS]")
def convert_(file: Path, /, *, to: LogFormat, out: Path | None = None, topic: str = "", origin: str = "") -> int:
    """Convert a log for other programs: maps, tables, ROS 2.

    Maps have the path flown and requested, home, and the places of pictures. Tables have one row a pose; with --topic,
    all fields of a topic. A bag has poses, transforms, sensors, status and events as ROS 2 messages. `map` saves the map of
    obstacles that was built in flight: a platform file knows it by `known_map`, and ROS 2's map server reads it.

    Args:
        file: The log, or the folder of a run: its last one.
        to: kml, gpx and geojson for maps of the flight; csv and parquet for tables; rosbag2 for ROS 2; map for obstacles.
        out: The new file (or, of a bag, folder); by default beside the log. It must not exist.
        topic: For tables: the topic whose messages become the rows.
        origin: LATITUDE,LONGITUDE,ALTITUDE of the local frame, in deg and m, where the log has none.
    """
    with LogReader(find_log(file), TopicTable.installed().types) as reader:
        print(convert(reader, to, out, topic, read_origin(origin) if origin else None))  # noqa: T201
        _warn(reader)
    return DONE


@app.command(name="report")
def report_(
    run: Path,
    /,
    *,
    wall: str = "",
    frame: str = "",
    cameras: Path | None = None,
    cell: float = 0.1,
    farthest: float = 20.0,
    oblique: float = 70.0,
    lift: float = 0.0,
    out: Path | None = None,
) -> int:
    """Report an inspection: which views were taken from where, coverage of a wall, contact sheet.

    Args:
        run: The folder of a run (its last log), a log, or a folder of pictures with their poses.
        wall: The inspected wall: its corners "x,y,height x,y,height ...", clockwise from the upper left as seen from in
            front; or WORLD.yaml#SURFACE.
        frame: The local frame of the corners; needed where the platform has several.
        cameras: Models of the cameras, where the run holds none (its images/cameras.json).
        cell: Side of a cell of the wall, in metres.
        farthest: Largest distance at which the wall counts as seen, in metres.
        oblique: Largest angle off the wall's normal at which it counts as seen, in degrees.
        lift: Height of the body's origin (the reference of the camera mounts) above the poses, in metres: the height at
            which the vehicle stands, if poses are measured from there.
        out: Folder for the report; by default `report` beside the pictures.
    """
    from gloc3.camera.wall_coverage import CoverageLimits
    from gloc3.log.report.inspection_report import PAGE, summary, write_report
    from gloc3.log.report.recording import read_cameras, read_recording
    from gloc3.log.report.walls import read_wall

    if not (0.001 <= cell <= 10.0 and 0.0 < farthest < float("inf") and 0.0 < oblique < 90.0):
        raise Refused("--cell must be 0.001 to 10 m, --farthest above 0 m, --oblique between 0 and 90 deg")
    if not -10.0 <= lift <= 10.0:
        raise Refused("--lift must be from -10 to 10 m")
    recording = read_recording(run).lifted(lift)
    if not recording.pictures:
        raise Refused(f"{run}: no picture was recorded")
    known = {**recording.cameras, **(read_cameras(cameras) if cameras is not None else {})}
    of_this = recording.folder.name.removeprefix("images") if recording.folder.name.startswith("images") else ""
    target = out or recording.folder.parent / f"report{of_this}"
    found = read_wall(wall, recording.bearings_deg, frame) if wall else None
    figures = write_report(recording, known, found, CoverageLimits(oblique, farthest, cell), target)
    print(f"{target / PAGE}: {summary(figures)}")  # noqa: T201
    return DONE


def _warn(reader: LogReader) -> None:
    for loss in reader.losses():
        print(f"gloc3 log: {reader.path.name}: {loss}", file=sys.stderr)  # noqa: T201


@contextmanager
def _progress(text: str) -> Iterator[Callable[[float], None]]:
    """A progress bar on the terminal; no output without a terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(text, total=1.0)
        yield lambda share: bar.update(task, completed=share)
