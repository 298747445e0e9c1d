from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from sucre_bench.reports.page.join_scripts import join_scripts

MODULES = {
    "main": 'import { twice } from "./sums.js";\nimport "./effects.js";\nconst log = twice(4);\nmade.push(log);\n',
    "sums": 'import {\n  two,\n} from "./numbers.js";\nexport const twice = (x) => two * x;\nconst log = 0;\n',
    "numbers": "export const two = 2;\nconst log = 1;\n",
    "effects": 'import { two } from "./numbers.js";\nmade.push(two);\n',
}


def test_modules_run_once_each_after_what_they_import_and_share_no_names():
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node here")
    script = join_scripts("main", MODULES.__getitem__)
    code = f"globalThis.made = []; {script}; console.log(JSON.stringify([made, typeof log, typeof modules]))"
    done = subprocess.run([node, "-e", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [[2, 8], "undefined", "undefined"]


def test_modules_in_a_circle_are_refused():
    circle = {"a": 'import { b } from "./b.js";\nexport const a = 1;\n', "b": 'import { a } from "./a.js";\n'}
    with pytest.raises(ValueError, match="a -> b -> a"):
        join_scripts("a", circle.__getitem__)


def test_a_name_that_is_not_exported_is_refused():
    modules = {"a": 'import { b, c } from "./b.js";\n', "b": "export const b = 1;\nconst c = 2;\n"}
    with pytest.raises(ValueError, match=r"export c\b"):
        join_scripts("a", modules.__getitem__)
