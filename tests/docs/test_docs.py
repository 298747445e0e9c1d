"""The documentation: its commands exist with their options, its links lead somewhere, what it names is there."""

from __future__ import annotations

import json
import re
import shlex
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.colmap_folder import write_dive
from support.command_line import commands as commands_by_name, hide
from support.places import ROOT, blocks, write_experiments

from sucre_bench import plugins
from sucre_bench.cli import cli
from sucre_bench.jobs import compose_jobs as config
from sucre_bench.plugins.plugin import Plugin

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
PLUGINS_OF_EXAMPLES = ("halve_blue",)  # of pages that make them
# commands that differ in these alone are alike
FREE = re.compile(r"(out|every|dataset\.root)=")


def text_of(page: Path) -> str:
    """A page, continued lines joined."""
    return re.sub(r"\\\n\s*", "", page.read_text(encoding="utf-8"))


def commands() -> list[str]:
    """Every sucre-bench command line, of pages and of helps."""
    texts = [
        *map(text_of, PAGES),
        *(command.help or "" for command in (cli, *commands_by_name().values())),
    ]
    lines = {line.strip() for text in texts for line in text.splitlines()}
    return sorted(line for line in lines if line.startswith("sucre-bench "))


def mentioned() -> list[str]:
    """Every sucre-bench command within a sentence, but those that are of no options or only allude to some."""
    found = {
        one for page in PAGES for one in re.findall(r"`(sucre-bench [^`]+)`", text_of(page))
    }
    return sorted(one for one in found if "..." not in one)


def check_options(words: list[str]) -> None:
    """Of a command other than run."""
    command = commands_by_name()[words[0]]
    known = {
        "-h",
        "--help",
        *(option for p in command.params for option in (*p.opts, *p.secondary_opts)),
    }
    assert {word.split("=")[0] for word in words[1:] if word.startswith("--")} <= known


def few(word: str) -> str:
    """A word with two shards, or two numbers, in place of many: they differ in their number only."""
    word = re.sub(r"^(shard\.(?:count=|index=range\())\d+", r"\g<1>2", word)
    return re.sub(r"^([\w.]+=[\d.]+,[\d.]+)(,[\d.]+)+$", r"\1", word)


def with_one_method(words: list[str]) -> list[str]:
    """The words with one method in place of an experiment's: tests/golden composes all jobs of every experiment.

    What words name of a method stays.
    """
    general = all(
        re.match(r"(experiment|dataset|every|out|views|degrade)[.=]|-m$|run$", word)
        for word in words
    )
    is_experiment = any(word.startswith("experiment=") for word in words)
    return [*words, "method=gray_world"] if is_experiment and general else words


def documented() -> list[list[str]]:
    """The words of every command, but of runs whose every word stands in a longer one with the same choices."""
    found: list[list[str]] = []
    seen: set[tuple[str, ...]] = set()
    for line in sorted(commands(), key=lambda line: (-len(line), line)):
        words = shlex.split(re.split(r" {2,}#| {3,}| \| | > ", line)[0])[1:]
        choices = [word for word in words if re.match("(dataset|method|experiment)=", word)]
        told = {
            (word, *(choices if re.match(r"\w+\.", word) else ()))
            for word in words
            if not FREE.match(word)
        }
        if any(plugin in line for plugin in PLUGINS_OF_EXAMPLES) or (
            words[0] == "run" and told <= seen
        ):
            continue
        seen |= told
        found.append([few(word) for word in words])
    return [with_one_method(words) for words in reversed(found)]


