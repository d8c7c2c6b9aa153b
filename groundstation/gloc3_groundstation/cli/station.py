"""The command `gloc3 station`: the ground station in a terminal, or without one for scripts."""

import asyncio
import secrets
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import msgspec
from cyclopts import App, Parameter

from gloc3.cli.narration import narrate
from gloc3.errors import Gloc3Error, InputError, Refused
from gloc3.mission.examples import find_mission
from gloc3.terrain import Terrain, open_terrain
from gloc3_groundstation.announcing.announcements import AlertLevel
from gloc3_groundstation.cli.run_output import RunOutput, print_json
from gloc3_groundstation.cli.script import parse_command
from gloc3_groundstation.corrections.source_url import parse_source
from gloc3_groundstation.links.forwarding import check_forward
from gloc3_groundstation.missions.plans import CheckedPlan, read_plan
from gloc3_groundstation.reporting.outcomes import RunOutcome
from gloc3_groundstation.shared_missions.shared_flight import CrewOptions
from gloc3_groundstation.web.server import HOST, PORT, WebOptions

if TYPE_CHECKING:
    from gloc3_groundstation.assembly import StationSetup
    from gloc3_groundstation.desk.vehicle_commands import VehicleCommand
    from gloc3_groundstation.store.configuration import Configuration

SELF_SIGNED: Final = "self"
EVERY: Final = "all"
"""In place of a platform's name: every one that is heard."""
FLAG: Final = Parameter(negative=(), show_default=False)

