"""What lies in tests/data is what the project made there."""

import numpy as np
from tests.data.make import files
from tests.data_folders import OWN


def test_the_files_are_those_that_are_made() -> None:
    for name, text in files().items():
        kept = (OWN / name).read_text(encoding="utf-8")
        if not name.startswith("laser/"):
            assert kept == text, name
            continue
        for line, made in zip(kept.splitlines()[1:], text.splitlines()[1:], strict=True):
            (kind, *words), (made_kind, *made_words) = line.split(), made.split()
            assert kind == made_kind
            numbers, made_numbers = (np.array([*one[:-2], one[-1]], float) for one in (words, made_words))
            np.testing.assert_allclose(numbers, made_numbers, atol=0.011)  # as other machines round sines


def test_it_is_small() -> None:
    assert sum(path.stat().st_size for path in OWN.rglob("*") if path.is_file()) < 1_000_000
