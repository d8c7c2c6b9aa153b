"""`make docs`: writes the pages that are made from the code."""

from tests.house import walks, where

where.PAGE.write_text(where.page(), encoding="utf-8")
walks.PAGE.write_text(walks.page(), encoding="utf-8")
