"""Faults as text: what is read, and what is refused in words that help."""

import contextlib
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gloc3.errors import Refused
from gloc3_sitl.faults.fault_effects import EFFECTS
from gloc3_sitl.faults.faults import FAULTS_HELP, SHORT, read_fault


@pytest.mark.parametrize(
    ("text", "kind", "begin_s", "lasts_s"),
    [
        ("link_loss@30..60", "link_loss", 30.0, 30.0),
        ("link_loss=0.3", "link_loss", None, inf),
        ("wind=6@10", "wind", 10.0, inf),
        ("wind=6/180@10..", "wind", 10.0, inf),
        ("hang:waypoints@20", "hang", 20.0, inf),
        ("crash:limiter@25", "crash", 25.0, None),
        ("crash:limiter@25..30", "crash", 25.0, 5.0),
        ("slow:pose=0.03@10..20", "slow", 10.0, 10.0),
        ("battery=0.15@40", "battery", 40.0, None),
        ("sensor:fix=lost@30..40", "sensor", 30.0, 10.0),
        ("pilot:POSCTL@30", "pilot", 30.0, None),
        ("restart@35..37", "restart", 35.0, 2.0),
        ("restart@35", "restart", 35.0, 2.0),
        ("stale_setpoints@3.5..4", "topic", 3.5, 0.5),
    ],
)
def test_a_fault_is_read_with_its_times(text: str, kind: str, begin_s: float | None, lasts_s: float | None) -> None:
    fault = read_fault(text)
    assert (fault.kind, fault.begin_s, fault.lasts_s) == (kind, begin_s, lasts_s)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("lonk_loss", "did you mean 'link_loss'?"),
        ("wind", "a number is missing; its form is wind=SPEED[/FROM]"),
        ("wind=99", "99 is not within 0 to 30"),
        ("wind=nan", "'nan' is not a finite number"),
        ("battery=0.1@3..4", "has no end"),
        ("sensor:fix=gone", "'gone' is unknown; known: lost, stuck"),
        ("sensor=lost", "a name is missing after the colon"),
        ("sensor:fix=lost/3", "/3 is not expected"),
        ("topic:pose=late/-1", "negative"),
        ("link_loss:radio", "'radio' is not expected"),
        ("hang:waypoints=4", "=4 is not expected"),
        ("link_loss@5..3", "its end at 3 s is not after its begin at 5 s"),
        ("link_loss@-5", "not a time"),
        ("link_loss@soon", "'soon' is not a time in seconds"),
        ("link_loss@", "'' is not a time in seconds"),
        ("", "cannot be read"),
        ("two words", "cannot be read"),
    ],
)
def test_a_wrong_fault_is_refused_in_words_that_help(text: str, says: str) -> None:
    with pytest.raises(Refused, match="fault") as refusal:
        read_fault(text)
    assert says in str(refusal.value)


@given(st.text(max_size=40))
def test_any_text_is_read_or_refused(text: str) -> None:
    with contextlib.suppress(Refused):
        read_fault(text)


def test_the_help_names_every_kind() -> None:
    assert all(f"  {kind}" in FAULTS_HELP for kind in [*EFFECTS, *SHORT])
