"""What the dialogue that opens missions lists."""

from pathlib import Path

from gloc3_groundstation.missions.files import FileGroup, listing, matching, start_entries


def test_a_folder_lists_folders_then_missions_and_nothing_else(tmp_path: Path) -> None:
    texts = {
        "b.yaml": f"# {'x' * 2984}\nmission: b",
        "c.yml": "{'mission': c, tasks: {}}",
        "wrong.yaml": "misson: a word is wrong\ntasks:\n",
        "A.plan": "x" * 3000,
        "wp.waypoints": "x",
        "old.txt": "\ufeffQGC WPL 110\n",
        ".hidden.yaml": "mission: b",
        "notes.md": "mission: b",
        "requirements.txt": "textual==1.0\nmission: none",
        "hold.yaml": "world: hold\nfor:\n  mission: b\n",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "sub").mkdir()
    found = listing(tmp_path)
    assert [entry.name for entry in found.entries] == [
        *("..", "sub", "A.plan", "b.yaml", "c.yml", "old.txt", "wp.waypoints", "wrong.yaml")
    ]
    assert [entry.kind for entry in found.entries][1:3] == ["folder", "QGroundControl plan"]
    assert found.entries[2].size == 3000
    assert [entry.name for entry in matching(found.entries, "B")] == ["b.yaml", "sub"]
    lost = listing(tmp_path / "none")
    assert lost.problem
    assert [entry.name for entry in lost.entries] == [".."]
    assert ".." not in [entry.name for entry in listing(Path("/")).entries]


def test_what_was_opened_lately_and_is_still_there_comes_first(tmp_path: Path) -> None:
    (tmp_path / "here.yaml").write_text("")
    entries = start_entries((str(tmp_path / "here.yaml"), str(tmp_path / "gone.yaml"), "hop"))
    assert [entry.name for entry in entries] == [
        "here.yaml",
        "hop",
        "inspection",
        "mapping",
        "patrol",
        "powerline",
        "survey",
    ]
    assert entries[0].group is FileGroup.RECENT
    assert [entry.name for entry in matching(entries, "pat")] == ["patrol"]
