"""`gloc3 log fork`: flies on from a moment of a recorded flight with something changed."""

from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from gloc3.errors import Refused

HELD: Final = 0
BROKEN: Final = 1


def fork(
    log: Path,
    /,
    *,
    at: float,
    out: Path = Path("runs/fork"),
    component: Annotated[list[str], Parameter(negative=())] | None = None,
    setting: Annotated[list[str], Parameter(negative=())] | None = None,
    fault: Annotated[list[str], Parameter(negative=())] | None = None,
) -> int:
    """Fly on from a moment of a flight in virtual time, with something changed, and show both paths.

    Until then it is the recorded flight, bit for bit: the same seed, faults and commands. The exit code is 1 if an
    invariant of `gloc3 prove` is broken.

    Args:
        log: The log of a `gloc3 fly`, or the folder of its run.
        at: When it changes, in seconds of the flight.
        out: Folder for the new log and `fork.svg`, which shows both paths.
        component: NAME=package.module:Class: creates the component again, of this class; may be repeated.
        setting: NAME.SETTING=VALUE: creates the component again with it; may be repeated.
        fault: A fault without times, as `gloc3 fly --fault` takes it: it begins then; may be repeated.
    """
    from gloc3.log.reader import LogReader, find_log
    from gloc3.messages.topics import TopicTable
    from gloc3_sitl.flight.outputs import recreate
    from gloc3_sitl.proof.fork import Changed
    from gloc3_sitl.proof.fork import fork as fly_on

    if not (component or setting or fault):
        raise Refused("set --component, --setting or --fault: what is changed")
    if out.resolve() in (log.resolve(), log.resolve().parent):
        raise Refused(f"--out {out} is the folder of the recorded flight; choose another one")
    changed = Changed(
        at_s=at,
        components=dict(_split(text, "NAME=package.module:Class") for text in component or ()),
        settings=_settings(setting or []),
        faults=tuple(fault or ()),
    )
    with LogReader(find_log(log), TopicTable.installed().types):
        recreate(out)
    found = fly_on(log, changed, out)
    apart = (
        "the same path"
        if found.apart_s is None
        else f"apart from {found.apart_s:.1f} s on, by {found.most_apart_m:.2f} m at most"
    )
    lines = [*found.story, f"recorded {found.recorded_s:.1f} s; flown {found.flown_s:.1f} s; {apart}"]
    lines += [f"mission {found.state}" + (f" ({found.reason})" if found.reason else ""), *map(str, found.broken)]
    print("\n".join([*lines, f"{out / 'fork.svg'}"]))  # noqa: T201
    return BROKEN if found.broken else HELD


def _settings(texts: list[str]) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for text in texts:
        place, value = _split(text, "NAME.SETTING=VALUE")
        component, dot, name = place.partition(".")
        if not dot or not name:
            raise Refused(f"{text!r} cannot be read; its form is NAME.SETTING=VALUE")
        found.setdefault(component, {})[name] = _value(value)
    return found


def _value(text: str) -> Any:
    """A value as a platform file has it."""
    from gloc3.documents.document import parse

    return parse(f"value: {text}", "--setting").value["value"]


def _split(text: str, form: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise Refused(f"{text!r} cannot be read; its form is {form}")
    return name, value
