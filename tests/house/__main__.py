"""`make docs`: writes the files that are made from the code, and the titles of the pages of evidence."""

from tests.evidence.__main__ import BARS
from tests.evidence.page import retitle
from tests.house.made import files

for file, text in files().items():
    file.write_text(text(), encoding="utf-8")
retitle(BARS)
