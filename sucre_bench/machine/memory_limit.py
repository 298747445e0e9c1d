"""The limit on this process's memory that `ulimit -v` or a queue sets."""

import resource

LEAST_MB = 800  # with less, OpenBLAS waits for ever for memory that does not come


def limit_mb() -> int | None:
    """Return how many MB (10^6 bytes) of addresses this process may have; None if there is no limit."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit // 10**6


def too_little() -> str:
    """Return why this process cannot work, and what to do; empty if it can."""
    limit = limit_mb()
    if limit is None or limit >= LEAST_MB:
        return ""
    return f"ulimit -v: allows {limit} MB, too few for the numerical libraries; allow 4000 MB, `ulimit -v 4000000`"
