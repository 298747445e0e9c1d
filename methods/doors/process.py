"""Runs a program without a shell and for a limited time, and ends all processes that it leaves behind.

The program gets no input, this process's environment and working folder, and a process group of its own. Of what it
prints, only the end is kept. Its memory is sampled ten times a second: the sum of the resident memory of the program
and of all that it has started.
"""

import functools
import hashlib
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf, nan
from pathlib import Path
from threading import Thread
from typing import IO

from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.machine.files import expanded
from sucre_bench.machine.processes import (
    dying_with_parent,
    interrupts_held_back,
)

_KEPT_BYTES = 16_384
_GRACE_S = 3.0
_SAMPLE_S = 0.1
_LATE_OUTPUT_S = 0.5  # after its end: a daemon may hold the pipes open for ever


class Printed(Exception):  # noqa: N818, it is no error: it is kept with the traceback of one
    """What a program printed."""


@dataclass(frozen=True)
class Ended:
    """How a program ended."""

    fault: str
    """Empty when it ended well, else why not."""

    seconds: float
    peak_mb: float

    said: str
    """The end of what it printed, errors last."""

    @property
    def last_words(self) -> str:
        """The last line it printed, fit for a message."""
        lines = [line for line in self.said.splitlines() if line.strip()]
        return (
            "".join(c if c.isprintable() else " " for c in lines[-1]).strip()[-200:]
            if lines
            else ""
        )


def run_program(arguments: Sequence[str], timeout: float | None = None) -> Ended:
    """Run a program to its end, or for `timeout` seconds. InputError when it cannot be started.

    In every case (in time, too late or interrupted), the rest of its process group gets SIGTERM, and SIGKILL three
    seconds later.
    """
    process = None
    in_time = False
    peak_mb = 0.0
    started = time.perf_counter()
    limit = started + (inf if timeout is None else timeout)
    tails = bytearray(), bytearray()
    try:
        with interrupts_held_back():
            process = _start(arguments)
            streams = zip((process.stdout, process.stderr), tails, strict=True)
            readers = [Thread(target=_keep_end, args=stream, daemon=True) for stream in streams]
            for reader in readers:
                reader.start()
        while not in_time and (left := limit - time.perf_counter()) > 0:
            peak_mb = max(peak_mb, _memory_mb(process.pid))
            with suppress(subprocess.TimeoutExpired):
                process.wait(min(_SAMPLE_S, left))
                in_time = True
        seconds = time.perf_counter() - started
    finally:
        if process:
            _end_group(process)
    for reader in readers:
        reader.join(_LATE_OUTPUT_S)
    code = process.returncode
    fault = f"ended with exit code {code}" if code else ""
    if not in_time:
        fault = f"was stopped after {timeout:g} s"
    elif code < 0:
        name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
        fault = f"was killed by {name}{', for want of memory perhaps' if -code == signal.SIGKILL else ''}"
    said = "\n".join(text for tail in tails if (text := tail.decode(errors="replace").strip()))
    return Ended(fault, seconds, peak_mb or nan, said)


