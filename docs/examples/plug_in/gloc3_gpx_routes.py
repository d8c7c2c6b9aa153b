"""GPX routes as plans: the points of the first route become waypoints of the autopilot, and back.

The elevations of GPX are heights above the sea. A document type is refused, so entities cannot blow a file up.
"""

from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import escape

from gloc3.errors import Finding, InputError, Refused
from gloc3.mission.formats.items import ForeignPlan, MavItem, PlanEntry
from gloc3.mission.formats.plan_format import PlanFormat

WAYPOINT = 16
"""MAV_CMD_NAV_WAYPOINT."""
ABOVE_SEA, ABOVE_HOME = (0, 5), (3, 6)
"""MAV_FRAME of heights."""
MOST_POINTS = 10_000


class _RouteReader:
    """Collects the points of the first route."""

    def __init__(self, file: str) -> None:
        self.items: list[MavItem] = []
        self.lines: list[int] = []
        self.findings: list[Finding] = []
        self.warnings: list[Finding] = []
        self._file = file
        self._path: list[str] = []
        self._text = ""
        self._routes = 0
        self._parser = expat.ParserCreate(namespace_separator=" ")
        self._parser.StartDoctypeDeclHandler = self._refuse
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._characters

    def read(self, data: bytes) -> None:
        """Reads a file."""
        try:
            self._parser.Parse(data, True)
        except expat.ExpatError as error:
            self._find(f"not XML: {expat.ErrorString(error.code)}", line=error.lineno)

    def _refuse(self, *_declared: object) -> None:
        raise InputError([self._finding("a document type is not read", hint="remove the line <!DOCTYPE …>")])

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._path.append(name.rpartition(" ")[2])
        self._text = ""
        if len(self._path) == 1 and self._path[0] != "gpx":
            raise InputError([self._finding(f"<{self._path[0]}> is no GPX file", hint="it begins with <gpx>")])
        self._routes += self._path[-1] == "rte"
        if self._path[-1] == "rte" and self._routes == 2:
            line = self._parser.CurrentLineNumber
            message = "further routes are left out: the first is read"
            self.warnings.append(Finding(file=self._file, line=line, message=message, is_warning=True))
        if self._path[-1] == "rtept" and self._routes == 1:
            place = [self._number(attributes.get(key, ""), key, most) for key, most in (("lat", 90), ("lon", 180))]
            self.items.append(MavItem(command=WAYPOINT, frame=ABOVE_SEA[0], x=place[0], y=place[1], z=None))
            self.lines.append(self._parser.CurrentLineNumber)
            if len(self.items) > MOST_POINTS:
                raise InputError([self._finding(f"more than {MOST_POINTS} points")])

    def _end(self, _name: str) -> None:
        if self._path[-2:] == ["rtept", "ele"] and self._routes == 1:
            last, height_m = self.items[-1], self._number(self._text, "elevation", 10_000)
            self.items[-1] = MavItem(command=last.command, frame=last.frame, x=last.x, y=last.y, z=height_m)
        elif self._path[-1] == "rtept" and self._routes == 1 and self.items[-1].z is None:
            self._find(f"point {len(self.items)} has no elevation", "add <ele>, in metres above the sea")
        self._path.pop()

    def _characters(self, text: str) -> None:
        self._text += text

    def _number(self, text: str, what: str, most: float) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not -most <= value <= most:
            self._find(f"{what} {text!r} is no number from {-most} to {most}")
            return 0.0
        return value

    def _find(self, message: str, hint: str = "", line: int = 0) -> None:
        self.findings.append(self._finding(message, hint, line))

    def _finding(self, message: str, hint: str = "", line: int = 0) -> Finding:
        line = line or self._parser.CurrentLineNumber
        return Finding(file=self._file, line=line, column=1, message=message, hint=hint)


def read(data: bytes, file: str) -> ForeignPlan:
    """Reads the first route of a GPX file.

    Raises:
        InputError: with everything that is wrong in it.
    """
    reader = _RouteReader(file)
    reader.read(data)
    if not reader.items and not reader.findings:
        hint = "draw a route; tracks are recordings of a path"
        reader.findings.append(Finding(file=file, message="it has no route (<rte>)", hint=hint))
    if reader.findings:
        raise InputError(reader.findings)
    entries = tuple(PlanEntry(items=(item,)) for item in reader.items)
    return ForeignPlan(entries=entries, lines=tuple(reader.lines), findings=tuple(reader.warnings))


def write(plan: ForeignPlan, file: str) -> tuple[str, list[Finding]]:
    """The waypoints of a plan as a route, and warnings of what it leaves out.

    Raises:
        InputError: a height above home cannot be written, because the plan has no home.
    """
    points, lost = [], []
    for number, item in enumerate(plan.items, start=1):
        if item.command != WAYPOINT or not item.has_position:
            lost.append((number, f"item {number} (command {item.command}) is left out: a route has waypoints alone"))
            continue
        try:
            points.append(
                f'    <rtept lat="{item.x:.7f}" lon="{item.y:.7f}"><ele>{_above_sea_m(item, plan):.2f}</ele></rtept>'
            )
        except Refused as refusal:
            raise InputError([Finding(file=file, line=plan.line_of(number), message=str(refusal))]) from None
    if plan.fence or plan.rally:
        lost.append((0, "the fence and the rally points are left out"))
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    head += '<gpx version="1.1" creator="GLOC3" xmlns="http://www.topografix.com/GPX/1/1">'
    text = "\n".join((head, f"  <rte><name>{escape(Path(file).stem)}</name>", *points, "  </rte>", "</gpx>", ""))
    findings = [Finding(file=file, line=plan.line_of(number), message=one, is_warning=True) for number, one in lost]
    return text, findings


def _above_sea_m(item: MavItem, plan: ForeignPlan) -> float:
    height_m = item.z or 0.0
    if item.frame in ABOVE_SEA:
        return height_m
    if item.frame in ABOVE_HOME and plan.home is not None:
        return plan.home[2] + height_m
    raise Refused("a height above home or the ground is no elevation above the sea, because the plan has no home")


FORMAT = PlanFormat(title="GPX route", suffixes=(".gpx",), read=read, write=write)
