"""Environments of programs: of uv, conda or docker, each with a digest of what is in it.

uv makes the environment from a file when it is first used and keeps it in its cache. A conda environment and a docker
image exist before; an image that is not here is pulled.
"""

import functools
import hashlib
import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from sucre_bench import InputError
from sucre_bench.errors import MissingFileError
from sucre_bench.machine.files import expanded
from sucre_bench.machine.processes import environment_of_programs
from sucre_bench.methods.doors.process import Printed, run_program

_FORMS = "uv:FILE, conda:NAME or docker:IMAGE@sha256:DIGEST"
_GPU_OF_CONTAINERS = "nvidia-container-cli"  # where it is installed, docker takes --gpus
_LIST_S = 120.0


@dataclass(frozen=True)
class Environment:
    """An environment. name: the file, the conda environment or its folder, the image; digest: "sha256:...", or empty.

    A file is requirements.txt, pylock.toml, a script with its requirements (PEP 723), or uv.lock of a project.
    """

    tool: str
    name: str
    digest: str = ""

    @classmethod
    def of(cls, text: str) -> "Environment":
        """Read TOOL:NAME or TOOL:NAME@sha256:DIGEST. InputError for another form, and for an image without digest."""
        found = re.fullmatch(r"(uv|conda|docker):(?=.)(.*?)@?(sha256:[0-9a-f]{64})?", text)
        if not found or not (found[2] or found[1] == "docker"):
            raise InputError("is no environment", f"command.env={text}", f"give {_FORMS}")
        tool, name, digest = found[1], found[2], found[3] or ""
        if tool == "docker" and not digest:
            image = name.partition("@")[0]  # without a digest that is too short
            show = f"docker image inspect --format '{{{{.RepoDigests}}}} {{{{.Id}}}}' {image}"
            bare = re.sub(r":[^/]*$", "", image)  # without a tag; a registry may have a port
            remedy = f"give docker:{bare}@sha256:..., or docker:sha256:... if it was built here; see `{show}`"
            raise InputError("an image without digest may change", f"command.env={text}", remedy)
        return cls(tool, str(expanded(name)) if tool != "docker" else name, digest)

    def __str__(self) -> str:
        return f"{self.tool}:{self.name}{'@' * bool(self.name and self.digest)}{self.digest}"

    def check(self) -> None:
        """Raise InputError where its tool or file is missing, or its content has another digest than was given."""
        if shutil.which(self.tool) is None:
            raise InputError(f"{self.tool} is not installed", self._place, f"install it, or give another of {_FORMS}")
        if self.tool == "uv" and not Path(self.name).is_file():
            raise MissingFileError("no such file", self.name, "give uv:FILE, a file of requirements, in command.env")
        if self.digest and (found := self._found_digest) and found != self.digest:
            remedy = "bring the old content back, or leave out @sha256:... and give another label"
            raise InputError(f"is {found} now, not {self.digest}", self._place, remedy)

    @property
    def pinned(self) -> "Environment":
        """The same with a digest: the one given, or else that of its content, where that can be read."""
        return self if self.digest else replace(self, digest=self._found_digest)

    @property
    def _found_digest(self) -> str:
        """The digest of uv's file, or of conda's explicit list; empty where there is none. An image has the given."""
        if self.tool == "docker":
            return self.digest
        try:
            content = _explicit_list(self.name) if self.tool == "conda" else Path(self.name).read_bytes()
        except OSError:
            content = b""
        return f"sha256:{hashlib.sha256(content).hexdigest()}" if content else ""

    def command(self, words: Sequence[str], mounts: Sequence[Path] = (), read_only: Sequence[Path] = ()) -> list[str]:
        """Return the words that run a program in it. mounts, read_only: what a container sees, at the same paths."""
        if self.tool == "uv":
            file = Path(self.name)
            of_project = ["--locked", "--project", str(file.parent)]
            of_file = ["--no-project", "--with-requirements", self.name]
            which = of_project if file.name == "uv.lock" else of_file
            return ["uv", "run", "--quiet", "--isolated", *which, "--", *words]
        if self.tool == "conda":
            return ["conda", "run", "--no-capture-output", *_conda(self.name), *words]
        # --init passes SIGTERM on; --user lets us remove its files, and such a user has no home.
        run = ["docker", "run", "--rm", "--init", "--user", f"{os.getuid()}:{os.getgid()}", "--env", "HOME=/tmp"]
        gpus = ["--gpus", "all"] if shutil.which(_GPU_OF_CONTAINERS) else []
        seen = [f"{path.absolute()}:{path.absolute()}" for path in mounts]
        seen += [f"{path.absolute()}:{path.absolute()}:ro" for path in read_only]
        return [*run, *gpus, *(word for one in seen for word in ("--volume", one)), self._image, *words]

    def make(self) -> None:
        """Make what is missing of it. InputError with the last line that the tool printed, where that fails."""
        tries = {
            "uv": [self.command(["python", "-V"])],
            "conda": [["conda", "list", "--quiet", *_conda(self.name)]],
            "docker": [["docker", "image", "inspect", self._image], ["docker", "pull", "--quiet", self._image]],
        }
        for words in tries[self.tool]:
            ended = run_program(words)
            if not ended.fault:
                return
        remedy = f"mend it until this works: {' '.join(words)}"
        fault = f"cannot be made: {ended.last_words or ended.fault}"
        raise InputError(fault, self._place, remedy) from Printed(ended.said)

    @property
    def _place(self) -> str:
        return f"command.env={self.tool}:{self.name or self.digest}"

    @property
    def _image(self) -> str:
        return f"{self.name}@{self.digest}" if self.name else self.digest


def _conda(name: str) -> list[str]:
    return ["--prefix" if "/" in name else "--name", name]


@functools.lru_cache  # a second each
def _explicit_list(name: str) -> bytes:
    """The packages of a conda environment by address and md5, sorted; none where conda does not list them."""
    words = ["conda", "list", "--explicit", "--md5", *_conda(name)]
    try:
        listed = subprocess.run(words, capture_output=True, timeout=_LIST_S, env=environment_of_programs())
    except subprocess.TimeoutExpired:
        return b""
    lines = listed.stdout.splitlines() if not listed.returncode else []
    return b"\n".join(sorted(line for line in lines if line and not line.startswith(b"#")))
