"""The command `gloc3 platform`: make, check and show platform files."""

import asyncio
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, TypeVar

import msgspec
from cyclopts import App, Parameter

from gloc3.cli.counting import counted
from gloc3.cli.narration import narrate
from gloc3.documents.characters import printable
from gloc3.errors import Refused
from gloc3_onboard.cli.onboard_options import DEFAULT_AUTOPILOT, MOST_SYSTEM_ID, Flag

T = TypeVar("T")
NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,31}")

app = App(
    name="gloc3 platform",
    help="""Make, check and show platform files: what a vehicle is, can do, is limited to, and is made of.

    For example:

    - `gloc3 platform new --autopilot serial:///dev/ttyACM0:57600`: asks, and writes a file from the autopilot's data
    - `gloc3 platform check my.yaml`: everything that `gloc3 onboard` would refuse, with file, line and column
    - `gloc3 platform show my.yaml`; with `--full` the whole file, with what it extends

    Exit codes: 0 done, or fit to be used; 1 something is wrong in the file; 2 wrong use.""",
    help_format="markdown",
    version_flags=[],
)


@app.command
def check(platform: str, /, *, json: Flag = False) -> int:
    """Check a platform file: everything that `gloc3 onboard` would refuse, at once.

    Args:
        platform: A platform file, or the name of one that is installed, such as pelican.
        json: Print the report as JSON.
    """
    from gloc3_onboard.cli.platform_report import report_on

    report = report_on(platform)
    if json:
        print(msgspec.json.format(msgspec.json.encode(report.as_dict()), indent=2).decode())  # noqa: T201
        return 0 if report.is_ok else 1
    for finding in report.findings:
        print(printable(str(finding)))  # noqa: T201
    errors = sum(not finding.is_warning for finding in report.findings)
    warnings = len(report.findings) - errors
    noted = f" ({counted(warnings, 'warning')})" if warnings else ""
    verdict = f"can be used{noted}" if report.is_ok else f"cannot be used: {counted(errors, 'error')}"
    print(f"{report.file} {verdict}")  # noqa: T201
    return 0 if report.is_ok else 1


@app.command
def show(platform: str, /, *, full: Flag = False) -> int:
    """Show a platform: its limits, failsafes, frames, capabilities, devices, hosts and components.

    Args:
        platform: A platform file, or the name of one that is installed, such as pelican.
        full: Print the whole file instead, with everything that it extends.
    """
    from gloc3.platform.reader import whole_text
    from gloc3_onboard.cli.platform_report import described, report_on

    report = report_on(platform)
    if report.platform is None:
        for finding in report.findings:
            narrate(str(finding))
        return 1
    print(printable(whole_text(platform).rstrip() if full else "\n".join(described(report.platform))))  # noqa: T201
    return 0


@app.command
def schema(*, out: Path | None = None) -> int:
    """Print the JSON Schema of platform files, by which editors complete, explain and check them.

    It knows the installed components with their ports and settings, and the installed kinds of arguments.

    Args:
        out: The file to write it to, instead of printing it.
    """
    from gloc3.documents.json_schema import as_text
    from gloc3.platform.schema import platform_schema

    text = as_text(platform_schema())
    if out is None:
        sys.stdout.write(text)
    else:
        try:
            out.write_text(text, encoding="utf-8")
        except OSError as error:
            raise Refused(f"{out} cannot be written: {error.strerror or error}") from error
    return 0


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class NewOptions:
    """The options of `gloc3 platform new`; what one answers is not asked."""

    autopilot: str = DEFAULT_AUTOPILOT
    """Link to the autopilot, as for gloc3 onboard."""
    name: str | None = None
    """Name of the platform: lower-case letters, digits and _."""
    type: str | None = None
    """Vehicle type, such as quadrotor or hexarotor."""
    mass_kg: float | None = None
    """Its mass, in kilograms."""
    speed_m_s: float | None = None
    """Greatest horizontal speed, in metres a second."""
    height_max_m: float | None = None
    """Greatest height above home, in metres."""
    battery_wh: float | None = None
    """Energy of the full battery, in watt hours."""
    arm: bool | None = None
    """Whether a mission may arm the vehicle."""
    on_stop: Literal["hold", "land"] | None = None
    """Action in flight when the onboard process is stopped: hold or land."""
    camera: str | None = None
    """Source of a downward-looking camera, such as v4l2:///dev/video0; empty for none."""
    file: Path | None = None
    """Output file; default: NAME.yaml here. An existing file is not overwritten."""
    wait: float = 20.0
    """How long to listen to the autopilot, in seconds; it ends as soon as everything is known."""
    system_id: int = 1
    """The vehicle's MAVLink system."""
    yes: Flag = False
    """Ask nothing: assume what no option answers, and print it."""

    def check(self) -> None:
        """Refuses what cannot be.

        Raises:
            Refused: an option is out of its bounds.
        """
        if not 0.0 < self.wait < float("inf"):
            raise Refused("--wait must be above 0 seconds")
        if not 1 <= self.system_id <= MOST_SYSTEM_ID:
            raise Refused(f"--system-id must be from 1 to {MOST_SYSTEM_ID}; those above are stations'")


DEFAULTS: Final = NewOptions()


