"""A sqlite store of mlflow: made quickly, and checked before mlflow opens it.

mlflow makes an empty store by more than fifty migrations, which takes seconds. So this machine makes one, and later
stores begin as copies of it. mlflow retries a store that it cannot open for minutes; sqlite says at once why it cannot.
"""

import shutil
import sqlite3
import tempfile
from contextlib import closing, suppress
from pathlib import Path

from sucre_bench.errors import InputError
from sucre_bench.machine.files import user_cache, write_atomically
from sucre_bench.machine.provenance import version_of

_PATIENCE_S = 10


def make(store: Path) -> None:
    """Write an empty store, if there is none. If that fails, there is none: mlflow makes its own."""
    if store.exists() and store.stat().st_size:
        return
    template = user_cache() / f"mlflow-{version_of('mlflow')}.db"
    with suppress(OSError, sqlite3.Error):
        if not template.is_file():
            template.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(template, _made_by_mlflow())
        write_atomically(store, template.read_bytes())


def check(store: Path) -> None:
    """Raise InputError, with the reason, if sqlite cannot write to a store."""
    try:
        with closing(sqlite3.connect(store, timeout=_PATIENCE_S, isolation_level=None)) as opened:
            opened.execute("BEGIN IMMEDIATE")
            opened.execute("ROLLBACK")
    except sqlite3.Error as fault:
        remedy = "move it away, or give another URI"
        raise InputError(f"mlflow cannot use this store, {fault}", store, remedy) from None


def _made_by_mlflow() -> bytes:
    """An empty store as mlflow makes it, without the experiment whose artifacts would lie where it was made."""
    from mlflow import MlflowClient

    folder = Path(tempfile.mkdtemp(prefix="sucre_bench-"))
    try:
        path = folder / "mlflow.db"
        MlflowClient(tracking_uri=f"sqlite:///{path}").search_experiments()
        with closing(sqlite3.connect(path)) as opened:
            opened.execute("DELETE FROM experiments")  # mlflow makes its default one in any store without
            opened.commit()
        return path.read_bytes()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
