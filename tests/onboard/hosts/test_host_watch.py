"""Who is told to be lost, and to be here again."""

from gloc3.component.test_bench import PLATFORM, Bench
from gloc3.exchange import Publisher
from gloc3.messages.hosts import HOST_PRESENCE, HOSTS, HostStatus, ProcessLine
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.topics import TopicTable
from gloc3_onboard.hosts.host_watch import RENEWAL_S, HostWatch

TOPIC = f"{PLATFORM}/{HOSTS}/base"


def reported(bench: Bench) -> list[tuple[str, bool]]:
    text = [e.payload for e in bench.envelopes if e.topic == f"{PLATFORM}/{HOST_PRESENCE}" and e.payload.status is None]
    return [(one.host, one.is_here) for one in text]


def test_a_host_whose_process_began_anew_before_its_silence_was_noticed_was_lost() -> None:
    said: list[str] = []
    with Bench(topics=TopicTable(TOPICS)) as bench:
        watch = HostWatch(bench.context, "vehicle", ["vehicle", "base"], lambda _, text: said.append(text))
        first, second = (Publisher(bench.exchange, PLATFORM, "host_base", boot) for boot in (7, 8))
        status = HostStatus(host="base", is_clock_host=False, processes=[])
        withdraw = bench.exchange.declare_alive(TOPIC)
        for publisher in (first, first, second, second):
            publisher.publish(TOPIC, status, bench.loop.time())
            bench.run(1.0)
        assert said == ["host base is here", "host base is lost", "host base is here"]
        withdraw()
        bench.run(1.0)
        watch.close()
    assert reported(bench) == [("base", True), ("base", False), ("base", True), ("base", False)]


def test_a_host_that_reads_its_network_file_again_is_lost_only_if_it_stays_away() -> None:
    said: list[str] = []
    with Bench(topics=TopicTable(TOPICS)) as bench:
        watch = HostWatch(bench.context, "vehicle", ["vehicle", "base"], lambda _, text: said.append(text))
        publisher = Publisher(bench.exchange, PLATFORM, "host_base", 7)
        renewing = HostStatus(host="base", is_clock_host=False, processes=[], is_renewing=True)

        def is_away_for(seconds: float) -> None:
            withdraw()
            bench.run(seconds)

        withdraw = bench.exchange.declare_alive(TOPIC)
        publisher.publish(TOPIC, renewing, bench.loop.time())
        is_away_for(2.0)
        withdraw = bench.exchange.declare_alive(TOPIC)
        bench.run(RENEWAL_S)
        assert said == ["host base is here"], "of its own accord"
        watch.expect_renewal()
        is_away_for(2.0)
        withdraw = bench.exchange.declare_alive(TOPIC)
        assert said == ["host base is here"], "while this host does"
        bench.run(RENEWAL_S)
        publisher.publish(TOPIC, renewing, bench.loop.time())
        is_away_for(RENEWAL_S - 0.1)
        assert said == ["host base is here"]
        bench.run(0.2)
        assert said == ["host base is here", "host base is lost"]
        withdraw = bench.exchange.declare_alive(TOPIC)
        is_away_for(0.1)
        assert said[2:] == ["host base is here", "host base is lost"], "that is at once where nothing was said"
        watch.close()


def test_every_log_of_another_host_that_has_stopped_is_named_while_the_host_is_here() -> None:
    with Bench(topics=TopicTable(TOPICS)) as bench:
        watch = HostWatch(bench.context, "vehicle", ["vehicle", "base"], lambda *_: None)
        full = "log.mcap: No space left on device"
        lines = [
            ProcessLine("", 1, "up", [], log_problem=full),
            ProcessLine("vision", 2, "up", []),
            ProcessLine("lidar", 3, "up", [], log_problem=full),
        ]
        withdraw = bench.exchange.declare_alive(TOPIC)
        status = HostStatus(host="base", is_clock_host=False, processes=lines)
        Publisher(bench.exchange, PLATFORM, "host_base", 7).publish(TOPIC, status, bench.loop.time())
        bench.run(1.0)
        assert watch.log_problems() == [f"base: {full}", f"base/lidar: {full}"]
        withdraw()
        bench.run(1.0)
        assert watch.log_problems() == []
        watch.close()