app = App(
    name="gloc3 station",
    help="""Watch and command vehicles: the terminal, or --headless for scripts.

    The terminal shows the vehicle, its components, its mission and events; the last line lists its keys. Without
    --link it listens on UDP port 14550, where simulators, companions and telemetry routers send.

    A first flight in simulation: start `gloc3 sitl`, `gloc3 onboard pelican_rtk` and `gloc3 station`, each in a terminal of
    its own. In the station:

    - `3`, then `o`: opens a mission; the digits are the screens
    - `8`: shows whether it may start, and if not, what to do
    - `s`: uploads it and starts it, after a confirmation
    - `p` pauses, `r` resumes, `a` aborts
    - `space`: the vehicle holds at once, on every screen
    - `?` explains the screen and its keys, `^p` finds every command by name, `q` quits

    For example:

    - `gloc3 station`: watch all vehicles in reach
    - `gloc3 station --mission inspection`: upload a mission; the key s starts it
    - `gloc3 station --headless --mission my.yaml --json`: fly it from a script; stdout is data, stderr is narration
    - `gloc3 station --headless --mission my.yaml --command pause@30s --command resume@40s`: command it from a script
    - `gloc3 station --headless --platform 1 --do arm --do "take_off 5" --do land`: command a vehicle without a companion
    - `gloc3 station --headless --platform all --do hold`: command every vehicle that is heard
    - `gloc3 station --link serial:///dev/ttyUSB0:57600`: over a telemetry radio
    - `gloc3 station --web`: in a browser, with the same keys

    Exit codes: 0 done; 1 the mission failed or did not pass the check; 2 wrong use; 3 a pilot or the autopilot's failsafe
    has landed the vehicle in place of the mission; 4 the vehicle, or the station in control of it, refused; 5 the vehicle
    was not heard or did not answer; 130 interrupted. With --json the last line has the same: {"event": "end", "outcome":
    "done", "exit_code": 0, …}; gloc3 station schema prints the JSON Schema of the lines.""",
    help_format="markdown",
    version_flags=[],
)
app["--help"].group = "Parameters"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class StationOptions:
    """Options of `gloc3 station`, one for each field."""

    mission: str | None = None
    """A mission file, or the name of an example; it is checked first, and sent to the platform as soon as it is in
    contact. With --headless it is started too. In the terminal, one with errors is opened at the first error."""
    link: Annotated[list[str] | None, Parameter(negative=())] = None
    """MAVLink link: udpin://HOST:PORT, udpout://, tcpin://, tcpout://, or serial:///dev/PORT:BAUD;
    may be given again. Default: those of the configuration file, else udpin://127.0.0.1:14550, which receives from
    this computer only; udpin://0.0.0.0:14550 receives from the network."""
    platform: Annotated[list[str] | None, Parameter(negative=())] = None
    """The platform to command, by name; otherwise the one that the mission's header names, else the only one that is
    heard. With its platform file instead, the mission is checked by that file, too. With --do also the MAVLink system of a
    vehicle without a companion; it may be given again then, and "all" means every vehicle that is heard. May be given again
    for a mission with tasks for any platform, too, which are assigned to these vehicles; default: to all that are heard."""
    reassign: Annotated[bool, FLAG] = False
    """With --headless and such a mission: when a vehicle drops out, assign the tasks that it leaves to the others.
    Otherwise a warning says who could do them, and they stay undone; the terminal asks."""
    headless: Annotated[bool, FLAG] = False
    """No terminal: narrate on stderr. Without --mission it monitors until Ctrl-C."""
    json: Annotated[bool, FLAG] = False
    """With --headless: print one JSON object per line of narration on stdout; the last one has the outcome."""
    start: Annotated[bool, FLAG] = False
    """Start the mission without waiting for the key, once the platform is ready."""
    exit_when_done: Annotated[bool, FLAG] = False
    """Close the terminal when the mission has ended."""
    override: str = ""
    """With --headless: the reason to start the mission although pre-flight checks are red; it is logged onboard
    with your name."""
    command: Annotated[list[str] | None, Parameter(negative=())] = None
    """With --headless and a --mission: sends VERB [TASK[.ACTION]] at @SECONDS after the start, such as "pause@30s",
    "resume@40s", "skip sweep.wall@60s" or "abort@90s"; may be given again. A refusal is reported and ends nothing."""
    commands: Annotated[bool, FLAG] = False
    """With --headless and a --mission: reads such commands as lines from stdin. Without @SECONDS they are sent as they
    come, at the start at the earliest."""
    do: Annotated[list[str] | None, Parameter(negative=())] = None
    """With --headless and a --platform: commands each vehicle, each command awaited until telemetry shows it done; may
    be given again. Without a companion: arm, disarm, "take_off HEIGHT", hold, return, land, "go_to LATITUDE LONGITUDE HEIGHT",
    "speed M_S", "mode NAME", start_plan, pause_plan, picture, record, stop_recording, "point PITCH YAW", reboot. With one:
    take_off, hold, return, land and go_to as single actions. The first that is refused or not done ends the commands to this
    vehicle; the exit code is the first vehicle's that is not 0."""
    within: float = 120.0
    """With --do: the time for each command to be done, s."""
    far_away_ok: Annotated[bool, FLAG] = False
    """With --headless and a --mission: upload it although its first waypoint is 2 km or more from the vehicle, which is
    refused otherwise; the terminal asks."""
    take_over: Annotated[bool, FLAG] = False
    """With --headless and a --mission or --do: take control from another station without asking it, if there is one;
    a line states from which. Otherwise that station is asked, and has 10 s to grant it."""
    at_contact: Annotated[bool, FLAG] = False
    """With --headless: upload the mission at the next contact with --platform, without a time limit, and do not
    start it. In the terminal the key u queues it while the vehicle is out of contact."""
    wait: float = 60.0
    """With --headless: give up without contact to the platform within this time, s; it may take the same time again
    to be ready, and then for red checks that often pass by themselves, such as satellites."""
    station_id: int | None = None
    """The MAVLink system of this station: 255, and 254, 253 for further ones. Default: that of the
    configuration file, else 255."""
    signing_key: Path | None = None
    """A file with the MAVLink signing key of all links, readable only by you: 64 hexadecimal digits, or
    `passphrase: ...`. Then frames without its signature are dropped and counted. Default: that of the
    configuration file, else links are not signed."""
    network: Path | None = None
    """The network file of this station, made by gloc3 network: an encrypted connection to the platforms, with
    the name and role of its certificate, beside the links. Without --link no MAVLink link is then
    opened."""
    forward: Annotated[list[str] | None, Parameter(negative=())] = None
    """Send the frames of all vehicles to another station: udpout://HOST:PORT, tcpout://, udpin:// or tcpin://; may be
    given again. Commands from there do not reach the vehicles. Default: forward of the configuration file, else none."""
    forward_both: Annotated[list[str] | None, Parameter(negative=())] = None
    """The same, and frames from there, commands included, pass to the vehicles. Default: forward_both of the
    configuration file, else none."""
    rtk: str | None = None
    """RTK corrections for every PX4 or ArduPilot vehicle that is heard: ntrip://USER:PASSWORD@HOST:2101/MOUNTPOINT
    (ntrips:// with TLS), tcp://HOST:PORT, or serial:///dev/PORT:BAUD for a base that sends RTCM 3. A password is better
    kept in the configuration file. Default: rtk of the configuration file, else none."""
    acoustic: Annotated[list[str] | None, Parameter(negative=())] = None
    """An acoustic modem, as PLATFORM=URL with udpin://, udpout:// or serial://; may be given again. It
    receives summaries of a vehicle out of contact, and sends the emergency key's hold and land if no other link
    reaches it. ?key=FILE tags its frames."""
    config: Path | None = None
    """The configuration file (TOML), written when the terminal closes if missing: theme, links, station_id,
    signing_key, forward, rtk, downloads, and the state of the last session. Default: gloc3/station.toml in the XDG configuration
    directory."""
    terrain: Path | None = None
    """Folder with terrain tiles (SRTM .hgt or .hgt.zip), for missions with heights above the ground and the height
    profile of the map; none is downloaded. Default: that of the configuration file, else none."""
    bell: AlertLevel | None = None
    """Ring the terminal's bell for alerts of this severity and worse: off, critical, error or warning. Default: bell of the
    configuration file, else off."""
    speech: AlertLevel | None = None
    """Speak such alerts with spd-say, espeak-ng, espeak or say, whichever is found first. Default: speech of the
    configuration file, else off."""
    no_record: Annotated[bool, FLAG] = False
    """Record nothing. Otherwise events, all received messages (MCAP) and every MAVLink frame (.tlog) are kept in
    gloc3/station in the XDG state directory."""
    foxglove: Annotated[bool, FLAG] = False
    """Serve the vehicles' topics live and read-only to Foxglove: open a connection to
    ws://127.0.0.1:8765 there. A topic is requested while a panel shows it."""
    foxglove_port: int = 8765
    """The port for Foxglove; 0 takes any free one."""
    web: Annotated[bool, FLAG] = False
    """Show the terminal in a browser, at the address that is printed. The station keeps running when the browser
    window is closed, until Ctrl-C here or the key q there; one window shows it at a time."""
    web_host: str = HOST
    """The address that the page is served on. Beyond this computer, the page opens with the token in the printed
    address alone: one address commands, another one only watches. Nothing is encrypted without --web-tls."""
    web_port: int = PORT
    """The port of the page; 0 takes any free one."""
    web_token: Path | None = None
    """A file with the token of the page, readable only by you, written if missing: the addresses stay the same after a
    restart, and this computer's own page needs the token too. Default: a random token with --web-host, else none."""
    web_tls: str | None = None
    """Encrypt the page: CERTIFICATE,KEY (PEM files), or "self" for a self-signed certificate that is made in the
    configuration directory and whose SHA-256 fingerprint is printed."""
    web_read_only: Annotated[bool, FLAG] = False
    """The page shows everything and commands nothing: keys and HOLD do nothing there."""
    tiles: str | None = None
    """Tiles of the page's map: an MBTiles file, a folder ZOOM/COLUMN/ROW.png, or a URL with {z}, {x} and {y}, from which
    this station then fetches what the map shows. Default: a plain grid; nothing is fetched."""
    tiles_attribution: str | None = None
    """The text on the map that names the tiles' source. Default: that of the MBTiles file."""


