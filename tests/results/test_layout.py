"""Files of views and labels have names that Linux, macOS and Windows can hold side by side."""

import re
import sys
import unicodedata
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from sucre_bench.results import layout

pytestmark = pytest.mark.short

_NAMES = (
    *(
        "a.png",
        "a.jpg",
        "A.PNG",
        "a.png.jpg",
        "Strasse.png",
        "STRASSE.png",
        "Straße.png",
        "aux",
        "com1.tiff",
    ),
    *(
        "café.png",
        unicodedata.normalize("NFD", "café.png"),
        "a:b.png",
        "a|b.png",
        "b .png",
        "b.png",
        "b..png",
    ),
    *(
        "CON.png",
        "nul.tar.png",
        "x\ny.png",
        "x_y.png",
        "x" * 251 + ".png",
        "x" * 251 + ".jpg",
        "深" * 85,
    ),
    *("D/a.png", "d/a.png", "_MG 7 (2).JPG"),
)


@pytest.mark.parametrize("scenes", [["one"], ["one", "One"]])
def test_no_two_views_share_a_file_on_any_system_and_each_is_found_again(
    tmp_path: Path, scenes: list[str]
) -> None:
    views = [SimpleNamespace(name=name) for name in _NAMES]
    made: list[Any] = [SimpleNamespace(name=name, views=views) for name in scenes]
    places = layout.places("dive", made)
    paths = {names: place.restored(Path(), "m").as_posix() for names, place in places.items()}
    assert len(
        {unicodedata.normalize("NFKC", path.upper().casefold()) for path in paths.values()}
    ) == len(paths)
    for part in (part for path in paths.values() for part in path.split("/")):
        assert len(part.encode()) <= 200
        assert not re.search(r'[\x00-\x1f<>:"\\|?*]', part)
        assert not part.endswith((".", " "))
    can_be_written = {
        names: place
        for names, place in places.items()
        if sys.getfilesystemencoding() == "utf-8" or paths[names].isascii()
    }
    for place in can_be_written.values():
        place.restored(tmp_path, "m").parent.mkdir(parents=True, exist_ok=True)
        place.restored(tmp_path, "m").touch()
    for names, place in can_be_written.items():
        assert layout.find("dive", *names, tmp_path) == place


def test_usual_names_stay_as_they_are() -> None:
    views = [
        SimpleNamespace(name=name) for name in ("GH010012.JPG", "_MG 7 (2).JPG", "left/Ü.png")
    ]
    made: Any = [SimpleNamespace(name="dive", views=views)]
    stems = [place.stem.as_posix() for place in layout.places("dive", made).values()]
    assert stems == ["GH010012", "_MG 7 (2)", "left/Ü"]
