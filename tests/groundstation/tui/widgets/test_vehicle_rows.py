"""Among a hundred vehicles only what has changed is looked at: a key is answered at once."""

from msgspec.structs import replace
from tests.groundstation.tui.views.test_views import PLATFORM

from gloc3.messages.summaries import Health
from gloc3_groundstation.station.snapshots import HEALTHS, Fleet, PlatformSnapshot
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.widgets.lines import Line, Span
from gloc3_groundstation.tui.widgets.panel import ListPanel
from gloc3_groundstation.tui.widgets.vehicle_rows import OLDER_EVERY_S, VehicleRows

HUNDRED = Fleet(platforms={name: replace(PLATFORM, name=name) for name in (f"v{n:03d}" for n in range(100))})


class Seen(ListPanel):
    """A list that is not on any screen, of which everything is in sight."""

    width = 80

    def shows(self, index: int) -> bool:
        return index < 50


def test_only_the_rows_of_what_has_changed_are_made_anew() -> None:
    kept, panel, made = VehicleRows(), Seen(id="vehicles"), []

    def make(platform: PlatformSnapshot) -> Line:
        made.append(platform.name)
        return (Span(f"{platform.name} {platform.received_s}"),)

    def rows(fleet: Fleet, in_view: str, now_s: float, of: object = None) -> list[str]:
        made.clear()
        view = StationView(fleet, fleet.get(in_view), now_s, 0.0, "255")
        shown = kept.rows(panel, view, make, of)
        assert [row.key for row in shown] == list(fleet.platforms)
        assert all(bool(row.line) == panel.shows(index) for index, row in enumerate(shown))
        return made

    assert len(rows(HUNDRED, "v000", 100.0)) == 50
    assert rows(HUNDRED, "v000", 100.1) == []
    assert rows(HUNDRED, "v001", 100.1) == ["v000", "v001"]
    reported = replace(HUNDRED.platforms["v007"], received_s=100.2)
    later = replace(HUNDRED, platforms={**HUNDRED.platforms, "v007": reported})
    assert rows(later, "v001", 100.2) == ["v007"]
    assert len(rows(later, "v001", 100.2 + OLDER_EVERY_S)) == 50, "what is shown grows old"
    assert len(rows(later, "v001", 100.2 + OLDER_EVERY_S, "an alert")) == 50


def test_what_has_changed_of_a_fleet_is_told_with_what_it_was() -> None:
    reported = replace(HUNDRED.platforms["v007"], received_s=100.2)
    one = replace(HUNDRED, platforms={**HUNDRED.platforms, "v007": reported})
    new = replace(PLATFORM, name="new")
    more = replace(one, platforms={**one.platforms, "new": new})
    less = replace(more, platforms={name: row for name, row in more.platforms.items() if name not in ("v003", "v004")})
    back = replace(less, platforms={**less.platforms, "v004": reported, "v003": new})
    assert one.changed_since(one) == []
    assert one.changed_since(HUNDRED) == [(HUNDRED.platforms["v007"], reported)]
    assert more.changed_since(one) == [(None, new)]
    assert less.changed_since(more) == []
    assert back.changed_since(replace(more, platforms={**more.platforms})) == [
        (more.platforms["v004"], reported),
        (more.platforms["v003"], new),
    ]


def test_that_all_components_are_well_is_seen_without_looking_at_each() -> None:
    def changed(state: Health, received_s: float = 100.0) -> PlatformSnapshot:
        line, _ = PLATFORM.lines[0]
        lines = {**PLATFORM.lines, 0: (replace(line, state=HEALTHS.index(state)), received_s)}
        return replace(PLATFORM, lines=lines)

    assert PLATFORM.is_all_well(100.0), "a standby that is quiet is well"
    assert not PLATFORM.is_all_well(160.0)
    assert not changed(Health.WORKING, 10.0).is_all_well(100.0)
    assert not any(changed(state).is_all_well(100.0) for state in (Health.FAULTY, Health.QUIET, Health.IDLE))
    assert not replace(PLATFORM, table=None).is_all_well(100.0)
    assert not replace(PLATFORM, lines={}).is_all_well(100.0)
