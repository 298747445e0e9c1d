"""What --json tells a program."""

import json
from pathlib import Path

from support.command_line import commands


def test_run_tells_a_program_all_in_one_object(bench, toys: str, tmp_path: Path):
    """Although a method of theirs prints."""
    (tmp_path / "loud.py").write_text(
        "from dataclasses import dataclass\nfrom sucre_bench import Restoration, method\n\n\n@method()\n"
        "@dataclass(frozen=True)\nclass Loud:\n    def restore(self, scene, view):\n        print('hello')\n"
        "        return Restoration(view.rgb)\n"
    )
    done = bench("run", "--json", "-m", "--plugin", toys, "--plugin", "loud.py", "dataset=toy", "method=loud,faulty",
                 "metrics=[redness]", "tracking.uri=off", "out=results")  # fmt: skip
    told = json.loads(done.stdout)
    assert (told["ok"], told["exit_code"], done.returncode) == (5, 1, 1)
    (fault,) = told["failed"]
    assert (fault["where"], fault["view"]) == ("toy / faulty", "v1.png")
    assert "boom" in fault["reason"]
    for name in ("table", "page", "log"):
        assert (tmp_path / told[name]).is_file()
    assert "hello" in done.stderr


def test_json_is_asked_for_alike(bench, toys: str):
    bench("run", "--plugin", toys, "dataset=toy", "method=gain", "metrics=[redness]", "tracking.uri=off", "out=results",
          "workers=0", "report=false")  # fmt: skip
    by_name = bench("compare", "results", "--json").stdout
    assert json.loads(by_name)
    assert by_name == bench("compare", "results", "--format", "json").stdout
    scored = bench("score", "results/restored/toy/gain", "--metrics", "uciqe", "--json").stdout
    assert {row["metric"] for row in json.loads(scored)} >= {"uciqe"}
    for command in ("run", "compare", "score", "list", "describe", "check", "doctor"):
        assert "--json" in {name for p in commands()[command].params for name in p.opts}, command