@pytest.mark.parametrize("words", documented(), ids=" ".join)
def test_a_documented_command_exists_with_its_options(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    write_experiments(tmp_path)
    write_dive(tmp_path / "dive")
    monkeypatch.chdir(tmp_path)
    if words[0] == "run":
        if "--config-dir" in words:  # a folder of the reader's
            pytest.skip("names files of one's own")
        overrides = [word for word in words[1:] if not word.startswith("-")]
        assert config.jobs(overrides, multirun="-m" in words).jobs
    else:
        check_options(words)


@pytest.mark.parametrize("line", mentioned())
def test_a_command_within_a_sentence_exists_with_its_options(line: str):
    words = shlex.split(line)[1:]
    if words[0] == "run":
        assert "run" in commands_by_name()
    elif not words[0].startswith("-"):
        check_options(words)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_targets_of_make_are_there(page: Path):
    targets = set(
        re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    )
    lines = [line for code in blocks(str(page), "(?:sh)?") for line in code.splitlines()]
    lines += re.findall(r"`([^`\n]+)`", text_of(page))
    told = [found[1] for line in lines if (found := re.search(r"(?:^|\s)make ([a-z]+)$", line))]
    assert set(told) <= targets


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_python_is_python(page: Path):
    for code in blocks(str(page), "python"):
        compile(code, page.name, "exec")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere_and_nothing_is_left_to_fill_in(page: Path):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
        assert (page.parent / target).exists() or target == "tutorial.md", target
    assert "@@" not in text
    assert "TODO" not in text


def test_every_page_is_in_the_sites_navigation():
    nav = (
        (ROOT / "mkdocs.yml")
        .read_text(encoding="utf-8")
        .split("\nnav:")[1]
        .split("\ntheme:")[0]
    )
    for page in (ROOT / "docs").glob("*.md"):
        assert f" {page.name}\n" in nav, page.name


METRIC_PAGES = "".join(
    (ROOT / "docs" / page).read_text(encoding="utf-8") for page in ("metrics.md", "formulas.md")
)


def built_in(kind: Any) -> dict[str, Plugin]:
    found = plugins.discover(kind)
    return {
        n: p
        for n, p in found.items()
        if isinstance(p, Plugin) and p.cls.__module__.startswith("sucre_bench.")
    }


def test_every_metric_and_variant_is_explained():
    told = set(re.findall(r"`([^`\n]+)`", METRIC_PAGES))
    for name, metric in built_in("metric").items():
        assert name in told, name
        assert set(metric.variants) <= told, f"{name}: {set(metric.variants) - told}"


def test_default_variants_are_the_bold_ones():
    bold = set(re.findall(r"\*\*`([^`]+)`\*\*", METRIC_PAGES))
    metrics = built_in("metric").values()
    assert bold == {variant for metric in metrics for variant in metric.default}


def test_every_dataset_and_method_has_its_place():
    for kind, page in (("dataset", "datasets.md"), ("method", "methods.md")):
        text = (ROOT / "docs" / page).read_text(encoding="utf-8")
        assert not [name for name in built_in(kind) if name not in text]


def test_contributing_names_files_that_are_there():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    places = {
        place for place in re.findall(r"`([\w./-]+)`", text) if place.endswith(("/", ".py"))
    }
    assert places
    roots = (ROOT, ROOT / "sucre_bench")
    assert not sorted(
        place for place in places if not any((root / place).exists() for root in roots)
    )


def test_contributing_has_the_floors_of_the_import_contract():
    """Each floor's rooms, bottom up: those of pyproject.toml's layers, top down."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"][
        "importlinter"
    ]["contracts"]
    layers = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    text = (
        (ROOT / "CONTRIBUTING.md")
        .read_text(encoding="utf-8")
        .split("\n## The rooms")[1]
        .split("\n## ")[0]
    )
    floors: list[set[str]] = []
    for floor, rooms in re.findall(r"^\| (\d*) ?\| ([^|]+) \|", text, flags=re.MULTILINE):
        floors += [set()] if floor else []
        floors[-1] |= {room.removesuffix(".py") for room in re.findall(r"`([\w.]+)/?`", rooms)}
    assert floors == [set(re.split(r" [|:] ", layer)) for layer in reversed(layers)]


def test_the_readmes_commands_run_as_they_stand(
    bench: Callable[..., Any], tmp_path: Path, small_demo: list[str]
):
    """All but `restore`, which other tests run; scores are of pictures that `run` made."""
    lines = [line for code in blocks("README.md", "sh") for line in code.splitlines()]
    lines = [line for line in lines if line.startswith("sucre-bench ")]
    assert [line.split()[1] for line in lines] == [
        "run",
        "compare",
        "score",
        "score",
        "restore",
    ]
    (tmp_path / "published.csv").write_text("image,UCIQE\nview_000.png,0.5\n")
    for line in lines[:4]:
        extra = [*small_demo, "tracking.uri=off"] if line.split()[1] == "run" else []
        done = bench(*line.split()[1:], *extra)
        assert done.returncode == 0, f"{line}: {done.stdout} {done.stderr}"
        if line.split()[1] == "run":
            (tmp_path / "results/restored/demo/sucre").rename(tmp_path / "restored")
    assert (tmp_path / "results" / "report" / "index.html").is_file()


BUNDLES = sorted((ROOT / "docs" / "board" / "bundles").glob("*.zip"))
# of README's table
COLUMNS = [
    ("colours", "raw"),
    ("colours_de00", "gain"),
    ("psnr", "masked"),
    ("psi", "colour"),
]


@pytest.mark.parametrize("bundle", BUNDLES, ids=lambda path: path.stem)
def test_a_bundle_is_whole_and_small(bench, bundle):
    told = json.loads(bench("verify", str(bundle), "--json").stdout)
    assert told["faults"] == []
    assert told["differing"] == []
    assert bundle.stat().st_size < 300_000


def test_the_readmes_table_has_the_numbers_of_the_demos_bundle_and_the_best_are_bold(bench):
    bundle = str(ROOT / "docs/board/bundles/demo.zip")
    records = json.loads(bench("compare", bundle, "--json").stdout)
    public = {(r["method"], r["metric"], r["variant"]): r for r in records}
    text = (ROOT / "README.md").read_text(encoding="utf-8").split("| method | colours")[1]
    lines = [line.split("|")[1:-1] for line in text.splitlines() if line.startswith("| `")]
    table = {name.split("`")[1]: cells for name, *cells in lines[:7]}
    assert set(table) == {r["method"] for r in records}
    for n, column in enumerate(COLUMNS):
        of_column = {name: public[name, *column] for name in table}
        for name, cells in table.items():
            shown = [float(number) for number in re.findall(r"\d+(?:\.\d+)?", cells[n])]
            expected = [of_column[name][key] for key in ("mean", "low", "high")]
            assert shown == pytest.approx(expected, rel=0.02, abs=0.3), (name, column)
        assert [name for name in table if "**" in table[name][n]] == [
            name for name in table if of_column[name]["place"] == 1
        ]


def documented_keys(command: str) -> set[str]:
    """The keys in the first column of a command's table."""
    text = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    section = text.split(f"### `{command} --json`\n")[1].split("\n### ")[0]
    cells = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    return {key for cell in cells for key in re.findall(r"`(\w+)`", cell)}


def test_every_key_is_documented(bench, monkeypatch: pytest.MonkeyPatch, small_demo: list[str]):
    hide(monkeypatch)
    words = [*small_demo, "method=gray_world", "tracking.uri=off"]
    commands = {
        "run": ["run", *words, "out=results"],
        "run --dry-run": ["run", *words, "out=results", "--dry-run"],
        "compare": ["compare", "results"],
        "score": ["score", "results/restored/demo/gray_world", "--metrics", "uciqe"],
        "list methods": ["list", "methods", "gray_world"],
        "doctor": ["doctor"],
        "describe": ["describe", *small_demo],
    }
    for name, arguments in commands.items():
        printed = json.loads(bench(*arguments, "--json").stdout)
        first = printed[0] if isinstance(printed, list) else printed
        assert (name, set(first)) == (name, documented_keys(name))


def test_the_short_map_names_commands_and_pages_that_exist(bench):
    text = (ROOT / "docs" / "llms.txt").read_text(encoding="utf-8")
    for page in re.findall(r"\]\(([\w.]+)\)", text):
        assert (ROOT / "docs" / page).is_file() or page == "tutorial.md"
    for command in sorted(set(re.findall(r"`sucre-bench (\w+)", text))):
        assert bench(command, "--help").returncode == 0, command
