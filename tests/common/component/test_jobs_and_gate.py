"""The jobs that a worker runs, and the gate that they pass: what happens on the thread itself."""

from collections.abc import Callable

import pytest

from gloc3.component.component import FunctionEntry
from gloc3.component.jobs import CycleJob, FunctionJob, Gate, MethodJob
from gloc3.component.outlets import Outlets
from gloc3.errors import Refused
from gloc3.messages.topics import TopicTable

from .specimen import Diary, Driver, Scale, Scaled, SpecimenSettings, row


class Scene:
    """A driver that works on its device, and what runs it."""

    def __init__(self) -> None:
        self.gate = Gate()
        self.diary = Diary()
        self.driver = Driver(self.diary)
        self.diary.calls.clear()

    def method_job(self, *methods: str) -> MethodJob:
        """Runs methods."""
        return MethodJob(self.driver, methods, self.gate, is_device_live=True)

    def cycle_job(self) -> CycleJob:
        """Runs a cycle."""
        return CycleJob(self.driver, Outlets(row(), Driver, "p", TopicTable()), self.gate, None)

    def function_job(self) -> FunctionJob:
        """Runs a function."""
        entry = FunctionEntry("nudge", "nudge", Scale, Scaled, "")
        return FunctionJob(self.driver, entry, Scale(factor=1.0), 0.0, self.gate, is_device_live=True)

    def shut_gate(self) -> None:
        """Somebody has given this up."""
        self.gate.is_shut = True


JOBS: list[tuple[str, Callable[[Scene], MethodJob | CycleJob | FunctionJob]]] = [
    ("stop", lambda scene: scene.method_job("stop", "finish")),
    ("work", Scene.cycle_job),
    ("nudge", Scene.function_job),
]


@pytest.mark.parametrize(("method", "make"), JOBS)
def test_a_job_that_fails_leaves_the_device_safe_and_shuts_the_gate(
    method: str, make: Callable[[Scene], MethodJob | CycleJob | FunctionJob]
) -> None:
    scene = Scene()
    scene.diary.errors[method] = ValueError("odd")
    job = make(scene)
    job.run()
    assert str(job.error) == "odd"
    assert scene.diary.calls == [method, "make_safe"]
    assert scene.gate.is_shut


@pytest.mark.parametrize(("method", "make"), JOBS)
def test_a_job_that_was_given_up_touches_no_device_when_it_comes_back(
    method: str, make: Callable[[Scene], MethodJob | CycleJob | FunctionJob]
) -> None:
    for error in (None, ValueError("odd")):
        scene = Scene()
        scene.diary.acts[method] = scene.shut_gate
        if error is not None:
            scene.diary.errors[method] = error
        make(scene).run()
        assert scene.diary.calls == [method]
        assert scene.diary.writes == []


@pytest.mark.parametrize("make", [make for _, make in JOBS if make is not Scene.cycle_job])
def test_a_job_behind_a_shut_gate_is_skipped(make: Callable[[Scene], MethodJob | FunctionJob]) -> None:
    scene = Scene()
    scene.shut_gate()
    job = make(scene)
    job.run()
    assert job.is_skipped
    assert scene.diary.calls == []


def test_a_start_that_ends_after_it_was_given_up_is_stopped_on_its_own_thread() -> None:
    scene = Scene()
    job = scene.method_job("start")
    left_to_the_host: list[bool] = []
    scene.diary.acts["start"] = lambda: left_to_the_host.append(job.abandon())
    job.run()
    assert scene.diary.calls == ["start", "stop"]
    assert left_to_the_host == [False]


def test_a_start_that_had_ended_when_it_was_given_up_is_left_to_the_host_to_stop() -> None:
    for methods, error, is_started in (
        (["start"], None, True),
        (["initialize"], None, False),
        (["start"], ValueError(), False),
    ):
        scene = Scene()
        if error is not None:
            scene.diary.errors["start"] = error
        job = MethodJob(scene.driver, methods, scene.gate, settings=SpecimenSettings())
        job.run()
        assert job.abandon() is is_started
        assert scene.diary.calls == methods
        assert scene.gate.is_shut


def test_a_refusal_is_one_only_before_anything_has_been_changed() -> None:
    for methods, is_refused in ((("check_leaving",), True), (("stop",), True), (("start", "stop"), False)):
        scene = Scene()
        scene.diary.errors[methods[-1]] = Refused("no")
        job = scene.method_job(*methods)
        job.run()
        assert job.is_refused is is_refused
        assert scene.gate.is_shut is not is_refused


def test_a_function_that_refuses_shuts_nothing() -> None:
    scene = Scene()
    scene.diary.errors["nudge"] = Refused("no")
    scene.function_job().run()
    assert not scene.gate.is_shut
    assert "make_safe" not in scene.diary.calls
