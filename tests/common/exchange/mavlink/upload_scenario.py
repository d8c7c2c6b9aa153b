"""A mission is uploaded and read back over a lossy 57,600 baud link in virtual time, beside status of 20 components."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from math import inf
from random import Random

import msgspec
from tests.common.exchange.mavlink.ends import RADIO_CONDITIONS, pair_on, text_of

from gloc3.clock import run_virtual
from gloc3.exchange.tunnel.pacing import RADIO, LinkBudget
from gloc3.mavlink.transport.memory import Conditions
from gloc3.messages.command_interface import LoadMission, ReadMission
from gloc3.messages.summaries import Summary

BEGIN_S = 5.0
"""When the upload begins."""


class Figures(msgspec.Struct, frozen=True, kw_only=True):
    """What one run showed; times in seconds."""

    upload_s: float
    """From the request at the station to its hand-over at the platform; infinite if it never came."""
    replied_s: float
    """Until the platform's reply was back at the station."""
    read_back_s: float
    """From the request to read back until the text is at the station."""
    is_equal: bool
    handed_over: dict[int, int]
    """Request's sequence: how often it was handed over."""
    acknowledged: list[int]
    """Sequences of the requests that were acknowledged."""
    slowest_status_hz: float
    """Mean rate at which the least lucky component's row arrived over the first 60 s."""
    longest_gap_s: float
    """Longest time without a row of some component over the first 60 s."""
    status_share: float
    """Status, greetings and tables, of what the line carries, over the first 60 s."""
    status_share_in_upload: float
    """The same while the mission went up and was read back."""


def scenario(
    seed: int,
    *,
    size: int = 20_000,
    is_random: bool = True,
    components: int = 20,
    duration_s: float = 60.0,
    conditions: Conditions = RADIO_CONDITIONS,
    is_half_duplex: bool = False,
    budget: LinkBudget = RADIO,
) -> Figures:
    """Uploads a mission of `size` bytes 5 s after the start, reads it back, and watches status for `duration_s`."""
    return run_virtual(_run(seed, size, is_random, components, duration_s, conditions, is_half_duplex, budget))


async def _run(
    seed: int,
    size: int,
    is_random: bool,
    components: int,
    duration_s: float,
    conditions: Conditions,
    is_half_duplex: bool,
    budget: LinkBudget,
) -> Figures:
    loop = asyncio.get_running_loop()
    station, platform, _ = pair_on(seed, conditions, is_half_duplex=is_half_duplex, budget=budget)
    platform.report(components)

    async def reply_to(sequence: int) -> float:
        limit_s = loop.time() + 2.0 * duration_s
        while sequence not in station.replies and loop.time() < limit_s:
            await asyncio.sleep(0.05)
        return station.replies[sequence][0] if sequence in station.replies else inf

    await asyncio.sleep(BEGIN_S)
    text = text_of(size, Random(seed), is_random=is_random)
    status_before = platform.counters.status_bytes
    station.request(LoadMission(name="survey", text=text))
    replied_s = await reply_to(0)
    read_s = loop.time()
    station.request(ReadMission())
    read_back_s = await reply_to(1)
    busy_s, busy_bytes = loop.time() - BEGIN_S, platform.counters.status_bytes - status_before
    await asyncio.sleep(max(0.0, duration_s - loop.time()))
    measured_s = loop.time()
    station.close()
    platform.close()

    rows: dict[int, list[float]] = {n: [0.0] for n in range(components)}
    for t_s, envelope in station.came:
        if isinstance(envelope.payload, Summary):
            for line in envelope.payload.lines:
                rows[line.index].append(t_s)
    given_s = {request.sequence: t_s for t_s, request in reversed(platform.given)}
    sequences = platform.sequences()
    line_bytes_s = (conditions.bandwidth_bit_s or inf) / conditions.bits_per_byte
    return Figures(
        upload_s=given_s.get(0, inf) - BEGIN_S,
        replied_s=replied_s - BEGIN_S,
        read_back_s=read_back_s - read_s,
        is_equal=1 in station.replies and station.replies[1][1].text == text,
        handed_over={sequence: sequences.count(sequence) for sequence in sorted(set(sequences))},
        acknowledged=station.acknowledged(),
        slowest_status_hz=min(len(times) - 1 for times in rows.values()) / measured_s,
        longest_gap_s=max(
            later - earlier for times in rows.values() for earlier, later in pairwise([*times, measured_s])
        ),
        status_share=platform.counters.status_bytes / (line_bytes_s * measured_s),
        status_share_in_upload=busy_bytes / (line_bytes_s * busy_s),
    )