@app.command
def new(*, options: NewOptions = DEFAULTS) -> int:
    """Make a platform file from a connected autopilot: it asks what the autopilot cannot tell, writes and explains it.

    What an option answers is not asked. Run it while `gloc3 onboard` is not running; nothing is changed on the autopilot.
    """
    options.check()
    from gloc3_onboard.cli.platform_new import KINDS, Answers, platform_text, probe_autopilot
    from gloc3_onboard.cli.platform_report import report_on

    narrate(f"listening at {options.autopilot}")
    found = asyncio.run(probe_autopilot(options.autopilot, options.wait, options.system_id))
    narrate(f"found {found.title}")
    kind = KINDS.get(found.setup.vehicle) if found.setup.vehicle is not None else None
    if kind is None:
        raise Refused(f"no components are available for {found.title}; see docs/autopilots.md")
    request = _Prompt(may_prompt=not options.yes)

    def number(option: str, question: str, given: float | None, assumed: float, read: Callable[[str], float]) -> float:
        default, source = found.readings.get(option.removeprefix("--").replace("-", "_"), (assumed, ""))
        return request(option, question, given, default, read, source)

    answers = Answers(
        name=request("--name", "Name of the platform", options.name, f"my_{found.setup.vehicle}", _name),
        type=request(
            "--type",
            f"Vehicle type ({', '.join(kind.types)})",
            options.type,
            found.type or kind.types[0],
            _one_of(kind.types),
            f"MAV_TYPE {found.mav_type}" if found.type else "",
        ),
        mass_kg=request("--mass-kg", "Mass in kg", options.mass_kg, kind.mass_kg, _positive),
        speed_m_s=number("--speed-m-s", "Greatest speed in m/s", options.speed_m_s, kind.speed_m_s, _positive),
        height_max_m=number(
            "--height-max-m", "Greatest height above home in m", options.height_max_m, kind.heights_m[1], _number
        ),
        battery_wh=number(
            "--battery-wh", "Energy of the full battery in Wh", options.battery_wh, kind.battery_wh, _positive
        ),
        arm=request("--arm", "May a mission arm it (yes, no)", options.arm, False, _yes_or_no),
        on_stop=request(
            "--on-stop", "Action at a stop in flight (hold, land)", options.on_stop, "hold", _one_of(("hold", "land"))
        ),
        camera=request(
            "--camera",
            "Source of a downward-looking camera (such as v4l2:///dev/video0, or nothing)",
            options.camera,
            "",
            _camera,
        ),
    )
    path = options.file or Path(f"{answers.name}.yaml")
    try:
        with path.open("x") as stream:
            stream.write(platform_text(found, answers))
    except FileExistsError:
        raise Refused(f"{path} already exists; move it, or name another with --file") from None
    report = report_on(str(path))
    for finding in report.findings:
        narrate(str(finding))
    narrate(
        f"wrote {path}. Read it: failsafes, and values with a parameter's name behind them, are the autopilot's; check the others.\n"
        f"Then:  gloc3 platform check {path}   what would be refused\n"
        f"       gloc3 doctor {path} --autopilot {options.autopilot}   the checks before a start\n"
        f"       gloc3 onboard {path} --autopilot {options.autopilot}   fly it; install in place of it makes a service"
    )
    return 0 if report.is_ok else 1


class _Prompt:
    """Asks a person, where there is one, for what no option has answered."""

    def __init__(self, *, may_prompt: bool) -> None:
        self._may_prompt = may_prompt
        if may_prompt and not sys.stdin.isatty():
            raise Refused("there is no terminal to ask on; answer with options, and add --yes to assume the rest")

    def __call__(
        self, option: str, question: str, given: T | None, default: T, read: Callable[[str], T], source: str = ""
    ) -> T:
        """The answer, by default the read or assumed value; raises `Refused` if an option's value is invalid."""
        if given is not None:
            try:
                return read(str(given))
            except ValueError as error:
                raise Refused(f"{option}: {error}") from None
        shown = (
            {True: "yes", False: "no", "": "nothing"}.get(default, str(default))
            if isinstance(default, bool | str)
            else f"{default:g}"
        )
        if not self._may_prompt:
            narrate(f"read: {option} {shown} ({source})" if source else f"assumed: {option} {shown}")
            return default
        while True:
            text = input(f"{question} [{shown}{f', {source}' if source else ''}]: ").strip()
            try:
                return read(text) if text else default
            except ValueError as error:
                narrate(f"  {error}")


def _name(text: str) -> str:
    if not NAME.fullmatch(text):
        raise ValueError(f"{text!r} is not a name: lower-case letters, digits and _, a letter first, at most 32")
    return text


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{text!r} is not a number") from None
    if not -1e6 < value < 1e6:
        raise ValueError(f"{text} is too large")
    return value


def _positive(text: str) -> float:
    if (value := _number(text)) <= 0.0:
        raise ValueError(f"{text} must be above 0")
    return value


def _yes_or_no(text: str) -> bool:
    known = {"yes": True, "y": True, "true": True, "no": False, "n": False, "false": False}
    if text.lower() not in known:
        raise ValueError(f"{text!r} is neither yes nor no")
    return known[text.lower()]


def _camera(text: str) -> str:
    from gloc3_onboard.sensors.registry import parse_source

    if text:
        try:
            parse_source("ground_camera", text)
        except Refused as refusal:
            raise ValueError(str(refusal)) from None
    return text


def _one_of(known: tuple[str, ...]) -> Callable[[str], str]:
    def read(text: str) -> str:
        if text not in known:
            raise ValueError(f"{text!r} is none of {', '.join(known)}")
        return text

    return read
