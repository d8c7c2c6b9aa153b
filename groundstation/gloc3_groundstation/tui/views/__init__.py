"""What the screens show, as pure functions of a view: nothing here knows Textual, so that tests read it as text."""
