"""Which vehicle is in view, and that no other comes into view by itself."""

from gloc3_groundstation.station.fleet import renamed, with_platform, without
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot
from gloc3_groundstation.tui.in_view import WAITS_S, InView


def fleet(*names: str) -> Fleet:
    return Fleet(
        platforms={name: PlatformSnapshot(name=name, boot=1, first_received_s=0.0, received_s=0.0) for name in names}
    )


def seen(view: InView, known: Fleet) -> str:
    platform = view.platform(known)
    return platform.name if platform else ""


def test_the_first_that_is_heard_is_in_view_until_that_of_the_last_session_comes() -> None:
    view = InView(None, "egret")
    assert seen(view, fleet()) == ""
    view.settle(fleet("heron"), 1.0)
    assert seen(view, fleet("heron")) == "heron"
    assert seen(view, fleet("heron", "egret")) == "egret"


def test_after_a_while_it_stays_although_that_of_the_last_session_comes() -> None:
    view = InView(None, "egret")
    view.settle(fleet("heron"), WAITS_S)
    view.settle(fleet("heron", "egret"), WAITS_S + 1.0)
    assert seen(view, fleet("heron", "egret")) == "heron"


def test_one_that_was_asked_for_is_waited_for() -> None:
    view = InView("egret", "heron")
    view.settle(fleet("heron"), 100.0)
    assert seen(view, fleet("heron")) == ""
    assert seen(view, fleet("heron", "egret")) == "egret"


def test_the_next_after_the_last_is_the_first() -> None:
    view, known = InView(None, ""), fleet("heron", "egret", "ibis")
    passed = []
    for step in (1, 1, 1, -1):
        view.cycle(known, step)
        passed.append(view.name)
    assert passed == ["egret", "ibis", "heron", "ibis"]
    InView(None, "").cycle(fleet(), 1)


def test_a_vehicle_stays_in_view_under_the_name_that_its_companion_gives_it() -> None:
    view, known = InView(None, ""), fleet("heron", "px4-2")
    view.show_vehicle("px4-2")
    known = renamed(with_platform(known, fleet("egret").platforms["egret"]), "px4-2", "egret", 8.0)
    assert seen(view, known) == "egret"
    view.settle(known, 8.0)
    assert view.name == "egret"


def test_no_other_vehicle_comes_into_view_for_one_that_is_no_longer_shown() -> None:
    for step, next_one in ((1, "heron"), (-1, "ibis")):
        view, known = InView(None, ""), fleet("egret", "heron", "ibis")
        view.settle(known, WAITS_S)
        left = without(known, "egret")
        view.settle(left, WAITS_S + 1.0)
        assert seen(view, left) == ""
        assert seen(view, known) == "egret", "when it comes back it is in view again"
        view.cycle(left, step)
        assert seen(view, left) == next_one


def test_a_name_that_is_used_by_another_vehicle_later_leads_to_no_other_one() -> None:
    view, known = InView(None, "px4-2"), renamed(fleet("egret", "px4-2"), "px4-2", "egret", 8.0)
    again = with_platform(known, fleet("px4-2").platforms["px4-2"])
    view.settle(again, 9.0)
    assert seen(view, again) == "px4-2"
    assert seen(view, without(again, "px4-2")) == ""
