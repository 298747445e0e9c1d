"""What a script passes wrongly to a public name: always an error of sucre_bench, in one line that says what to pass."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typeguard import check_type

import sucre_bench as sb
from sucre_bench.restored_pair import CommonPoints, RestoredView

RGB = np.full((12, 16, 3), 0.5, np.float32)
DEPTH = np.ones((12, 16), np.float32)
K = np.array([[20.0, 0, 8], [0, 20, 6], [0, 0, 1]])
ONE = np.ones(3)
VIEW = sb.View("a.png", sb.Arrays(RGB, DEPTH), sb.Camera(K, 16, 12), np.eye(4))
SCENE = sb.Scene("reef", [VIEW, sb.View("b.png", sb.Arrays(RGB, DEPTH))], frozenset({"depth"}))
RESULT = sb.restore("gray_world", SCENE, 0)
ROWS = sb.score(RESULT, VIEW, "uciqe")
COMPARED = sb.compare_methods(SCENE, ["gray_world"], "uciqe")
SEEN = RestoredView(VIEW, lambda: RGB)
POINTS = CommonPoints(*[np.zeros(1, np.int32)] * 4, np.ones((2, 1)))

# By public name: what to call, and arguments that it takes.
TAKES: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "Arrays": (sb.Arrays, {"rgb": RGB, "depth": DEPTH, "reference": RGB}),
    "Camera": (sb.Camera, {"K": K, "width": 16, "height": 12}),
    "Chart": (sb.Chart, {"name": "near", "kind": "dgk", "corners": K[:2].repeat(2, 0)[:, :2]}),
    "Compared": (
        lambda **given: sb.Compared(rows=ROWS, **given),
        {"scene": SCENE, "labels": ("a",)},
    ),
    "Compared.plot": (
        COMPARED.plot,
        {"view": 0, "height": 40},
    ),
    "Degradation": (
        sb.Degradation,
        {"noise": 0.1, "within": 3, "bits": 8, "add_water": [0.1] * 9},
    ),
    "Restoration": (
        sb.Restoration,
        {"image": RGB, "water": None, "confidence": DEPTH, "info": {}, "filled": RGB},
    ),
    "Restored": (sb.Restored, {"image": RGB, "display": "none", "encoding": "gamma"}),
    "Restored.save": (RESULT.save, {"path": "a.png"}),
    "RestoredPair": (
        sb.RestoredPair,
        {"here": SEEN, "there": SEEN, "points": POINTS, "are_neighbours": True},
    ),
    "Scene": (
        sb.Scene,
        {"name": "reef", "views": [VIEW], "has": frozenset(), "water": None, "data_id": ""},
    ),
    "Scene.__getitem__": (SCENE.__getitem__, {"name": "a.png"}),
    "Score": (
        sb.Score,
        {"value": 1.0, "region": "image", "n_pixels": 1, "coverage": 1.0, "weight": 1.0},
    ),
    "View": (
        sb.View,
        {
            "name": "a.png",
            "pixels": sb.Arrays(RGB),
            "camera": None,
            "cam_from_world": np.eye(4),
            "charts": [],
            "encoding": "gamma",
        },
    ),
    "Water": (
        sb.Water,
        {"veiling_light": ONE, "attenuation": ONE, "backscatter": ONE, "encoding": "linear"},
    ),
    "breaches": (sb.breaches, {"kind": "metric", "name": "uciqe"}),
    "compare_methods": (
        sb.compare_methods,
        {
            "scene": SCENE,
            "methods": ["gray_world"],
            "metrics": "uciqe",
            "views": [0],
            "pixels": "own",
        },
    ),
    "dataset": (
        sb.dataset,
        {"name": "a", "requires": (), "cites": "", "licence": "", "source": "", "has": ()},
    ),
    "degraded": (sb.degraded, {"scene": SCENE, "degradation": None, "target": "a.png"}),
    "load_file": (sb.load_file, {"path": f"{sb.__path__[0]}/methods/gray_world.py"}),
    "load_scene": (
        sb.load_scene,
        {"name": "demo", "scene": "coastal", "width": 64, "height": 48},
    ),
    "load_scenes": (
        lambda **given: list(sb.load_scenes(**given)),
        {"name": "demo", "width": 64, "height": 48},
    ),
    "method": (
        sb.method,
        {"name": "a", "needs": (), "display": "none", "encoding": "gamma", "cites": ""},
    ),
    "metric": (
        sb.metric,
        {
            "variants": {"a": "b"},
            "unit": "",
            "better": "none",
            "range": (0, 1),
            "name": "a",
            "default": ("a",),
        },
    ),
    "restore": (sb.restore, {"method": "gray_world", "scene": SCENE, "view": "a.png"}),
    "score": (
        sb.score,
        {"result": RESULT, "view": VIEW, "metrics": "uciqe", "how": "none", "dataset": ""},
    ),
    "wide": (sb.wide, {"rows": ROWS}),
}
BAD: dict[str, Any] = {
    "None": None,
    "int": -99,
    "big": 10**400,
    "float": 1.5,
    "nan": float("nan"),
    "bool": True,
    "text": "no such thing",
    "no UTF-8": "\udc80",
    "lines": "no such\nthing",
    "long": "x" * 5000,
    "bytes": b"a",
    "list": [object()],
    "letters": ["no such thing"],
    "dict": {"a": object()},
    "object": object(),
    "class": sb.View,
    "0-d": np.array(1.0),
    "2-d": RGB[..., 0][:5],
    "uint8": np.full((12, 16, 3), 200, np.uint8),
    "objects": np.full((12, 16, 3), None),
    "complex": RGB * 1j,
    "texts": np.full((12, 16, 3), "a"),
    "empty": np.zeros((0, 16, 3)),
    "table": pd.DataFrame(),
    "generator": (n for n in ()),
    "function": len,
}
ANY_TEXT = """cites licence source unit what region data_id score.dataset Restored.display Chart.kind Chart.name
    Scene.name View.name dataset.name method.name metric.name"""
OPTIONAL = """water confidence filled camera cam_from_world degradation how within bits add_water Water.encoding
    Arrays.depth Arrays.reference compare_methods.views"""
# Values that an argument takes all the same, by argument or "name.argument".
TAKEN: dict[str, str] = {
    **dict.fromkeys(ANY_TEXT.split(), "text lines long"),
    **dict.fromkeys(OPTIONAL.split(), "None"),
    **dict.fromkeys(["weight", "coverage", "value"], "int float nan"),
    **dict.fromkeys(["dataset.has", "requires", "needs", "default"], "generator empty table"),
    "dataset.requires": "letters generator empty table",
    "metric.default": "letters generator empty table",
    "compare_methods.views": "None generator empty table",
    "n_pixels": "int",
    "info": "dict",
    "are_neighbours": "bool",
}


@dataclass(frozen=True, eq=False)
class Dive(sb.View):
    """A view as somebody's plugin may extend it."""

    diver: str = ""


