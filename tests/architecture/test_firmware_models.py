"""The list of what the embedded autopilot does as the real firmwares names tests that are there."""

import pytest
from tests.evidence.firmware_models import FOLDER, MODELS, FirmwareModel
from tests.evidence.page import ROOT


@pytest.mark.parametrize("model", MODELS, ids=lambda model: f"{model.family} {model.behaviour[:40]}")
def test_a_behaviour_names_its_tests_or_what_stands_in_its_place(model: FirmwareModel) -> None:
    assert bool(model.tests) != bool(model.instead)
    for test in model.tests:
        file, _, name = test.partition("::")
        assert f"def {name}(" in (ROOT / FOLDER / file).read_text(encoding="utf-8")
