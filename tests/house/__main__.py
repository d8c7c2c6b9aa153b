"""`make docs`: writes the pages that are made from the code."""

from tests.house import where

where.PAGE.write_text(where.page(), encoding="utf-8")
