"""A request ends with its reply, or as unknown; it is asked about before it is sent again."""

from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.messages.command_interface import CiReply, CiRequest, Hello, LoadMission, Outcome, Query, ReadMission
from gloc3_groundstation.station.requests import TIMEOUT_S, Requests


def reply(request: CiRequest, outcome: Outcome = Outcome.ACCEPTED, boot: int = 5) -> CiReply:
    return CiReply(sender=request.sender, boot=boot, sequence=request.sequence, outcome=outcome)


def test_a_reply_ends_its_request_and_only_its_own() -> None:
    requests = Requests("255", 5)
    first, second = (requests.request("a", Hello(), 10.0, 0.0) for _ in range(2))
    (_, one), (_, two) = requests.outgoing()
    requests.receive("a", reply(two, boot=4), 0.1)
    requests.receive("b", reply(two), 0.1)
    assert requests.ended() == []
    requests.receive("a", reply(two), 0.1)
    assert [key for key, _ in requests.ended()] == [second]
    requests.receive("a", reply(one), 0.1)
    assert [key for key, _ in requests.ended()] == [first]
    assert requests.next_tick_s() is None


def test_requests_are_counted_for_each_platform() -> None:
    requests = Requests("255", 5)
    for platform in ("a", "a", "b"):
        requests.request(platform, Hello(), 10.0, 0.0)
    assert [(platform, request.sequence) for platform, request in requests.outgoing()] == [("a", 0), ("a", 1), ("b", 0)]


def test_a_late_reply_is_asked_for_and_the_answer_counts_as_the_reply() -> None:
    requests = Requests("255", 5)
    key = requests.request("a", ReadMission(), 10.0, 0.0)
    requests.outgoing()
    assert requests.next_tick_s() == TIMEOUT_S
    requests.tick(TIMEOUT_S)
    ((_, query),) = requests.outgoing()
    assert query.body == Query(boot=5, sequence=0)
    requests.receive("a", reply(query, Outcome.REFUSED), 2.5)
    assert requests.ended() == [(key, CiReply(sender="255", boot=5, sequence=0, outcome=Outcome.REFUSED))]


def test_what_never_arrived_is_sent_again_under_its_id() -> None:
    requests = Requests("255", 5)
    requests.request("a", ReadMission(), 10.0, 0.0)
    ((_, original),) = requests.outgoing()
    requests.tick(2.0)
    ((_, query),) = requests.outgoing()
    requests.receive("a", reply(query, Outcome.UNKNOWN), 2.5)
    assert requests.outgoing() == [("a", original)]


def test_a_request_whose_end_the_platform_itself_does_not_know_is_unknown() -> None:
    requests = Requests("255", 5)
    requests.request("a", ReadMission(), 10.0, 0.0)
    ((_, original),) = requests.outgoing()
    requests.receive("a", reply(original, Outcome.UNKNOWN), 1.0)
    assert [ended.outcome for _, ended in requests.ended()] == [Outcome.UNKNOWN]


def test_without_any_answer_the_outcome_is_unknown_and_says_who_was_silent() -> None:
    requests = Requests("255", 5)
    requests.request("a", ReadMission(), 3.0, 0.0)
    for now_s in (2.0, 3.0):
        requests.tick(now_s)
    ((_, ended),) = requests.ended()
    assert (ended.outcome, ended.reason) == (Outcome.UNKNOWN, "a has not answered for 3 s")
    assert requests.next_tick_s() is None


def test_a_long_mission_is_given_time_before_it_is_asked_about() -> None:
    requests = Requests("255", 5)
    requests.request("a", LoadMission(name="m", text="x" * 20_000), 60.0, 0.0)
    assert requests.next_tick_s() == TIMEOUT_S + 20.0


@settings(max_examples=60)
@given(st.lists(st.tuples(st.floats(0.1, 3.0), st.sampled_from(["lose", *Outcome])), max_size=12))
def test_every_request_ends_exactly_once_in_time_whatever_is_answered(script: list[tuple[float, str]]) -> None:
    requests = Requests("255", 5)
    key = requests.request("a", ReadMission(), 8.0, 0.0)
    now_s, ended = 0.0, []
    for step_s, answer in [*script, (8.0, "lose")]:
        for _, request in requests.outgoing():
            if answer != "lose":
                requests.receive("a", reply(request, Outcome(answer)), now_s)
        ended += requests.ended()
        now_s += step_s
        requests.tick(now_s)
        ended += requests.ended()
    assert [ended_key for ended_key, _ in ended] == [key]
    assert requests.next_tick_s() is None


def test_what_the_link_surely_never_delivered_is_refused_at_once() -> None:
    requests = Requests("255", 5)
    key = requests.request("a", ReadMission(), 10.0, 0.0)
    ((_, original),) = requests.outgoing()
    requests.undelivered("b", original, "that is another platform", 0.1, is_certain=True)
    assert requests.ended() == []
    requests.undelivered("a", original, "versions differ", 0.1, is_certain=True)
    ((ended_key, ended),) = requests.ended()
    assert (ended_key, ended.outcome, ended.reason) == (key, Outcome.REFUSED, "not delivered: versions differ")
    assert requests.next_tick_s() is None


def test_what_may_have_been_delivered_is_asked_about_at_once_and_else_unknown() -> None:
    requests = Requests("255", 5)
    requests.request("a", ReadMission(), 10.0, 0.0)
    ((_, original),) = requests.outgoing()
    requests.undelivered("a", original, "no answer from a", 0.5, is_certain=False)
    assert requests.next_tick_s() == 0.5
    requests.tick(0.5)
    ((_, query),) = requests.outgoing()
    assert query.body == Query(boot=5, sequence=0)
    requests.undelivered("a", query, "nobody heard", 0.6, is_certain=True)  # the question, not what it is about
    requests.undelivered("a", original, "nobody heard", 0.6, is_certain=True)  # too late to be sure again
    assert requests.ended() == []
    requests.tick(10.0)
    ((_, ended),) = requests.ended()
    assert ended.outcome is Outcome.UNKNOWN
    assert ended.reason == "it may have been delivered (nobody heard), and a has not answered for 10 s"


def test_of_a_request_that_was_sent_twice_one_loss_proves_nothing() -> None:
    requests = Requests("255", 5)
    requests.request("a", ReadMission(), 10.0, 0.0)
    ((_, original),) = requests.outgoing()
    requests.tick(2.0)
    ((_, query),) = requests.outgoing()
    requests.receive("a", reply(query, Outcome.UNKNOWN), 2.5)
    assert requests.outgoing() == [("a", original)]
    requests.undelivered("a", original, "nobody heard", 3.0, is_certain=True)
    assert requests.ended() == []
    requests.tick(3.0)
    assert [type(request.body) for _, request in requests.outgoing()] == [Query]
