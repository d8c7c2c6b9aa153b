"""What a process said last, in a line."""

import signal

from gloc3_onboard.hosts.child import describe_exit, last_error, last_lines

DUMP = """\
loading the vocabulary
Fatal Python error: Segmentation fault

Thread 0x00007f5 (most recent call first):
  File "/usr/lib/python3.11/threading.py", line 320 in wait

Current thread 0x00007f6 (most recent call first):
  File "/opt/site-packages/odometer/match.py", line 83 in match
  File "/opt/site-packages/gloc3/cycle_job.py", line 40 in run

Extension modules: numpy._core (total: 1)
""".splitlines()


def test_of_a_crash_the_error_and_the_function_that_had_it_are_told() -> None:
    assert last_lines(DUMP) == "Segmentation fault in match (match.py:83)"
    assert [line.strip().partition(",")[0] for line in last_error(DUMP)] == [
        "Fatal Python error: Segmentation fault",
        'File "/opt/site-packages/odometer/match.py"',
        'File "/opt/site-packages/gloc3/cycle_job.py"',
    ]


def test_a_crash_outside_of_python_has_no_function() -> None:
    lines = ["Fatal Python error: Aborted", "Current thread 0x1 (most recent call first):", "  <no Python frame>"]
    assert last_lines(lines) == "Aborted"


def test_of_everything_else_the_last_line_counts() -> None:
    assert last_lines(["Traceback (most recent call last):", "  ...", "MemoryError", ""]) == "MemoryError"
    assert last_lines([]) == ""
    assert len(last_lines(["x" * 1000])) == 160


def test_how_a_process_ended_is_told_by_the_signal_s_name() -> None:
    assert describe_exit(-signal.SIGBUS) == "by SIGBUS"
    assert describe_exit(-64) in ("by signal 64", "by SIGRTMAX")
    assert describe_exit(2) == "with code 2"
    assert describe_exit(0) == "by itself"