@pytest.mark.parametrize(
    "sides",
    [(2, 2, 2, 1), (1, 1, -1, 1), (1, 1, 1, 2)],
    ids=["scaled", "mirrored", "projective"],
)
def test_a_pose_turns_and_shifts_and_does_nothing_else(sides: tuple[int, ...]):
    with pytest.raises(sb.InputError, match=r"^View\.cam_from_world: .*rotation.*; pass "):
        sb.View("a.png", sb.Arrays(RGB), cam_from_world=np.diag(sides))


@pytest.mark.parametrize("name", TAKES)
def test_a_wrong_argument_is_one_line_that_says_what_to_pass(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    call, good = TAKES[name]
    call(**good)
    for argument in good:
        taken = TAKEN.get(f"{name}.{argument}", TAKEN.get(argument, "")).split()
        for kind, value in BAD.items():
            if kind in taken:
                continue
            with pytest.raises(sb.SucreBenchError, match=r"\A(?=.{,1000}\Z)[^\n]+; [^\n]+\Z"):
                pytest.fail(
                    f"{argument} took {kind}: {type(call(**{**good, argument: value}))}"
                )


def test_a_restoration_of_another_view_is_not_scored() -> None:
    with pytest.raises(sb.InputError, match=r"a\.png.*b\.png"):
        sb.score(RESULT, SCENE["b.png"], "uciqe")


@pytest.mark.parametrize(
    "matrix",
    [
        K.T,
        K * [[1], [1], [2]],
        K * [[-1], [-1], [1]],
        K / [[16], [12], [1]],
        np.add(K, [[0, 0, 1e6], [0] * 3, [0] * 3]),
    ],
    ids=["transposed", "last row", "negative", "normalised", "far off"],
)
def test_a_matrix_that_is_no_camera_in_pixels_is_refused(matrix: np.ndarray) -> None:
    with pytest.raises(sb.InputError, match=r"Camera\.K: .*pixels"):
        sb.Camera(matrix, 16, 12)


def test_an_image_of_another_size_than_its_camera_is_named_with_both() -> None:
    view = sb.View("a.png", sb.Arrays(RGB, DEPTH), sb.Camera(K, 640, 480), np.eye(4))
    for work in (
        lambda: view.rgb,
        lambda: view.distance,
        lambda: sb.restore("gray_world", one_of(view), view),
    ):
        with pytest.raises(sb.SucreBenchError, match=r"a\.png.* 16x12.*640x480"):
            work()


def one_of(view: sb.View) -> sb.Scene:
    return sb.Scene("one", [view], frozenset({"depth"}))


def test_a_view_of_another_scene_is_not_restored_in_this_one() -> None:
    other = sb.View("a.png", sb.Arrays(RGB, DEPTH))
    with pytest.raises(sb.InputError, match="another scene"):
        sb.restore("gray_world", SCENE, other)


@dataclass
class Level:
    """Pixels as somebody may write them: equal, and without a hash."""

    planes: Any

    def load(self, plane: str) -> Any:
        return self.planes.get(plane)

    def __eq__(self, other: object) -> bool:
        return True

    __hash__ = None  # type: ignore[assignment]


def test_each_source_of_pixels_keeps_its_own_even_if_all_are_equal() -> None:
    mine = RGB * np.float32(0.4)
    first, second = (sb.View("a.png", Level({"rgb": rgb})) for rgb in (mine, RGB))
    assert (first.rgb.mean(), second.rgb.mean()) == pytest.approx((0.2, 0.5))
    mine[0] = 0  # what load returned is still its owner's
    with pytest.raises(ValueError, match="read-only"):
        first.rgb[0] = 0


@pytest.mark.parametrize(
    "planes",
    [
        *(
            {"rgb": wrong}
            for wrong in (
                RGB[..., 0],
                "text",
                np.full((12, 16, 3), 200, np.uint8),
                [[1, 2], [3]],
            )
        ),
        *({"rgb": RGB, "depth": wrong} for wrong in (DEPTH[:5], RGB, "text")),
    ],
    ids=[
        "2-d",
        "text",
        "uint8",
        "ragged",
        "depth of another size",
        "3-d depth",
        "depth as text",
    ],
)
def test_what_load_returns_is_checked_before_a_method_has_it(planes: dict[str, Any]) -> None:
    view = sb.View("a.png", Level(planes))
    with pytest.raises(sb.InputError, match=r"a\.png|load"):
        sb.restore("seathru", one_of(view), view)


def test_a_list_of_numbers_is_an_image() -> None:
    assert sb.View("a.png", Level({"rgb": RGB.tolist()})).rgb.dtype == np.float32


def test_masked_pixels_are_unknown() -> None:
    masked = np.ma.masked_array(DEPTH, mask=np.eye(12, 16, dtype=bool))
    assert (sb.View("a.png", sb.Arrays(RGB, masked)).depth == 1 - np.eye(12, 16)).all()
    image = np.ma.masked_array(RGB, mask=np.repeat(np.eye(12, 16, dtype=bool)[..., None], 3, 2))
    assert sb.Restoration(image).valid.sum() == 12 * 16 - 12


def test_other_code_that_uses_typeguard_keeps_its_own_rules() -> None:
    sb.Score(1.0)
    assert check_type(True, int) is True
    with pytest.raises(sb.InputError):
        sb.Score(True)
