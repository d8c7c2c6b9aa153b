"""Which vehicle is in view, and that no other comes into view by itself."""

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