@app.default
def station(options: StationOptions = StationOptions()) -> int:
    """Watch and command vehicles."""
    output = RunOutput(print_json if options.headless and options.json else None)
    try:
        outcome = _run(options, output)
    except Gloc3Error as error:
        output.end(RunOutcome.WRONG_USE, str(error))
        raise
    if isinstance(outcome, int):
        return outcome
    output.end(outcome)
    return outcome.exit_code


@app.command
def schema(*, out: Path | None = None) -> int:
    """Print the JSON Schema of the lines of --headless --json.

    Args:
        out: The file to write; default: print the schema.
    """
    from gloc3.documents.json_schema import as_text
    from gloc3_groundstation.reporting.schema import lines_schema

    text = as_text(lines_schema())
    if out is None:
        sys.stdout.write(text)
    else:
        out.write_text(text, encoding="utf-8")
    return 0


def _run(options: StationOptions, output: RunOutput) -> RunOutcome | int:
    """Runs the station: without a terminal to its outcome, in the terminal to its exit code.

    Raises:
        Gloc3Error: wrong use.
    """
    _check(options)
    modems = tuple(_modem(text) for text in options.acoustic or ())
    from gloc3_groundstation.cli.ending import Ending
    from gloc3_groundstation.cli.session import HeadlessOptions, Session, SessionOptions, TerminalOptions
    from gloc3_groundstation.store.configuration import Configuration, ConfigurationFile, default_path

    file, configuration, problem = ConfigurationFile(options.config or default_path()), Configuration(), ""
    try:
        configuration = file.read()
    except InputError as error:
        problem = f"{error}; the station runs with its defaults and leaves the file as it is"
    terrain = open_terrain(options.terrain)
    if terrain is None and configuration.terrain:
        try:
            terrain = open_terrain(Path(configuration.terrain))
        except Refused as refusal:
            problem = f"{problem}\n{refusal}".strip()
    plan: CheckedPlan | None = None
    opens, named = "", options.platform or ()
    platform = named[0] if len(named) == 1 else None
    if options.mission is not None:
        find_mission(options.mission)  # a name that nothing has is wrong use; what is wrong in a file is not
        try:
            plan = _read(options.mission, platform, terrain)
        except InputError as error:
            if options.headless or options.start or options.exit_when_done:
                narrate(f"{error}\nthe mission did not pass the check")
                output.findings(error.findings)
                return RunOutcome.FAILED if options.headless else RunOutcome.FAILED.exit_code
            opens = options.mission
    if len(named) > 1 and plan is not None and not plan.unassigned and not plan.platforms:
        raise Refused("several --platform go with a --mission for several platforms")
    if options.at_contact and plan is not None and (len(plan.platforms) > 1 or plan.unassigned):
        raise Refused("--at-contact goes with a mission for one platform")
    if options.mission is not None:
        is_file = Path(options.mission).is_file()
        configuration = configuration.with_mission(str(Path(options.mission).resolve()) if is_file else options.mission)
    setup = msgspec.structs.replace(_setup(options, configuration), terrain=terrain)
    requested = SessionOptions(
        urls=tuple(options.link or ([] if setup.network is not None else configuration.links)),
        modems=modems,
        platform=_name_of(platform),
        crew=_crew(options),
        plan=plan,
        configuration=configuration,
        problem=problem,
        foxglove_port=options.foxglove_port if options.foxglove else None,
        forward=tuple(configuration.forward if options.forward is None else options.forward),
        forward_both=tuple(configuration.forward_both if options.forward_both is None else options.forward_both),
        rtk=configuration.rtk if options.rtk is None else options.rtk,
        bell=options.bell or configuration.bell,
        speech=options.speech or configuration.speech,
    )
    ending = Ending()
    session = Session(setup, requested, ending)
    if options.headless:
        run = HeadlessOptions(
            wait_s=options.wait,
            override=options.override,
            is_at_contact=options.at_contact,
            orders=_orders(options.do or ()),
            vehicles=tuple(dict.fromkeys(options.platform or ())),
            within_s=options.within,
            is_taking_over=options.take_over,
            is_far_ok=options.far_away_ok,
            commands=tuple(parse_command(text) for text in options.command or ()),
            commands_from=sys.stdin.fileno() if options.commands else None,
        )
        with ending:
            return asyncio.run(session.narrate(run, output))
    page = _page(options) if options.web else None
    shown = TerminalOptions(is_starting=options.start, is_closing=options.exit_when_done, web=page, opens=opens)
    with ending:
        return asyncio.run(session.show(shown, keep=file.write))


