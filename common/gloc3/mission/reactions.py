"""What is done when something befalls the vehicle: the policy of the mission, or a task that it has ready."""

from gloc3.messages import Severity
from gloc3.mission import contingencies, manoeuvres
from gloc3.mission.board import Board, Condition
from gloc3.mission.model import Contingency, answer
from gloc3.mission.policy import MANOEUVRES, SEVERITY, Policy, resolved


def set_condition(board: Board, condition: Condition, is_on: bool, reason: str, now_s: float) -> None:
    """Notes whether a condition holds; its policy is carried out once, when it arises."""
    if is_on == (condition in board.conditions):
        return
    if is_on:
        board.conditions[condition] = reason
        meet(board, condition, reason, now_s)
    else:
        del board.conditions[condition]
        board.unanswered.pop(condition, None)
        board.tell(Severity.INFO, f"{condition}: over")


def meet(board: Board, condition: Condition, reason: str, now_s: float) -> None:
    """Answers a condition that has just arisen with the governing policies."""
    if board.has_pilot:
        board.unanswered[condition] = reason
        board.tell(Severity.WARNING, f"{condition}: {reason}; the pilot has control")
        return
    wanted = _wanted(board, condition)
    if isinstance(wanted, Contingency) and contingencies.begin(board, wanted, str(condition), now_s):
        return
    policy = resolved(answer(wanted), board.policies.on_failure)
    board.tell(Severity.WARNING, f"{condition}{': ' + reason if reason else ''}; policy: {policy}")
    if policy in MANOEUVRES:
        manoeuvres.apply(board, policy, str(condition), now_s)


def lose_component(board: Board, component: str, policy: Policy, reason: str, now_s: float) -> None:
    """A component's function is lost for good, and its row says what is to be done; the mission may say more."""
    cause, wanted = f"{component} is lost ({reason})", board.policies.on_component_fault
    if isinstance(wanted, Contingency) and resolved(policy, board.policies.on_failure) is not Policy.LAND:
        board.tell(Severity.ERROR, f"{cause}; contingency: {wanted.task}")
        if contingencies.begin(board, wanted, cause, now_s):
            return
    on_failure = board.policies.on_failure
    both = resolved(policy, on_failure), resolved(answer(wanted), on_failure)
    worst = max(both, key=lambda one: SEVERITY[one])
    board.tell(Severity.ERROR, f"{cause}; policy: {worst}")
    manoeuvres.apply(board, worst, cause, now_s)


def _wanted(board: Board, condition: Condition) -> str | Contingency:
    policies = board.policies
    match condition:
        case Condition.LINK_LOST:
            return policies.on_link_loss
        case Condition.OVERDUE:
            return policies.on_overdue or policies.on_link_loss
        case Condition.LOW_BATTERY:
            return policies.on_low_battery
        case Condition.POSE_LOST:
            return policies.on_pose_lost
        case Condition.OBSTACLE:
            return policies.on_obstacle
        case Condition.PLATFORM_LOST:
            return policies.on_platform_loss
        case Condition.FENCE_BREACHED:
            return Policy.ABORT
