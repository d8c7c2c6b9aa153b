"""The files that are made from the code by `make docs`."""

from collections.abc import Callable
from pathlib import Path

from tests.house import deaths, notice, performance, public_api, reference, rooms, troubleshooting, walks, where


def files() -> dict[Path, Callable[[], str]]:
    """Every file with what makes its text."""
    return {
        where.PAGE: where.page,
        rooms.PICTURE: rooms.svg,
        walks.PAGE: walks.page,
        public_api.PAGE: public_api.page,
        troubleshooting.PAGE: troubleshooting.page,
        deaths.PAGE: deaths.page,
        performance.PAGE: performance.page,
        notice.FILE: notice.text,
        **reference.pages(),
    }
