"""The one broad handler of the project: it runs other people's code for a host."""

import asyncio
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


def guard(job: Callable[..., T], *arguments: Any) -> tuple[T | None, BaseException | None]:
    """Runs an author's code: its result, or what it raised.

    `SystemExit` and the like are an author's errors too: no component may end its host. Only the operator's
    `KeyboardInterrupt` goes through.
    """
    try:
        return job(*arguments), None
    except (Exception, SystemExit, GeneratorExit, asyncio.CancelledError) as error:  # noqa: BLE001
        return None, error
