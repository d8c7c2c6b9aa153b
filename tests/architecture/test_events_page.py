"""The page of events and alerts finds them in each of their forms."""

from tests.house.events import EventRow, alerts, events, rows

SOURCE = """
def report(report, alert, component, count, is_bad):
    self._report(Severity.WARNING, f"{component} has {'no' if is_bad else 'a'} pose")
    text = "is heard"
    if count > 1:
        text = f"is heard {count:d} times"
    note(fleet, name, Severity.NOTICE, text, now_s)
    severity = Severity.ERROR if is_bad else Severity.INFO
    report(severity, "ended" + (f": {self.reason}" if is_bad else ""))
    self.publish("event", Event(severity=Severity.ALERT, text=describe(is_bad)))
    yield AlertCause(name, Cause.BATTERY, Severity.CRITICAL, "empty")
    yield AlertCause(name, "name", problem.severity, f"two of {name}")
    report(Severity.WARNING, str(error))
    narrate("is not an event", Severity.WARNING)

def describe(is_bad):
    return "it burns" if is_bad else "it smokes"
"""


def test_events_and_alerts_are_found_in_every_form() -> None:
    assert set(rows("tests.house.events", SOURCE)) == {
        EventRow("warning", "{component} has no pose"),
        EventRow("warning", "{component} has a pose"),
        EventRow("notice", "is heard"),
        EventRow("notice", "is heard {count} times"),
        EventRow("error, info", "ended: {reason}"),
        EventRow("error, info", "ended"),
        EventRow("alert", "it burns"),
        EventRow("alert", "it smokes"),
        EventRow("critical", "empty", "battery"),
        EventRow("its own", "two of {name}", "name"),
    }


def test_every_chapter_has_events_and_the_alerts_are_there() -> None:
    assert all(events().values())
    assert {"autopilot", "battery", "link", "position", "rtk", "versions"} <= {row.name for row in alerts()}
