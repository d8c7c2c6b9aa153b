"""What holds for all tests: a search by hypothesis counts as thorough, so that the unit suite stays quick."""

import pytest


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks property tests and state machines."""
    for item in items:
        function = getattr(item, "obj", None)
        if getattr(function, "is_hypothesis_test", False) or item.nodeid.endswith("::runTest"):
            item.add_marker(pytest.mark.thorough)
