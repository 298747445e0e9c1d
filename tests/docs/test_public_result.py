"""The public result in docs/board: bundles are whole, the board names them, README prints the numbers of the demo."""

import json
import re

import pytest
from support.places import ROOT

BUNDLES = sorted((ROOT / "docs" / "board" / "bundles").glob("*.zip"))
COLUMNS = [("colours", "raw"), ("colours_de00", "gain"), ("psnr", "masked"), ("psi", "colour")]  # of README's table


@pytest.mark.parametrize("bundle", BUNDLES, ids=lambda path: path.stem)
def test_a_bundle_is_whole_small_and_on_the_board(bench, bundle):
    told = json.loads(bench("verify", str(bundle), "--json").stdout)
    assert told["faults"] == []
    assert told["differing"] == []
    assert bundle.stat().st_size < 300_000
    assert told["id"] in (ROOT / "docs" / "board" / "index.html").read_text(encoding="utf-8")


def test_the_readmes_table_has_the_numbers_of_the_demos_bundle(bench):
    records = json.loads(bench("compare", str(ROOT / "docs/board/bundles/demo.zip"), "--json").stdout)
    public = {(r["method"], r["metric"], r["variant"]): (r["mean"], r["low"], r["high"]) for r in records}
    text = (ROOT / "README.md").read_text(encoding="utf-8").split("| method | colours")[1]
    rows = [line.split("|")[1:-1] for line in text.splitlines() if line.startswith("| `")][:7]
    for name, *cells in rows:
        for column, cell in zip(COLUMNS, cells, strict=True):
            shown = [float(number) for number in re.findall(r"\d+(?:\.\d+)?", cell)]
            assert shown == pytest.approx(public[name.split("`")[1], *column], rel=0.02, abs=0.3), (name, column)
