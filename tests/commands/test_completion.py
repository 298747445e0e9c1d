"""What <TAB> offers: by the protocol between shell and program, and in the shells themselves."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.shell_completion import shell_complete, split_arg_string
from support.command_line import HEAVY
from support.places import TOYS

from sucre_bench.cli import cli

FOLDER = Path(sys.executable).parent
NO_WORDS = ["a file"]  # which the shell completes


@pytest.fixture
def offered(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """The words offered for a line, as zsh is told them."""

    def ask(line: str) -> list[str]:
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv(
            "COMP_CWORD", str(len(split_arg_string(line)) - (not line.endswith(" ")))
        )
        shell_complete(cli, {}, "sucre-bench", "_SUCRE_BENCH_COMPLETE", "zsh_complete")
        # a kind, a word and its meaning by turns
        answers = capsys.readouterr().out.strip().splitlines()
        if answers[:1] == ["file"]:
            return NO_WORDS
        return [word.replace("\\:", ":") for word in answers[1::3]]

    return ask


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("sucre-bench comp", ["compare", "completion"]),
        ("sucre-bench run --mult", ["--multirun"]),
        ("sucre-bench run meth", ["method=", "method."]),
        ("sucre-bench run -m method=clahe,clah", NO_WORDS),  # no name twice
        ("sucre-bench run -m method=clahe,gray_w", ["method=clahe,gray_world"]),
        ("sucre-bench run experiment=table", ["experiment=table1"]),
        ("sucre-bench run dataset=colm", ["dataset=colmap"]),
        ("sucre-bench run metrics=psn", ["metrics=psnr"]),
        (
            "sucre-bench run method.phys",
            ["method.physical="],
        ),  # of the method that runs by default
        ("sucre-bench run method=sucre_torch method.enc", ["method.encoding="]),  # of a preset
        ("sucre-bench run method=gray_world method.enc", NO_WORDS),
        (f"sucre-bench run --plugin {TOYS} method=tabul", ["method=tabulated"]),
        ("sucre-bench run degrade.jpeg", ["degrade.jpeg_quality="]),
        ("sucre-bench run shard.", ["shard.index=", "shard.count="]),
        ("sucre-bench run nothing.like=", NO_WORDS),
        ("sucre-bench run -m method=sucre,onnx onn", ["onnx."]),
        ("sucre-bench run -m method=sucre,onnx onnx.mod", ["onnx.model="]),
        ("sucre-bench run -m method=gray_world,sucre method.enc", ["method.encoding="]),
        ("sucre-bench run 'metrics=[psnr,uci", ["metrics=[psnr,uciqe"]),
        ("sucre-bench describe colm", ["colmap"]),
        ("sucre-bench describe colmap dataset.roo", ["dataset.root="]),
        ("sucre-bench score x --metrics psi,psn", ["psi,psnr"]),
        ("sucre-bench compare x --format l", ["latex"]),
        ("sucre-bench completion ", ["bash", "zsh", "fish"]),
    ],
)
def test_words_are_completed(offered, line: str, words: list[str]):
    assert offered(line) == words


def test_every_method_is_offered(offered):
    from sucre_bench import plugins

    names = {word.removeprefix("method=") for word in offered("sucre-bench run method=")}
    assert set(plugins.discover("method")) <= names


def test_completion_imports_nothing_heavy():
    code = (
        "import sys\nfrom sucre_bench.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "print('IMPORTED', *sorted({m.split('.')[0] for m in sys.modules}), file=sys.stderr)"
    )
    env = {**os.environ, "_SUCRE_BENCH_COMPLETE": "zsh_complete"}
    env |= {"COMP_WORDS": "sucre-bench run method=", "COMP_CWORD": "2"}
    code = "import sys; sys.argv[0] = 'sucre-bench'\n" + code
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=env, check=True
    )
    assert "method=sucre" in done.stdout
    assert not HEAVY & set(done.stderr.split())


def test_bash_completes_a_line_on_tab(tmp_path: Path):
    """Bash parts words at "=" and ":"; what is offered stands in the place of the last part."""
    (tmp_path / "a dir").mkdir()
    (tmp_path / "p").write_text("")  # would stand for [psnr], were that read as a pattern
    lines = {
        "run method=gray_w": "run method=gray_world",
        "run metrics=[psi,psn": "run metrics=[psi,psnr",
        "run 'metrics=[psn": "run 'metrics=[psnr'",
        "run out=a": r"run out=a\ dir/",
        "run out=": "run out=",  # may become both
        "score x --metrics=psi,psn": "score x --metrics=psi,psnr",
        "xyz fo": "xyz fo",
    }
    # Ctrl-T shows the line, Ctrl-U clears it
    typed = "".join(f"sucre-bench {line}\t\x14\x05\x15" for line in lines)
    shown = r"""bind -x '"\C-t": echo "$READLINE_LINE" >> lines'"""
    env = {**os.environ, "PATH": f"{FOLDER}:{os.environ['PATH']}", "TERM": "vt100"}
    done = subprocess.run(
        ["bash", "--norc", "--noprofile", "-i"],
        input=f"set +o history\nset +H\n{shown}\nsource <(sucre-bench completion bash)\n{typed}\n",
        capture_output=True,
        text=True,
        env=env,
        cwd=tmp_path,
        check=True,
    )
    assert (tmp_path / "lines").read_text().splitlines() == [
        f"sucre-bench {line}" for line in lines.values()
    ]
    assert "no command" not in done.stdout + done.stderr


def test_fish_keeps_what_follows_a_comma_of_a_word(capsys: pytest.CaptureFixture[str]):
    cli(["completion", "fish"], standalone_mode=False)
    # of "plain,metrics=[psi,psnr]"
    assert 'string split -m 1 "," $completion' in capsys.readouterr().out
