"""The partial order as it is drawn: boxes in the order of the tasks, rails for that of the actions, live states."""

from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.messages.summaries import MissionSummary
from gloc3.mission.examples import find_mission
from gloc3_groundstation.missions.draft import Draft, checked, opened
from gloc3_groundstation.missions.outline import Outline, OutlineAction, OutlineTask, received_outline
from gloc3_groundstation.tui.graph.order import layered, reduced
from gloc3_groundstation.tui.graph.rails import NODE, rail_rows
from gloc3_groundstation.tui.views.findings import finding_rows
from gloc3_groundstation.tui.views.mission.detail import detail_lines
from gloc3_groundstation.tui.views.mission.graph import Graph, mission_graph
from gloc3_groundstation.tui.widgets.lines import Tone, text_of


def stage(name: str, *steps: tuple[str, tuple[str, ...]], after: tuple[str, ...] = ()) -> OutlineTask:
    return OutlineTask(
        name=name,
        after=after,
        steps=tuple(OutlineAction(target=f"{name}.{one}", name=one, after=before) for one, before in steps),
    )


FORK = Outline(
    title="fork",
    stages=(
        stage("a", ("up", ()), ("left", ("up",)), ("right", ("up",)), ("home", ("left", "right"))),
        stage("b", ("x", ()), ("y", ()), after=("a",)),
        stage("c", ("x", ()), after=("a",)),
        stage("d", ("x", ()), after=("b",)),
        stage("e", ("x", ()), after=("c", "d", "a")),
    ),
)


def text(graph: Graph) -> str:
    return "\n".join(text_of(line).rstrip() for line in graph.lines)


def test_tasks_are_boxes_by_their_order_and_rails_tell_which_actions_run_abreast() -> None:
    assert text(mission_graph(FORK, None, 110)).splitlines() == [
        " ○ fork",
        "",
        " ╭ ○ a ─────────────────╮   ╭ ○ b ─────────────────╮   ╭ ○ d ─────────────────╮   ╭ ○ e ─────────────────╮",
        " │ ○   up               ├─┬▶│ ○   x                ├──▶│ ○ x                  ├─┬▶│ ○ x                  │",
        " │ ├─╮                  │ │ │   ○ y                │   ╰──────────────────────╯ │ ╰──────────────────────╯",
        " │ ○ │ left             │ │ ╰──────────────────────╯                            │",
        " │ │ ○ right            │ │ ╭ ○ c ─────────────────╮                            │",
        " │ ├─╯                  │ ╰▶│ ○ x                  ├────────────────────────────╯",
        " │ ○   home             │   ╰──────────────────────╯",
        " ╰──────────────────────╯",
    ]


def test_states_progress_and_names_fit_eighty_columns() -> None:
    outline = opened("inspection", None).outline
    assert outline is not None
    states = {"depart": "done", "depart.climb": "done", "sweep": "running", "sweep.wall": "running"}
    reported = MissionSummary(
        name="cargo hold inspection",
        digest="d",
        state="running",
        tasks=dict.fromkeys(outline.targets(), "waiting") | states | {"sweep.photos": "failed"},
        progress={"sweep.wall": 0.42},
        reasons={"sweep.photos": "ground_recorder: the disk is full"},
    )
    graph = mission_graph(received_outline(reported, outline), reported, 80)
    assert text(graph).splitlines()[2:] == [
        " ╭ ✓ depart ───── done ─╮   ╭ ► sweep ─── running ─╮   ╭ · recover ─ waiting ─╮",
        " │ ✓ climb         done ├──▶│ ►   wall        42 % ├──▶│ · home       waiting │",
        " ╰──────────────────────╯   │   ✗ photos    failed │   │ · down       waiting │",
        "                            ╰──────────────────────╯   ╰──────────────────────╯",
    ]
    assert all(len(text_of(line)) <= 80 for line in graph.lines)
    assert any("failed" in span.text and span.tone is Tone.BAD for line in graph.lines for span in line)
    assert [spot.target for spot in graph.spots if spot.layer == 1] == ["sweep", "sweep.wall", "sweep.photos"]
    told_of = "\n".join(text_of(line) for line in detail_lines(outline, reported, "sweep.photos", 78))
    assert "✗ failed   record_images ground every 0.5 m" in told_of
    assert "ground_recorder: the disk is full" in told_of
    assert "until wall" in told_of
    elsewhere = "\n".join(text_of(line) for line in detail_lines(outline, reported, "", 78))
    assert "✗ sweep.photos failed: ground_recorder: the disk is full" in elsewhere


def test_old_states_look_old_and_single_actions_have_a_box_of_their_own() -> None:
    reported = MissionSummary(
        name="", digest="", state="", tasks={"command-1": "running", "command-1.go_to": "running"}, progress={}
    )
    graph = mission_graph(received_outline(reported, None), reported, 80, is_stale=True)
    assert "► command-1" in text(graph)
    assert "go_to" in text(graph)
    assert {span.tone for line in graph.lines for span in line} == {Tone.STALE}


names = st.integers(0, 9).map(lambda number: f"n{number}")
orders = st.dictionaries(names, st.lists(names, max_size=4), max_size=10)


@settings(max_examples=60)
@given(before=orders)
def test_any_order_with_cycles_and_unknown_names_too_is_drawn_with_each_item_once(before: dict[str, list[str]]) -> None:
    order = reduced(before)
    assert set(order) == set(before)
    layers, lines = layered(order)
    place = {name: number for number, layer in enumerate(layers) for name in layer}
    assert all(place[goal] == place[origin] + 1 for origin, goal in lines)
    rows = rail_rows(before) if before else []
    assert sorted(row.name for row in rows if row.name) == sorted(before)
    assert all((NODE in row.rails) == bool(row.name) for row in rows)
    assert len({len(row.rails) for row in rows}) <= 1
    stages = tuple(stage(name, ("x", ()), after=tuple(earlier)) for name, earlier in before.items())
    graph = mission_graph(Outline(title="any", stages=stages), None, 80)
    assert {spot.target for spot in graph.spots} == {"", *before, *(f"{name}.x" for name in before)}
    for spot in graph.spots:
        assert spot.x + spot.width <= max(graph.width, 80)
        assert spot.y < len(graph.lines)


INSPECTION = find_mission("inspection").read_text()


@settings(max_examples=60)
@given(
    place=st.integers(0, len(INSPECTION) - 1),
    removed=st.integers(0, 30),
    put=st.sampled_from(["", "x", "[", "{}", ": ", "\n", "after: [wall]", "\x00", "99999999"]),
)
def test_whatever_is_typed_into_a_mission_is_drawn_or_has_findings(place: int, removed: int, put: str) -> None:
    draft = checked(Draft(name="m", text=INSPECTION[:place] + put + INSPECTION[place + removed :]), None)
    assert draft.outline is not None or draft.errors
    if draft.outline is not None:
        assert mission_graph(draft.outline, None, 80).lines
    assert finding_rows(draft, 78)


def test_a_task_without_a_usable_action_is_an_empty_box() -> None:
    outline = Outline(
        title="m", stages=(OutlineTask(name="fly", steps=()), stage("down", ("land", ()), after=("fly",)))
    )
    assert text(mission_graph(outline, None, 60)).splitlines()[2:] == [
        " ╭ ○ fly ──────────────────╮   ╭ ○ down ─────────────────╮",
        " │                         ├──▶│ ○ land                  │",
        " ╰─────────────────────────╯   ╰─────────────────────────╯",
    ]
