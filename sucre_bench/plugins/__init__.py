"""Methods, datasets and metrics are plugins: a decorated frozen dataclass in a file of its own.

The decorators attach their arguments to the class, and name the plugin after it: SucrePaper is `sucre_paper`.
`jobs/catalogue.py` asks for a plugin by this name. `discover` looks for such classes in the folders methods/,
datasets/ and metrics/, in the entry-point group ``sucre_bench.plugins``, and in files that the user names. A plugin
that does not import is listed with its reason, and the others work. Importing a plugin must be cheap: heavy packages
are named in ``requires`` and imported where they are used.
"""

from sucre_bench.plugins.plugin import (
    KINDS,
    NEEDS,
    Better,
    Broken,
    Dataset,
    Kind,
    Method,
    Metric,
    PairMetric,
    Plugin,
    dataset,
    method,
    metric,
    missing_needs,
    plugin_of,
    snake_case,
)
from sucre_bench.plugins.registry import (
    Registry,
    current,
    discover,
    find,
    get,
    installed,
    is_loaded,
    load_file,
    unknown,
    usable,
    using,
)

__all__ = [
    "KINDS",
    "NEEDS",
    "Better",
    "Broken",
    "Dataset",
    "Kind",
    "Method",
    "Metric",
    "PairMetric",
    "Plugin",
    "Registry",
    "current",
    "dataset",
    "discover",
    "find",
    "get",
    "installed",
    "is_loaded",
    "load_file",
    "method",
    "metric",
    "missing_needs",
    "plugin_of",
    "snake_case",
    "unknown",
    "usable",
    "using",
]
