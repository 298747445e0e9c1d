import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest
from support.messages import names, refused

import sucre_bench
from sucre_bench import InputError, PluginError, method, metric, plugins
from sucre_bench.jobs.compose_jobs import jobs
from sucre_bench.plugins.options import create, options_of
from sucre_bench.plugins.plugin import Broken
from sucre_bench.plugins.registry import discover, find, load_file


@pytest.fixture(autouse=True)
def new_registry() -> Iterator[None]:
    """A registry that has looked for no plugin yet."""
    with plugins.using(plugins.Registry()):
        yield


METHOD = """
from collections.abc import Iterator
from dataclasses import dataclass
from sucre_bench import Restoration, Scene, View, method

@method(cites="Nobody 2026")
@dataclass(frozen=True)
class {name}:
    '''Give the view back.'''
    def restore(self, scene: Scene, view: View) -> Restoration:
        return Restoration(view.rgb)
"""


def write(folder: Path, name: str, file: str | None = None) -> Path:
    path = folder / (file or f"{name.lower()}.py")
    path.write_text(METHOD.format(name=name))
    return path


@pytest.mark.parametrize("kind", plugins.KINDS)
def test_a_plugin_is_found_by_its_name_alone(kind: plugins.Kind):
    known = discover(kind)
    with plugins.using(plugins.Registry()):
        assert {name: plugins.get(kind, name) for name in known} == known


def test_a_class_imported_from_elsewhere_is_not_a_plugin_of_the_file(tmp_path: Path):
    path = tmp_path / "imports.py"
    path.write_text("from sucre_bench.methods.gray_world import GrayWorld\n")
    with pytest.raises(PluginError, match=r"imports\.py: holds no plugin"):
        load_file(path)


@pytest.mark.parametrize(
    "imported", ["from .method import InAFolder", "from a_folder.method import InAFolder"]
)
def test_the_file_of_a_package_has_the_plugins_of_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, imported: str
):
    folder = tmp_path / "a_folder"
    folder.mkdir()
    write(folder, "InAFolder", "method.py")
    (folder / "__init__.py").write_text(
        f"{imported}\nfrom sucre_bench.methods.gray_world import GrayWorld\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert [plugin.name for plugin in load_file(folder / "__init__.py")] == ["in_a_folder"]
    assert find("method", "in_a_folder").summary == "Give the view back."
    monkeypatch.delitem(sys.modules, "a_folder", raising=False)
    monkeypatch.delitem(sys.modules, "a_folder.method", raising=False)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("import nonexistent_package_xyz\n", "'nonexistent_package_xyz'"),
        ("def broken(:\n", "SyntaxError"),
        ("raise RuntimeError('two\\nlines')\n", "RuntimeError"),
        ("import sys; sys.exit(0)\n", "0"),
    ],
)
def test_a_file_that_does_not_import_is_one_line_with_the_reason(
    tmp_path: Path, text: str, named: str
):
    path = tmp_path / "broken.py"
    path.write_text(text)
    with pytest.raises(PluginError) as fault:
        load_file(path)
    assert str(path) in str(fault.value)
    assert named in names(fault.value)
    assert "\n" not in str(fault.value)


def test_two_plugins_of_one_name_are_refused_with_both_places(tmp_path: Path):
    load_file(write(tmp_path, "GrayWorld"))
    with pytest.raises(PluginError, match=r"gray_world\.py and .*grayworld\.py"):
        find("method", "gray_world")
    assert find("method", "underwater")  # the others are none the worse


def test_a_built_in_file_given_again_is_the_same_plugin():
    load_file(Path(sucre_bench.__file__).parent / "methods" / "gray_world.py")
    assert find("method", "gray_world").name == "gray_world"


def package(folder: Path, module: str, text: str) -> None:
    """An installed package with an entry point of the plugins' group."""
    (folder / f"{module}.py").write_text(text)
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[sucre_bench.plugins]\n{module} = {module}\n")