def _page(options: StationOptions) -> WebOptions:
    """The options of the page.

    Raises:
        Refused: the token, the certificate or the tiles cannot be used.
    """
    from gloc3.clock import utc_now
    from gloc3_groundstation.store.configuration import default_path
    from gloc3_groundstation.web.access import read_token
    from gloc3_groundstation.web.certificate import load_pair, self_signed
    from gloc3_groundstation.web.tiles import open_tiles

    pair: tuple[Path, Path] | None = None
    if options.web_tls == SELF_SIGNED:
        pair = self_signed(default_path().parent, options.web_host, utc_now())
    elif options.web_tls is not None:
        certificate, _, key = options.web_tls.partition(",")
        pair = Path(certificate).expanduser(), Path(key or certificate).expanduser()
        load_pair(*pair)
    return WebOptions(
        host=options.web_host,
        port=options.web_port,
        token="" if options.web_token is None else read_token(options.web_token.expanduser()),
        is_read_only=options.web_read_only,
        certificate=pair,
        tiles=None if options.tiles is None else open_tiles(options.tiles, options.tiles_attribution),
    )


def _read(mission: str, platform: str | None, terrain: Terrain | None) -> CheckedPlan:
    """The mission, checked for the platform as far as that is known before it is heard.

    The vehicle may have another file of the name that is installed here: then only that one can refuse the mission.

    Raises:
        InputError: it may not fly.
    """
    try:
        return read_plan(mission, platform, terrain=terrain)
    except InputError as error:
        if platform is None or Path(platform).is_file():
            raise
        plan = read_plan(mission, terrain=terrain)
        narrate(
            f"{error}\nwarning: this is by the platform file {platform} that is installed here; the vehicle's own decides"
        )
        return plan


