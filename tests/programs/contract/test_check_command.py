"""The command that says which rules of the contract a plugin keeps and breaks."""

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from support.messages import names
from support.places import TOYS
from support.tried_plugins import JUDGED, METHOD, METRIC, write

from sucre_bench import InputError, PluginError
from sucre_bench.commands.extend import check as command
from sucre_bench.plugins.registry import find, load_file
from sucre_bench.programs.contract.contract import Subject, check_rule
from sucre_bench.programs.contract.rules_methods import is_the_same_elsewhere

pytestmark = pytest.mark.usefixtures("own_environment")


def run(*arguments: str) -> Result:
    return CliRunner().invoke(command, arguments)


def test_the_command_says_a_line_a_rule_and_what_to_do(tmp_path: Path) -> None:
    path = write(tmp_path, METHOD, "return Restoration(view.rgb / view.rgb.max())", needs="()")
    done = run(str(path), "--quick")
    assert done.exit_code == 1
    assert re.search("✗ .*finite colour", done.stdout)
    assert "guard" in done.stdout
    assert re.search(r"\d+ kept, [1-9]\d* .* [\d.]+ s", done.stdout)
    assert "\x1b" not in done.stdout


def test_the_command_takes_options_and_gives_json(tmp_path: Path) -> None:
    body = "assert self.gain == 0.5\nreturn Restoration(view.rgb * np.float32(self.gain))"
    path = write(tmp_path, METHOD, body, needs="()")
    done = run(str(path), "method.gain=0.5", "--quick", "--json")
    (told,) = json.loads(done.stdout)
    assert (told["kind"], told["name"], told["ok"], done.exit_code) == ("method", "tried", True, 0)
    assert {rule["status"] for rule in told["rules"]} == {"kept"}
    assert run(str(path), "--quick").exit_code == 1


def test_the_command_imports_in_another_process_and_tries_a_dataset(tmp_path: Path) -> None:
    path = write(tmp_path, METHOD, "return Restoration(view.rgb)", needs="()")
    path.write_text(f"import scipy.linalg, os\nos.environ['HEAVY_HERE'] = '1'\n{path.read_text()}")
    load_file(TOYS)
    done = run(str(path), "--on", "toy")
    assert "imports scipy " in done.stdout
    assert "os.environ[HEAVY_HERE]" in done.stdout
    assert re.search("✓ .*another process", done.stdout)
    assert re.search(r"✓ .*whole scene  .* s, .* 0\.0 megapixels .*toy", done.stdout)


def test_another_process_that_restores_otherwise_is_noticed(tmp_path: Path) -> None:
    # A bit of a hash for each column: that all are the same in two processes never happens by chance.
    body = "bits = np.float32([hash(str(column)) % 2 for column in range(view.rgb.shape[1])])\n"
    body += "return Restoration(view.rgb * bits[:, None])"
    load_file(write(tmp_path, METHOD, body, needs="()"))
    outcome = check_rule(Subject(find("method", "tried")), is_the_same_elsewhere)
    assert outcome.status == "broken"
    assert "another process " in outcome.findings[0].text


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("gray_wrld",), {"plugin", "'gray_wrld'", "'gray_world'"}),
        (("gray_world", "--kind", "metric"), {"metric", "'gray_world'"}),
        (("gray_world", "--on", "dmo"), {"dataset", "'dmo'", "'demo'"}),
        (("gray_world", "method.gain=2"), {"option", "'gain'"}),
        (("nowhere.py",), {"nowhere.py", "file"}),
    ],
)
def test_the_command_refuses_what_is_not_there(arguments: tuple[str, ...], named: set[str]) -> None:
    fault = run(*arguments).exception
    assert isinstance(fault, PluginError if "nowhere.py" in named else InputError)
    assert named <= names(fault)


def test_a_name_that_two_kinds_have_is_asked_about(tmp_path: Path) -> None:
    path = write(tmp_path, METHOD, "return Restoration(view.rgb)", needs="()")
    metric = METRIC.format(needs=JUDGED, better="lower", body="").replace("Tried", "Tried2 ")
    path.write_text(path.read_text() + metric.replace("@metric(", '@metric(name="tried", '))
    load_file(path)
    assert re.search("method.*metric; .*--kind method", str(run("tried").exception))
    done = run(str(path), "--quick")
    assert done.stdout.index("method tried") < done.stdout.index("metric tried")
