"""`anyskill motions list | show | import` as a user types them."""

import json

import numpy as np
import pytest
from bvh_writer import write_bvh
from mocap_writers import write_acclaim, write_amass

from agents.cli import main
from motion_data.authored import authored_clips
from motion_data.clip import MotionClip
from motion_data.contact_sheet import contact_sheet

CLIPS = {clip.name: clip for clip in authored_clips()}


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("ANYSKILL_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_list_prints_a_table_and_json(capsys):
    assert main(["motions", "list", "--category", "dance"]) == 0
    table = capsys.readouterr().out
    assert "dance_sway" in table and "squat" not in table
    assert main(["motions", "list", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert len(rows) >= 44 and {"name", "seconds", "weight", "categories", "labels"} <= rows[0].keys()
    assert main(["motions", "list", "--category", "cooking"]) == 2
    assert "The categories are: " in capsys.readouterr().err


def test_import_puts_a_bvh_file_into_the_library(tmp_path, capsys, own_cache):
    path = write_bvh(tmp_path / "Big Kick.bvh", CLIPS["kick_left"])
    words = ["motions", "import", str(path), "--label", "kick high", "kick", "--category", "attack"]
    assert main(words) == 0
    clip = MotionClip.load(own_cache / "motions" / "big_kick.npz")
    assert clip.labels == ("kick high", "kick") and clip.categories == ("attack",)
    assert main(["motions", "list", "--category", "attack"]) == 0
    assert "big_kick" in capsys.readouterr().out
    assert main(words) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main([*words, "--overwrite"]) == 0
    assert main([*words, "--name", "squat"]) == 2
    assert "--name" in capsys.readouterr().err


def test_import_picks_the_reader_by_the_file(tmp_path, capsys, own_cache):
    short = MotionClip("short", CLIPS["bow"].qpos[:8])
    write_acclaim(tmp_path, short)
    write_amass(tmp_path / "B_poses.npz", short)
    assert main(["motions", "import", str(tmp_path / "02_01.amc"), "--fps", "30", "--name", "from_amc"]) == 0
    assert main(["motions", "import", str(tmp_path / "B_poses.npz"), "--label", "bow a little"]) == 0
    capsys.readouterr()
    assert main(["motions", "list", "--category", "imported", "--json"]) == 0
    assert {row["name"] for row in json.loads(capsys.readouterr().out)} == {"from_amc", "b"}
    assert main(["motions", "import", str(tmp_path / "B_poses.npz"), "--fps", "30"]) == 2
    assert "fps means nothing" in capsys.readouterr().err


def test_import_refuses_what_it_cannot_read(tmp_path, capsys):
    (tmp_path / "a.bvh").write_text("HIERARCHY")
    (tmp_path / "a.fbx").write_text("x")
    (tmp_path / "a.json").write_text('{"Frames": []}')
    for name, message in (
        ("a.bvh", "not a whole BVH file"),
        ("a.fbx", "known kinds are"),
        ("a.json", "frames of shape"),
        ("none.bvh", "No BVH file"),
    ):
        assert main(["motions", "import", str(tmp_path / name)]) == 2
        assert message in capsys.readouterr().err


def test_show_writes_a_contact_sheet(tmp_path, capsys):
    image = pytest.importorskip("PIL.Image")
    path = tmp_path / "sheet.png"
    assert main(["motions", "show", "squat", "--output", str(path), "--frames", "4"]) == 0
    assert str(path) in capsys.readouterr().out
    pixels = np.asarray(image.open(path))
    assert pixels.shape == (480, 4 * 204 - 4, 3) and pixels.std() > 10
    assert main(["motions", "show", "nothing"]) == 2
    assert "Unknown clip 'nothing'" in capsys.readouterr().err


def test_a_contact_sheet_has_as_many_rows_as_needed(tmp_path):
    image = pytest.importorskip("PIL.Image")
    view = lambda qpos: np.full((20, 10, 3), 100, np.uint8)  # noqa: E731
    path = contact_sheet(CLIPS["squat"], tmp_path / "sheet.png", [view, view], frames=7, per_row=3)
    assert image.open(path).size == (3 * 14 - 4, 3 * 44 - 4)
    with pytest.raises(ValueError, match="frames >= 1"):
        contact_sheet(CLIPS["squat"], path, [view], frames=0)