def test_a_broken_package_is_listed_with_its_reason_and_harms_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    package(tmp_path, "their_broken_package", "1 / 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    known = discover("method")
    broken = known["their_broken_package"]
    assert isinstance(broken, Broken)
    assert broken.reason.startswith("ZeroDivisionError: ")
    assert "gray_world" in known
    with pytest.raises(PluginError, match="zero"):
        find("method", "their_broken_package")


@pytest.mark.parametrize(
    ("field", "named"),
    [
        ("weights: dict[str, float] = None", "'weights'"),
        ("kernel: 'np.ndarray' = None", "NameError"),
        ("level: Literal[1, 2] = 1", "typing.Literal[1"),
        ("label: str = ''", "'label'"),
    ],
)
def test_an_option_that_cannot_be_configured_breaks_only_its_own_plugin(
    tmp_path: Path, field: str, named: str
):
    path = write(tmp_path, "Odd")
    path.write_text(
        path.read_text()
        .replace("from dataclasses", "from typing import Literal\nfrom dataclasses")
        .replace("    def restore", f"    {field}\n    def restore")
    )
    load_file(path)
    assert jobs(["dataset=demo", "method=underwater"], multirun=False)
    with pytest.raises(PluginError) as fault:
        find("method", "odd")
    assert named in names(fault.value)


def test_a_default_of_another_type_is_refused_where_the_plugin_is_chosen(tmp_path: Path):
    path = write(tmp_path, "Odd")
    path.write_text(
        path.read_text().replace("    def restore", "    count: int = None\n    def restore")
    )
    load_file(path)
    with refused("method.count", "None", "whole"):
        jobs(["dataset=demo", "method=odd"], multirun=False)


def test_two_files_of_one_name_are_two_modules(tmp_path: Path):
    for folder, name in (("a", "First"), ("b", "Second")):
        (tmp_path / folder).mkdir()
        load_file(write(tmp_path / folder, name, "mine.py"))
    assert find("method", "first").cls.__module__ != find("method", "second").cls.__module__


def test_a_decorator_refuses_what_nobody_could_use():
    with pytest.raises(
        InputError, match=r"metric\(better\): is 'up'; pass 'higher' or 'lower' or 'none'"
    ):
        metric(variants={"only": ""}, unit="", better="up", range=(0, 1))
    with pytest.raises(InputError, match="display 'strech': unknown"):
        method(display="strech")


def test_what_a_plugin_prints_when_imported_is_no_output_of_ours(tmp_path: Path, bench):
    path = write(tmp_path, "Chatty")
    path.write_text("print('hello')\n" + path.read_text())
    done = bench("list", "methods", "--json", "--plugin", str(path))
    assert "chatty" in {m["name"] for m in json.loads(done.stdout)}


def test_a_file_that_lies_there_and_was_not_given_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    Path("my_gain.py").write_text("")
    with pytest.raises(InputError, match=r"my_gain\.py is here; give --plugin my_gain\.py"):
        plugins.find("method", "my_gain")


def test_a_method_of_several_views_cannot_ask_for_encoded_intensities_of_one():
    with pytest.raises(PluginError, match="encoding=gamma "):
        method(needs={"depth", "poses"}, encoding="gamma")


def test_a_class_that_is_no_frozen_dataclass_is_refused():
    with pytest.raises(PluginError, match=r"Thawed: .*@dataclass\(frozen=True\).*@method"):

        @method()
        @dataclass
        class Thawed:
            pass


@method()
@dataclass(frozen=True)
class Documented:
    """A method."""

    rate: float = 0.5
    """How fast it goes,
    in steps."""
    kind: Literal["soft", "hard"] = "soft"

    def restore(self, scene, view):
        raise NotImplementedError


def test_the_string_below_a_field_is_its_help():
    rate, kind = options_of(Documented)
    assert (rate.name, rate.default, rate.help) == ("rate", 0.5, "How fast it goes, in steps.")
    assert kind.choices == ("soft", "hard")
    assert kind.help == ""


def test_create_refuses_what_the_fields_do_not_say():
    plugin = Documented.__plugin__
    assert create(plugin, {"rate": 2.0}) == Documented(rate=2.0)
    with pytest.raises(InputError, match=r"rate: is 'fast'"):
        create(plugin, {"rate": "fast"})
    assert create(plugin, {"rate": 2}) == Documented(rate=2)
