"""Whatever goes wrong around the station: it says what is the matter, and what to do."""

import pytest
from tests.groundstation.troubles import TROUBLES, TunnelTrouble, one_line

pytestmark = [pytest.mark.sockets, pytest.mark.thorough]


@pytest.mark.parametrize("trouble", TROUBLES, ids=lambda problem: problem.what)
async def test_it_is_told_what_is_the_matter_and_what_to_do(trouble: TunnelTrouble) -> None:
    shown = one_line(await trouble.show())
    assert trouble.matter in shown
    assert trouble.advice in shown