def _crew(options: StationOptions) -> CrewOptions:
    """The vehicles for a mission with tasks for any platform.

    Raises:
        InputError: a platform file has mistakes.
    """
    named = options.platform or ()
    names = tuple(filter(None, map(_name_of, named)))
    files = tuple(name for name in named if Path(name).is_file())
    return CrewOptions(names=names, files=files, is_reassigning=options.reassign)


def _name_of(platform: str | None) -> str | None:
    """The name of a platform that was given by its name or file.

    Raises:
        InputError: the file has mistakes.
    """
    if platform is None or not Path(platform).is_file():
        return platform
    from gloc3.platform.reader import load_platform

    return load_platform(platform).platform


def _check(options: StationOptions) -> None:
    """Checks that the options go together.

    Raises:
        Refused: they do not, or one is out of its bounds.
    """
    is_flying = options.headless and options.mission is not None
    if options.json and not options.headless:
        raise Refused("--json goes with --headless")
    if options.override and not is_flying:
        raise Refused("--override goes with --headless and a --mission; in the terminal it is the key o of the checks")
    if (options.start or options.exit_when_done) and options.mission is None:
        raise Refused("--start and --exit-when-done need a --mission")
    if options.at_contact and not (is_flying and len(options.platform or ()) == 1):
        raise Refused("--at-contact goes with --headless, a --mission and a --platform")
    if (options.command or options.commands) and (not is_flying or options.at_contact):
        raise Refused("--command and --commands go with --headless and a --mission that is started")
    for text in options.command or ():
        parse_command(text)
    if options.do and (not options.headless or options.mission is not None or not options.platform):
        raise Refused("--do goes with --headless and a --platform, and without a --mission")
    if options.do:
        _orders(options.do)
    elif options.platform == [EVERY] or (len(options.platform or ()) > 1 and options.mission is None):
        raise Refused(
            "several --platform go with --do, or a --mission whose tasks are for any platform; all goes with --do"
        )
    if options.far_away_ok and not (is_flying and not options.at_contact):
        raise Refused("--far-away-ok goes with --headless and a --mission that is started; the terminal asks")
    if options.reassign and not is_flying:
        raise Refused("--reassign goes with --headless and a --mission; the terminal asks")
    if options.take_over and not ((is_flying and not options.at_contact) or options.do):
        raise Refused("--take-over goes with --headless and a --mission that is started, or --do")
    if not 0.0 < options.within < float("inf"):
        raise Refused("--within must be above 0 seconds")
    if not 0.0 < options.wait < float("inf"):
        raise Refused("--wait must be above 0 seconds")
    if options.station_id is not None and not 200 <= options.station_id <= 255:
        raise Refused("--station-id must be from 200 to 255")
    if options.headless and options.web:
        raise Refused("--web shows the terminal in a browser; with --headless there is none")
    if options.headless and (options.bell or options.speech):
        raise Refused("--bell and --speech announce the terminal's alerts; with --headless there are none")
    has_terminal = all(stream.isatty() for stream in (sys.stdin, sys.stdout, sys.stderr))
    if not (options.headless or options.web or has_terminal):
        raise Refused("there is no terminal here; use --headless, or --web for a browser")
    if options.rtk:
        parse_source(options.rtk)
    for url in (*(options.forward or ()), *(options.forward_both or ())):
        check_forward(url)
    of_the_page = (options.web_token, options.web_tls, options.web_read_only, options.tiles)
    if any(of_the_page) and not options.web:
        raise Refused("--web-token, --web-tls, --web-read-only and --tiles go with --web")
    if options.tiles_attribution is not None and options.tiles is None:
        raise Refused("--tiles-attribution goes with --tiles")
    for name, port in (("foxglove", options.foxglove_port), ("web", options.web_port)):
        if not 0 <= port <= 65535:
            raise Refused(f"--{name}-port must be from 0 to 65535")


