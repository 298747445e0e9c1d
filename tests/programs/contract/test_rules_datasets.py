"""Each way a dataset breaks the contract of plugins is found and named."""

from pathlib import Path

import pytest
from support.messages import names
from support.tried_plugins import DATASET, broken

pytestmark = pytest.mark.usefixtures("own_environment")

DECLARED = "{'depth', 'poses'}"


def test_a_dataset_that_keeps_the_contract_is_found_to_keep_it(tmp_path: Path) -> None:
    assert broken(tmp_path, "dataset", DATASET, "", has=DECLARED) == {}


@pytest.mark.parametrize(
    ("has", "body", "rule", "named"),
    [
        (DECLARED, "rgb = rgb * 255", "planes_are_sound", {"Arrays.rgb", "255"}),
        (DECLARED, "rgb = rgb * 2", "planes_are_sound", {"rgb", "[0, 1]"}),
        (DECLARED, "rgb[0] = np.nan", "planes_are_sound", {"rgb", "finite"}),
        (DECLARED, "depth[0] = -1", "planes_are_sound", {"depth", "negative"}),
        (DECLARED, "depth[0] = np.nan", "planes_are_sound", {"depth", "NaN"}),
        (DECLARED, "depth = depth[1:]", "planes_are_sound", {"Arrays.depth", "(5, 8)", "(6, 8)"}),
        (DECLARED, "pose[0, 0] = 2", "geometry_is_sound", {"cam_from_world", "rigid"}),
        (DECLARED, "pose = pose[:3]", "geometry_is_sound", {"View.cam_from_world", "(4, 4)"}),
        (DECLARED, "K[0, 0] = -8", "geometry_is_sound", {"focal", "-8", "8", "pixels"}),
        (DECLARED, "K[0, 2] = .5 - 4", "geometry_is_sound", {"principal", "(-3.5, 3)", "8x6"}),
        (DECLARED, "K = K.T", "geometry_is_sound", {"K", "fx", "cx"}),
        (DECLARED, "name = '/a.png'", "names_once", {"'/a.png'", "dive/a.png"}),
        (DECLARED, "data_id = ''", "is_repeatable", {"one", "data_id"}),
        (DECLARED, "data_id = str(id(rgb)) + str(os.urandom(3))", "is_repeatable", {"one", "data_id", "another"}),
        (DECLARED, "rgb = np.random.rand(6, 8, 3).astype('f4')", "is_repeatable", {"a.png", "seed"}),
        (DECLARED, "depth = None", "has_what_it_says", {"depth", "has"}),
        ("{'poses'}", "", "has_what_it_says", {"depth", "has=", "@dataset"}),
        (
            DECLARED,
            "os.chdir('.') or os.environ.update(TRIED_OPENED=os.urandom(3).hex())",
            "is_repeatable",
            {"os.environ[TRIED_OPENED]"},
        ),
    ],
)
def test_each_way_a_dataset_breaks_the_contract_is_named(
    tmp_path: Path, has: str, body: str, rule: str, named: set[str]
) -> None:
    assert named <= names(broken(tmp_path, "dataset", DATASET, body, has=has)[rule])


def test_a_dataset_must_name_the_folder_that_is_missing(tmp_path: Path) -> None:
    rough = DATASET.replace(
        'raise InputError(f"{{self.root}}: holds no scene; give another")', "raise OSError('no data')"
    )
    found = broken(tmp_path, "dataset", rough, "", has=DECLARED)
    assert list(found) == ["names_what_is_missing"]
    for line in found["names_what_is_missing"].splitlines():  # of a folder that is not there, of an empty one
        assert {"root", "'tried'", "OSError", "InputError"} <= names(line)
