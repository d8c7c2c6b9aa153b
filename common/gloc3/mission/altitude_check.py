"""Whether ways that keep a height over the ground can be flown so: somebody measures it, and it is not too low."""

from collections.abc import Iterator

from gloc3.deployment import ComponentRow
from gloc3.errors import Finding, Gloc3Error
from gloc3.mission.abilities import abilities
from gloc3.mission.arguments import FollowWaypointsOrder
from gloc3.mission.model import FLY_PLAN, Mission, where_of
from gloc3.platform import Platform
from gloc3.vehicle import HeightAboveGround


def altitude_findings(mission: Mission, platform: Platform | None) -> Iterator[Finding]:
    """An `altitude_m` on a platform that keeps none, or lower than it may be asked for."""
    document = mission.document
    if document is None or platform is None:
        return
    rows, topics, known = {row.name: row for row in platform.components}, platform.topics(), abilities(platform)
    for target, action in mission.actions().items():
        order = action.order
        if not isinstance(order, FollowWaypointsOrder) or order.altitude_m is None or action.ability == FLY_PLAN:
            continue
        where = (*where_of(target), action.capability, "altitude_m")
        ability = known.get(action.ability)
        row = rows.get(ability.performed_by) if ability is not None else None
        if row is not None and not _hears_heights(row, topics):
            message = f"{row.name} of {platform.platform} keeps no height over the ground: it hears of none"
            yield document.finding(where, message, "say height_m, or bind its input to what a range finder tells")
        least_m = platform.limits.altitude_min_m
        if order.altitude_m < least_m:
            message = f"{order.altitude_m:g} m over the ground are less than the platform's {least_m:g} m"
            yield document.finding(where, message, "keep higher")


def _hears_heights(row: ComponentRow, topics: set[str]) -> bool:
    """Whether a component's inputs bring it heights over the ground; true where its class is not installed here."""
    try:
        inputs = row.load_class().inputs
    except Gloc3Error:
        return True
    heard = (topic for port, of in inputs.items() if of.message is HeightAboveGround for topic in row.topics(port))
    return any(topic in topics for topic in heard)
