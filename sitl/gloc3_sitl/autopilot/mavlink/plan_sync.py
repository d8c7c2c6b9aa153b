"""Missions, fences and rally points over MAVLink: upload checks, activation and download."""

from typing import Final

from gloc3.mavlink.services.mission_server import MissionDialect, MissionServer
from gloc3.mavlink.services.mission_transfers import PlanReceived, SetCurrentRequested
from gloc3.mavlink.services.plan import Plan, PlanItem, PlanResult, PlanType
from gloc3.messages.envelope import Severity
from gloc3_sitl.autopilot.mavlink.context import FrontContext
from gloc3_sitl.autopilot.plans import StoredItem, StoredPlans, check_fence_item, check_mission_item, check_rally_item

_LOCAL_FRAMES: Final = frozenset({1, 4, 7, 8, 9, 20, 21})
_WAYPOINT: Final = 16
_TOTALS: Final = {PlanType.MISSION: "MIS_TOTAL", PlanType.FENCE: "FENCE_TOTAL"}
"""ArduPilot's parameters that count the items."""


def stored(item: PlanItem) -> StoredItem:
    """An item of the wire in plain units."""
    per_unit = 1e4 if item.frame in _LOCAL_FRAMES else 1e7
    return StoredItem(
        command=item.command,
        frame=item.frame,
        parameters=(item.param1, item.param2, item.param3, item.param4),
        latitude_deg=item.x / per_unit,
        longitude_deg=item.y / per_unit,
        height_m=item.z,
    )


class PlanSync:
    """Keeps the mission server and the autopilot's plans in step."""

    def __init__(self, context: FrontContext) -> None:
        self._context = context
        self._first = context.craft.first_item
        self.server: Final = MissionServer(
            context.own,
            check=self._check,
            check_item=self._check_item,
            dialect=MissionDialect(tells_current=False, is_old=not context.is_px4),
        )
        self._reported_home: object = None

    def load(self, other: "PlanSync") -> None:
        """Restores the plans after a reboot."""
        for kind, items in other.server.plans.items():
            self.server.set_plan(kind, items)
        self.server.events()

    def tick(self) -> None:
        """Activates new plans, and keeps ArduPilot's item 0 at home."""
        for event in self.server.events():
            match event:
                case PlanReceived():
                    self._apply_plan(event)
                case SetCurrentRequested(number):
                    self._context.set_current(number)
        home = self._context.craft.home
        if self._first and home is not self._reported_home:
            self._put_home()

    @property
    def _is_vtol(self) -> bool:
        return self._context.craft.vtol is not None

    def _check_item(self, kind: PlanType, index: int, count: int, item: PlanItem) -> PlanResult:
        """Both firmwares refuse an item as it comes."""
        given = stored(item)
        if kind is PlanType.FENCE:
            result, reason = check_fence_item(given)
        elif kind is PlanType.RALLY:
            result, reason = check_rally_item(given)
        elif index < self._first:
            return PlanResult.ACCEPTED  # home, whatever it says
        else:
            result, reason = check_mission_item(given, count, is_vtol=self._is_vtol, is_px4=self._context.is_px4)
        if result is not PlanResult.ACCEPTED:
            self._context.craft.send_text(
                Severity.CRITICAL, f"{kind.name.capitalize()} rejected: item {index}: {reason}"
            )
        return result

    def _check(self, kind: PlanType, items: Plan) -> PlanResult:
        if kind is PlanType.FENCE:
            try:
                StoredPlans().set_fence(tuple(stored(item) for item in items))
            except ValueError as error:
                self._context.craft.send_text(Severity.CRITICAL, f"Fence rejected: {error}")
                return PlanResult.INVALID
        return PlanResult.ACCEPTED

    def _apply_plan(self, event: PlanReceived) -> None:
        plans, craft = self._context.autopilot.plans, self._context.craft
        items = tuple(stored(item) for item in event.items)
        match event.kind:
            case PlanType.MISSION:
                plans.set_mission(items)
                is_px4 = self._context.is_px4
                craft.mission.on_upload(plans.mission_count, len(items), self._first, reports_old=is_px4)
                flight = self._context.mission_flight
                if flight is not None:
                    flight.skip_to(self._first)
                self._reported_home = None
            case PlanType.FENCE:
                plans.set_fence(items)
            case PlanType.RALLY:
                plans.set_rally(items)
        total = _TOTALS.get(event.kind, "")
        if total in self._context.autopilot.parameters:
            self._context.autopilot.parameters.set(total, min(len(items), 255))

    def _put_home(self) -> None:
        """ArduPilot's missions carry home as item 0."""
        home = self._context.craft.home
        self._reported_home = home
        if home is None:
            return
        latitude, longitude, altitude = home.place
        first = PlanItem(
            command=_WAYPOINT,
            frame=0,
            is_current=False,
            x=round(latitude * 1e7),
            y=round(longitude * 1e7),
            z=altitude,
        )
        self.server.home = first
        if self.server.plans[PlanType.MISSION]:
            self.server.set_plan(PlanType.MISSION, (first, *self.server.plans[PlanType.MISSION][1:]))
