"""Stages that resume: each has a folder named after a hash of its inputs, and a mark when it is done."""

import hashlib
import shutil
from dataclasses import dataclass
from pathlib import Path

from sucre_bench.machine.files import write_atomically


@dataclass(frozen=True, slots=True)
class Stage:
    """A stage's folder. key: a hash of its inputs and of the stages before it."""

    folder: Path
    key: str

    @property
    def done(self) -> bool:
        """Whether its result exists."""
        return (self.folder / "done").is_file()

    def finish(self) -> None:
        """Mark the stage as done."""
        write_atomically(self.folder / "done", b"")


def stage(work: Path, name: str, *depends: object) -> Stage:
    """Return the stage of that name under `work`; its files for other inputs or options are removed."""
    key = hashlib.blake2b(repr(depends).encode(), digest_size=6).hexdigest()
    folder = work / f"{name}-{key}"
    for old in work.glob(f"{name}-*"):
        if old != folder:
            shutil.rmtree(old)
    folder.mkdir(parents=True, exist_ok=True)
    return Stage(folder, key)
