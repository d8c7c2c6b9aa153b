"""`gloc3 prove`: looks for a flight that goes wrong, and shrinks it to the smallest one."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

from cyclopts import App, Parameter

from gloc3.cli.narration import narrate
from gloc3.errors import Refused

if TYPE_CHECKING:
    from gloc3_sitl.proof.campaign import SearchProgress
    from gloc3_sitl.proof.case import FlightCase

EXIT_HOLDS: Final = 0
EXIT_BROKEN: Final = 1
INTERRUPTED: Final = 130
FLIGHTS: Final = 200
OUT: Final = Path("runs/prove")

app = App(
    name="gloc3 prove",
    help="""Look for a flight that goes wrong: fly a mission hundreds of times in virtual time, each time with other faults,
    at other moments, in other weather, and judge each flight by what must always hold (`--invariants` lists it).

    For example:

    - `gloc3 prove hop`: 200 flights on all cores
    - `gloc3 prove patrol --platform pelican_rtk --minutes 10 --out runs/patrol`: may be interrupted and called again
    - `gloc3 prove survey --platform auv --autopilot ardupilot --flights 1000 --seed 7 --json`
    - `gloc3 prove hop --platform pelican_rtk --static`: for every component and action, what happens if the component dies
    - `gloc3 prove --replay runs/prove/found/01-it_ends/replay.json`: fly one finding again, and tell what happens

    One to three faults at a time are drawn from everything that fits the platform (see `gloc3 fly --help`), at moments
    around the beginning of each action more often than elsewhere. At first every other flight has a short one alone, in
    each action and around each change of state or mode. Flights that reach something new (an event, a state, a mode, a
    policy, an order of events) are varied further. A flight that breaks an invariant is shrunk: fewest faults, calm
    weather, shortest mission, shortest and earliest faults. It is left in `OUT/found/NN-INVARIANT`:

    - `replay.json`: one line, for `gloc3 prove --replay`; a line of `tests/proof/found_cases.jsonl` makes it a test
    - `cause.txt`: five lines: what must hold, what was so, what led there
    - `log.mcap` and `path.svg`, as `gloc3 fly --out` leaves them

    The same mission, platform and seed give the same flights on any number of cores. Exit codes: 0 everything held;
    1 an invariant was broken; 2 wrong use; 130 interrupted (call it again with the same folder to go on).""",
    help_format="markdown",
    version_flags=[],
)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ProveOptions:
    """The options of `gloc3 prove`, one field each."""

    platform: str | None = None
    """A platform file, or the name of an installed platform; by default as in `gloc3 fly`."""
    autopilot: Literal["px4", "ardupilot"] | None = None
    """Style of the simulated autopilot; by default the vehicle's usual one."""
    flights: int | None = None
    """So many flights, rounded up to whole rounds of 16; 200 where no --minutes are given."""
    minutes: float | None = None
    """So long, before findings are shrunk."""
    jobs: int | None = None
    """Flights at a time; by default one for each core."""
    seed: int = 0
    """Seed of the search, and the first seed of its flights."""
    world: str = ""
    """As in `gloc3 fly`."""
    ignore: Annotated[list[str], Parameter(negative=())] | None = None
    """An invariant that is not judged, by name; may be repeated."""
    first: Annotated[bool, Parameter(negative=())] = False
    """Stop at the first broken invariant."""
    shrink: int = 80
    """So many flights, at most, to shrink each finding."""
    out: Path | None = None
    """Folder for the search's state and its findings; by default runs/prove."""
    replay: Path | None = None
    """Fly a replay file again in place of a search; with --out it leaves log and picture there."""
    static: Annotated[bool, Parameter(negative=())] = False
    """From platform file and mission alone: who takes over, or which policy flies, if a component dies during an action."""
    fly: Annotated[bool, Parameter(negative=())] = False
    """With --static: fly the answers, too; actions of one capability share a flight where the answer is the same."""
    invariants: Annotated[bool, Parameter(negative=())] = False
    """List the invariants, and do nothing else."""
    json: Annotated[bool, Parameter(negative=())] = False
    """Print the result on stdout as JSON."""
    quiet: Annotated[bool, Parameter(negative=())] = False
    """No progress on stderr."""


@app.default
def prove(mission: str = "", /, options: ProveOptions = ProveOptions()) -> int:
    """Look for a flight that goes wrong.

    Args:
        mission: A mission file (.yaml, .plan, WPL), or an example by its name.
        options: how.
    """
    if options.invariants:
        return _list_invariants()
    if options.replay is not None:
        return _replay(options.replay, options)
    if not mission:
        raise Refused("name a mission, or set --replay FILE")
    if options.fly and not options.static:
        raise Refused("--fly goes with --static")
    if options.jobs is not None and options.jobs < 1:
        raise Refused("--jobs must be 1 or more")
    if options.static and (options.flights or options.minutes or options.first or options.ignore):
        raise Refused("--flights, --minutes, --first and --ignore are about the search, not about --static")
    return _static(mission, options) if options.static else _search(mission, options)


