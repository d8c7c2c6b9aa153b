"""Failure policies of missions, tasks and actions, ordered by severity."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final


class Policy(StrEnum):
    """An answer to a failure, or to a condition such as a lost link."""

    CONTINUE = "continue"
    """Continue; failed items stay failed."""
    SKIP = "skip"
    """The failed item counts as skipped; the items after it run."""
    RETRY = "retry"
    """What failed is started again, `retries` times; then the next level's policy applies."""
    HOLD = "hold"
    """Stop and keep position until an operator acts or `hold_s` ends, then land."""
    RETURN = "return"
    """Fly `return_home`, then land."""
    LAND = "land"
    """Land here."""
    ABORT = "abort"
    """Cancel all actions, then the mission's `on_failure`."""


SEVERITY: Final[Mapping[Policy, int]] = {
    Policy.CONTINUE: 0,
    Policy.SKIP: 1,
    Policy.RETRY: 2,
    Policy.HOLD: 3,
    Policy.RETURN: 4,
    Policy.LAND: 5,
}
"""The most severe of several applies. `abort` has no rank of its own: it becomes the mission's `on_failure`."""

MANOEUVRES: Final = (Policy.HOLD, Policy.RETURN, Policy.LAND)
"""The policies that move the vehicle."""


def resolved(policy: Policy, on_failure: Policy) -> Policy:
    """`abort` as the manoeuvre that it leads to: the mission's `on_failure`, or `hold` where that is none."""
    if policy is not Policy.ABORT:
        return policy
    return on_failure if on_failure in MANOEUVRES else Policy.HOLD
