"""Each way a dataset breaks the contract of plugins is found and named."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.tried_plugins import DATASET, broken

pytestmark = pytest.mark.usefixtures("own_environment")

DECLARED = "{'depth', 'poses'}"


def test_a_dataset_that_keeps_the_contract_is_found_to_keep_it(tmp_path: Path) -> None:
    assert broken(tmp_path, "dataset", DATASET, "", has=DECLARED) == ""


@pytest.mark.parametrize(
    ("has", "body", "said"),
    [
        (DECLARED, "rgb = rgb * 255", r"rgb goes from .* to 25\d; divide by full scale"),
        (DECLARED, "rgb[0] = np.nan", "rgb has values that are not finite"),
        (DECLARED, "depth[0] = -1", "depth is NaN or negative"),
        (DECLARED, "depth[0] = np.nan", "depth is NaN or negative"),
        (DECLARED, "depth = depth[1:]", r"depth is \(5, 8\) float32; give \(6, 8\)"),
        (DECLARED, "pose[0, 0] = 2", "no rigid transform"),
        (DECLARED, "pose = pose[:3]", "no rigid transform"),
        (DECLARED, "K[0, 0] = -8", "the focal lengths are -8 and 8"),
        (DECLARED, "K[0, 2] = .5 - 4", r"the principal point \(-3.5, 3\) is not in the image"),
        (DECLARED, "K = K.T", "K is .*; give"),
        (DECLARED, "name = '/a.png'", "a view is called '/a.png'"),
        (DECLARED, "data_id = ''", "no data_id"),
        (DECLARED, "data_id = str(id(rgb)) + str(os.urandom(3))", "data_id is another when opened again"),
        (
            DECLARED,
            "rgb = np.random.rand(6, 8, 3).astype('f4')",
            "another image when opened again|changes numpy's random",
        ),
        (DECLARED, "depth = None", "`has` says depth, no view has any"),
        ("{'poses'}", "", "one has depth; add to has= of @dataset"),
        (
            DECLARED,
            "os.chdir('.') or os.environ.update(TRIED_OPENED=os.urandom(3).hex())",
            r"changes os\.environ\[TRIED_OPENED\]",
        ),
    ],
)
def test_each_way_a_dataset_breaks_the_contract_is_named(tmp_path: Path, has: str, body: str, said: str) -> None:
    assert re.search(said, broken(tmp_path, "dataset", DATASET, body, has=has))


def test_a_dataset_must_name_the_folder_that_is_missing(tmp_path: Path) -> None:
    rough = DATASET.replace(
        'raise InputError(f"{{self.root}}: holds no scene; give another")', "raise OSError('no data')"
    )
    found = broken(tmp_path, "dataset", rough, "", has=DECLARED)
    assert re.search("^.*root, .*'tried': OSError: no data;", found, flags=re.MULTILINE)
    assert len(re.findall("root, .*OSError", found)) == 2
