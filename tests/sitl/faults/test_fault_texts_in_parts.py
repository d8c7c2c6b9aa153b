"""A fault's text as its parts: read, written, shifted."""

from math import inf

import pytest

from gloc3_sitl.faults.fault_text import FaultText, parse


@pytest.mark.parametrize("text", ["crash:limiter@25", "link_loss@30..60", "wind=6/180@10..", "battery=0.15@40.5"])
def test_a_text_is_read_and_written_again(text: str) -> None:
    assert str(parse(text)) == text


def test_a_fault_is_shifted_with_its_end_and_not_before_the_flight() -> None:
    assert str(parse("link_loss@30..60").shifted(10.0)) == "link_loss@10..40"
    assert str(parse("link_loss@30..").shifted(-4.0)) == "link_loss@0.1.."
    assert parse("sensor:fix=lost@3").target == "sensor:fix"
    assert parse("hang:pose@3..") == FaultText("hang:pose", 3.0, inf)
