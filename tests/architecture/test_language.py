"""The sentences of the page `language`: they were drawn from what people read, and stand where the page says."""

import re

import pytest
from tests.evidence.language import LEAST, Drawn, Sample, kept, standing
from tests.house import sentences, style

pytestmark = pytest.mark.thorough


def test_the_sentences_that_were_judged_are_there_and_read_plainly() -> None:
    sample = kept()
    assert len({(drawn.where, drawn.before) for drawn in sample.sentences}) >= LEAST
    assert all(drawn.after != drawn.before for drawn in sample.sentences)
    assert [drawn for drawn in sample.sentences if style.riddles_in(drawn.now)] == []
    assert len(standing(sample)) >= 0.75 * LEAST, "many were written again: judge them, and correct sentences.yaml"


def test_a_sentence_that_is_gone_is_missed() -> None:
    gone = Drawn("README.md", "Nobody has ever written this sentence.")
    there = Drawn("README.md", "before", after=sentences.of_pages()[0].text)
    assert standing(Sample(1, "", [gone, there])) == [there]


def test_a_sample_has_sentences_of_every_kind_and_is_the_same_each_time() -> None:
    drawn = sentences.sample(1)
    assert len(drawn) == LEAST
    assert drawn == sentences.sample(1) != sentences.sample(2)
    assert {re.split(r"[./]", one.where)[0] for one in drawn} >= {"docs", "common", "groundstation"}