def _list_invariants() -> int:
    from gloc3_sitl.proof.standard_invariants import all_invariants

    for kind in all_invariants():
        print(f"{kind.name}: {kind.sentence}")  # noqa: T201
    return EXIT_HOLDS


def _replay(path: Path, options: ProveOptions) -> int:
    import msgspec

    from gloc3_sitl.proof.found import replay

    result = replay(path, options.out)
    if options.json:
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(result), indent=2).decode() + "\n")
    else:
        for line in result.story:
            narrate(line)
        ended = f"mission {result.state or 'not started'}" + (f" ({result.reason})" if result.reason else "")
        print("\n".join([f"{ended}, {result.ended_s:.1f} s", *(str(one) for one in result.broken)]))  # noqa: T201
    return EXIT_BROKEN if result.broken or not result.started_s else EXIT_HOLDS


def _static(mission: str, options: ProveOptions) -> int:
    import msgspec

    from gloc3_sitl.proof.search import flying
    from gloc3_sitl.proof.static_flights import FlownCell, distinct_cells, fly_cells, prove_case

    base = _base(mission, options)
    proof = prove_case(base)
    flown: tuple[FlownCell, ...] = ()
    if options.fly:
        with flying(options.jobs or os.cpu_count() or 1) as fly:
            cells = distinct_cells(proof.cells)
            flown = tuple(fly_cells(cells, base, fly, (lambda _: None) if options.quiet else narrate))
    if options.json:
        found = {"proof": proof, "flown": flown}
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(found), indent=2).decode() + "\n")
    else:
        from gloc3_sitl.cli.prove_table import cells_as_lines

        print("\n".join([*cells_as_lines(proof), *(str(one) for one in proof.findings)]))  # noqa: T201
        wrong = [one for one in flown if one.problem]
        print("\n".join(f"{one.case.command()}: {one.problem}" for one in wrong), end="\n" if wrong else "")  # noqa: T201
    is_broken = any(not one.is_warning for one in proof.findings) or any(one.problem for one in flown)
    return EXIT_BROKEN if is_broken else EXIT_HOLDS


def _base(mission: str, options: ProveOptions) -> "FlightCase":
    """The flight without faults."""
    from gloc3_sitl.flight.mission_file import find_file, platform_for
    from gloc3_sitl.proof.case import FlightCase
    from gloc3_sitl.world import World

    if options.world:
        World.load(options.world)
    return FlightCase(
        mission=mission,
        platform=options.platform or platform_for(find_file(mission)),
        autopilot=options.autopilot or "",
        seed=options.seed,
        world=options.world,
    )


def _search(mission: str, options: ProveOptions) -> int:
    import msgspec

    from gloc3_sitl.cli.prove_table import shown
    from gloc3_sitl.proof.campaign import SearchLimits, run_search
    from gloc3_sitl.proof.standard_invariants import invariants_but

    if options.flights is not None and options.flights < 1:
        raise Refused("--flights must be 1 or more")
    if options.minutes is not None and not options.minutes > 0.0:
        raise Refused("--minutes must be more than 0")
    if options.shrink < 0:
        raise Refused("--shrink must be 0 or more")
    if options.seed < 0:
        raise Refused("--seed must be 0 or more")
    kinds = invariants_but(options.ignore or ())
    base = _base(mission, options)
    flights = options.flights if options.flights or options.minutes else FLIGHTS
    seconds = 60.0 * options.minutes if options.minutes else None
    limits = SearchLimits(flights=flights, seconds=seconds, stops_at_first=options.first, shrink_flights=options.shrink)
    jobs, out = options.jobs or os.cpu_count() or 1, options.out or OUT
    try:
        with shown(limits.flights, is_quiet=options.quiet) as report:
            progress = run_search(base, limits, jobs, out, report, kinds)
    except KeyboardInterrupt:
        narrate(f"gloc3 prove: interrupted; the same command with --out {out} goes on from here")
        return INTERRUPTED
    if options.json:
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(progress), indent=2).decode() + "\n")
    else:
        print("\n".join(as_lines(progress)))  # noqa: T201
    return EXIT_BROKEN if progress.found or progress.broken else EXIT_HOLDS


def as_lines(progress: "SearchProgress") -> list[str]:
    """The result as readable text."""
    reached = ", ".join(f"{count} {kind}" for kind, count in progress.reached.items())
    lines = [
        f"{progress.mission} on {progress.platform}: {progress.flights} flights, {progress.simulated_s / 3600.0:.1f} h simulated",
        f"  reached  {reached}",
        "  ended    " + ", ".join(f"{count} {state}" for state, count in progress.states.items()),
    ]
    if not progress.found:
        held = ", ".join(f"{count} {name}" for name, count in progress.broken.items())
        return [
            *lines,
            f"  broken   {held}: the flights hold when they are flown again" if held else "  every invariant held",
        ]
    for number, found in enumerate(progress.found, start=1):
        lines += ["", f"{number}. {found.broken.invariant}", f"   {found.command}"]
        lines += [f"   gloc3 prove --replay {found.folder}/replay.json"] if found.folder else []
        lines += [f"   {line}" for line in found.cause]
    return lines
