"""The rendered sequences of the fusion's benchmark: their truth, their hardships, and one short comparison."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.fusion import _folders, _Real, compare, vtest_boxes
from benchmarks.fusion_scene import HARDSHIPS, HEIGHT, WIDTH, Sequence, sequences
from common.config import ConfigError


def test_set_has_each_hardship_alone_and_mixed_and_follows_the_seed() -> None:
    made = sequences(3, 40)
    assert len(made) >= 12
    assert [s.hardships for s in made[: len(HARDSHIPS)]] == [(h,) for h in HARDSHIPS]
    assert len({s.name for s in made}) == len(made)
    one, again = (next(iter(s[2].pictures()))[0] for s in (made, sequences(3, 40)))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, next(iter(sequences(4, 40)[2].pictures()))[0])


def test_truth_is_where_the_picture_changes_with_the_target() -> None:
    sequence = Sequence("rotation", ("rotation",), (5, 1), 20)
    boxes = [box for _, box in sequence.pictures()]
    assert all(box is not None for box in boxes)
    stage_boxes = np.array(boxes)
    assert (np.abs(np.diff(stage_boxes[:, :2], axis=0)) < 40).all(), "it moves, and does not jump"
    assert stage_boxes[:, 2:].min() > 15
    assert (stage_boxes[:, 0] > -30).all()
    assert (stage_boxes[:, 0] + stage_boxes[:, 2] < WIDTH + 30).all()
    picture, box = next(iter(sequence.pictures()))
    assert picture.shape == (HEIGHT, WIDTH, 3)
    assert box is not None


def test_target_is_absent_while_something_hides_it() -> None:
    absent = sum(box is None for _, box in Sequence("occlusion", ("occlusion",), (1, 2), 60).pictures())
    assert 2 <= absent <= 40


def test_members_and_fusion_are_compared_over_the_same_pictures() -> None:
    compared = compare(Sequence("rotation", ("rotation",), (2, 3), 8), 1)
    assert list(compared) == ["dsst", "cmt", "struck", "tld", "hab-df"]
    for one in compared.values():
        np.testing.assert_array_equal(one.frames, np.arange(1, 8))
        assert one.overlap[0] > 0.8


def test_folder_of_real_sequences_is_read(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no folder with a gt"):
        _folders(tmp_path)
    folder = tmp_path / "01_box"
    folder.mkdir()
    (folder / "gt.txt").write_text("10,20,60,80\nNaN,NaN,NaN,NaN\n12,20,62,80\n")
    (folder / "init.txt").write_text("10,20,60,80")
    video = cv2.VideoWriter(str(folder / "box.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 20.0, (160, 120))
    for _ in range(3):
        video.write(np.full((120, 160, 3), 90, np.uint8))
    video.release()
    real = _folders(tmp_path)[0]
    pictures, truth, first = real.load()
    assert len(list(pictures)) == 3
    assert (first, truth[1], truth[2]) == ((10, 20, 50, 60), None, (12, 20, 50, 60))


def test_person_of_the_sample_video_is_a_real_sequence() -> None:
    boxes = vtest_boxes()
    pictures, truth, first = _Real("vtest", None, 20).load()
    assert sum(1 for _ in pictures) == 21
    assert first == boxes[min(boxes)] == truth[0]
    assert set(truth) == {0, 10, 20}
