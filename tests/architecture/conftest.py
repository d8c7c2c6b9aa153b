"""Forgets the syntax trees of all sources once no test here is next.

They are two million objects, which each later collection of garbage would look through for a second.
"""

import pytest
from tests.house.measure import read_modules


def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Another folder's test comes next, or none."""
    if nextitem is None or nextitem.path.parent != item.path.parent:
        read_modules.cache_clear()