def _environment() -> dict[str, str]:
    """The environment of a program of the user's, which may import what lies beside it; `cli` lets ours not."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}


def _start(arguments: Sequence[str]) -> subprocess.Popen[bytes]:
    try:
        return subprocess.Popen(
            arguments,
            bufsize=0,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=_environment(),
            start_new_session=True,
            preexec_fn=dying_with_parent(),
        )
    except (OSError, ValueError) as fault:  # of the program, or of what its first line names
        reason = getattr(fault, "strerror", None) or fault
        remedy = "install it, make it executable with chmod +x, or name what runs it first, such as python3"
        raise InputError(f"{arguments[0]}: cannot be started, {reason}; {remedy}") from fault


def _keep_end(stream: IO[bytes], tail: bytearray) -> None:
    with stream:
        while chunk := stream.read(1 << 16):
            tail += chunk
            del tail[:-_KEPT_BYTES]


def _memory_mb(pid: int) -> float:
    """The resident memory of a process and all that it has started, MB; 0 once it has ended."""
    import psutil

    total = 0.0
    with suppress(psutil.Error):
        top = psutil.Process(pid)
        for process in (top, *top.children(recursive=True)):
            with suppress(psutil.Error):  # it ended in between
                total += process.memory_info().rss / 2**20
    return total


def _end_group(process: subprocess.Popen[bytes]) -> None:
    """End a process and its group, asking first: a docker client then stops its container, which no kill would.

    The whole group gets the time: the client may be the child of a script or of conda, which end at once. One more
    Ctrl-C kills the group.
    """
    with interrupts_held_back() as held:
        with suppress(ProcessLookupError, PermissionError):
            # a group that has ended, or is another user's
            os.killpg(process.pid, signal.SIGTERM)
            deadline = time.perf_counter() + _GRACE_S
            while _is_alive(process.pid) and time.perf_counter() < deadline and not held:
                time.sleep(0.01)
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _is_alive(group: int) -> bool:
    """Whether any process of the group runs; those that have ended and are not waited for do not."""
    import psutil

    for pid in psutil.pids():
        with suppress(psutil.Error, ProcessLookupError, PermissionError):
            if (
                os.getpgid(pid) == group
                and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
            ):
                return True
    return False


# Environments of programs: of uv, conda or docker, each with a digest of what is in it.
#
# uv makes the environment from a file when it is first used and keeps it in its cache. A conda environment and a docker
# image exist before; an image that is not here is pulled.

_FORMS = "uv:FILE, conda:NAME or docker:IMAGE@sha256:DIGEST"
_GPU_OF_CONTAINERS = "nvidia-container-cli"  # where it is installed, docker takes --gpus
_LIST_S = 120.0


@dataclass(frozen=True)
class Environment:
    """The environment of a program."""

    tool: str

    name: str
    """The file, the conda environment or its folder, or the image. A file is requirements.txt, pylock.toml, a script
    with its requirements (PEP 723), or uv.lock of a project."""

    digest: str = ""
    """Is "sha256:...", or empty."""

    @classmethod
    def of(cls, text: str) -> "Environment":
        """Read TOOL:NAME or TOOL:NAME@sha256:DIGEST. InputError for another form, and for an image without digest."""
        found = re.fullmatch(r"(uv|conda|docker):(?=.)(.*?)@?(sha256:[0-9a-f]{64})?", text)
        if not found or not (found[2] or found[1] == "docker"):
            raise InputError("is no environment", f"method.env={text}", f"give {_FORMS}")
        tool, name, digest = found.groups("")
        if tool == "docker" and not digest:
            image = name.partition("@")[0]  # without a digest that is too short
            show = f"docker image inspect --format '{{{{.RepoDigests}}}} {{{{.Id}}}}' {image}"
            bare = re.sub(r":[^/]*$", "", image)  # without a tag; a registry may have a port
            remedy = f"give docker:{bare}@sha256:..., or docker:sha256:... if it was built here; see `{show}`"
            raise InputError("an image without digest may change", f"method.env={text}", remedy)
        return cls(tool, str(expanded(name)) if tool != "docker" else name, digest)

    def __str__(self) -> str:
        at = "@" if self.name and self.digest else ""
        return f"{self.tool}:{self.name}{at}{self.digest}"

    def check(self) -> None:
        """Raise InputError where its tool or file is missing, or its content has another digest than was given."""
        if shutil.which(self.tool) is None:
            raise InputError(
                f"{self.tool} is not installed",
                self._place,
                f"install it, or give another of {_FORMS}",
            )
        if self.tool == "uv" and not Path(self.name).is_file():
            raise MissingFileError(
                "no such file",
                self.name,
                "give uv:FILE, a file of requirements, in method.env",
            )
        if self.digest and (found := self._found_digest) and found != self.digest:
            remedy = (
                "bring the old content back, or leave out @sha256:... and give another label"
            )
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
            content = (
                _explicit_list(self.name)
                if self.tool == "conda"
                else Path(self.name).read_bytes()
            )
        except OSError:
            content = b""
        return f"sha256:{hashlib.sha256(content).hexdigest()}" if content else ""

    def command(
        self, words: Sequence[str], mounts: Sequence[Path] = (), read_only: Sequence[Path] = ()
    ) -> list[str]:
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
        run = [
            "docker",
            "run",
            "--rm",
            "--init",
            "--user",
            f"{os.getuid()}:{os.getgid()}",
            "--env",
            "HOME=/tmp",
        ]
        gpus = ["--gpus", "all"] if shutil.which(_GPU_OF_CONTAINERS) else []
        seen = [f"{path.absolute()}:{path.absolute()}" for path in mounts]
        seen += [f"{path.absolute()}:{path.absolute()}:ro" for path in read_only]
        return [
            *run,
            *gpus,
            *(word for one in seen for word in ("--volume", one)),
            self._image,
            *words,
        ]

    def make(self) -> None:
        """Make what is missing of it. InputError with the last cause that the tool printed, where that fails."""
        tries = {
            "uv": [self.command(["python", "-V"])],
            "conda": [["conda", "list", "--quiet", *_conda(self.name)]],
            "docker": [
                ["docker", "image", "inspect", self._image],
                ["docker", "pull", "--quiet", self._image],
            ],
        }
        for words in tries[self.tool]:
            ended = run_program(words)
            if not ended.fault:
                return
        remedy = f"mend it until this works: {' '.join(words)}"
        causes = [
            line
            for line in ended.said.splitlines()
            if re.match(r"\s*(error|cause|Caused by): ", line)
        ]
        last = replace(ended, said="\n".join(causes) or ended.said).last_words
        fault = f"cannot be made: {last.removeprefix('cause: ').rstrip('.') or ended.fault}"
        raise InputError(fault, self._place, remedy) from Printed(ended.said)

    @property
    def _place(self) -> str:
        return f"method.env={self.tool}:{self.name or self.digest}"

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
        listed = subprocess.run(words, capture_output=True, timeout=_LIST_S, env=_environment())
    except subprocess.TimeoutExpired:
        return b""
    lines = listed.stdout.splitlines() if not listed.returncode else []
    return b"\n".join(sorted(line for line in lines if line and not line.startswith(b"#")))