def _orders(texts: Sequence[str]) -> "tuple[VehicleCommand, ...]":
    """The commands of `--do`.

    Raises:
        Refused: one is none.
    """
    if not texts:
        return ()
    from gloc3_groundstation.desk.vehicle_commands import parse_vehicle_command

    return tuple(map(parse_vehicle_command, texts))


def _setup(options: StationOptions, configuration: "Configuration") -> "StationSetup":
    """What the station is, by the options and else by its configuration.

    Raises:
        Refused: the signing key cannot be read.
        InputError: the network file cannot be read.
    """
    from gloc3.mavlink.signing_key import read_signing_key
    from gloc3_groundstation.assembly import StationSetup, read_membership
    from gloc3_groundstation.store.recording import default_root

    key_file = options.signing_key or (Path(configuration.signing_key) if configuration.signing_key else None)
    try:
        key = None if key_file is None else read_signing_key(key_file.expanduser())
    except InputError as error:
        raise Refused(str(error)) from None
    return StationSetup(
        boot=secrets.randbits(32),
        system=configuration.station_id if options.station_id is None else options.station_id,
        record=None if options.no_record else default_root(),
        downloads=Path(configuration.downloads or ".").expanduser(),
        signing_key=key,
        network=read_membership(options.network),
    )


def _modem(text: str) -> tuple[str, str]:
    """The platform and the URL of `PLATFORM=URL`.

    Raises:
        Refused: it is written otherwise.
    """
    from gloc3.mavlink.transport.endpoints import parse_url

    name, _, url = text.partition("=")
    if not name or "://" not in url:
        raise Refused(f"--acoustic {text!r} is not PLATFORM=URL, such as auv=udpin://0.0.0.0:15000")
    parse_url(url)
    return name, url
