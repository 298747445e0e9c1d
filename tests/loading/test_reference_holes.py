"""A black block of a reference, where the photograph has light, is said when the reference is read."""

from pathlib import Path

import numpy as np
import pytest
from support.colmap_folder import write_image
from support.messages import Lines

from sucre_bench import load_scene
from sucre_bench.machine import progress


@pytest.mark.parametrize(("rows", "is_said"), [(0, False), (8, True)])
def test_holes_of_a_reference_are_said(tmp_path: Path, rows: int, is_said: bool) -> None:
    picture = np.random.default_rng(0).integers(40, 200, (30, 40, 3)).astype(np.uint8)
    write_image(tmp_path / "a.png", picture)
    picture[:rows] = 0
    write_image(tmp_path / "reference" / "a.png", picture)
    said = Lines()
    view = load_scene("photos", root=str(tmp_path))["a.png"]
    with progress.watched_by(said):
        assert view.reference is not None
    assert [("a.png" in line, "27 %" in line) for line in said.lines] == [
        (True, True)
    ] * is_said
