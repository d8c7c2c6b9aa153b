"""`make docs`: writes the pages that are made from the code, and the titles of those of evidence."""

from tests.evidence.__main__ import BARS
from tests.evidence.page import retitle
from tests.house import deaths, notice, performance, public_api, reference, rooms, troubleshooting, walks, where

where.PAGE.write_text(where.page(), encoding="utf-8")
rooms.PICTURE.write_text(rooms.svg(), encoding="utf-8")
walks.PAGE.write_text(walks.page(), encoding="utf-8")
reference.write()
public_api.PAGE.write_text(public_api.page(), encoding="utf-8")
troubleshooting.PAGE.write_text(troubleshooting.page(), encoding="utf-8")
deaths.PAGE.write_text(deaths.page(), encoding="utf-8")
performance.PAGE.write_text(performance.page(), encoding="utf-8")
notice.FILE.write_text(notice.text(), encoding="utf-8")
retitle(BARS)
