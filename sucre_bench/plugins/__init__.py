"""Methods, datasets and metrics are plugins: a decorated frozen dataclass in a file of its own.

The decorators attach their arguments to the class, and name the plugin after it: SucrePaper is `sucre_paper`.
`jobs/catalogue.py` asks for a plugin by this name. `discover` looks for such classes in the folders methods/,
datasets/ and metrics/, in the entry-point group ``sucre_bench.plugins``, and in files that the user names. A plugin
that does not import is listed with its reason, and the others work. Importing a plugin must be cheap: heavy packages
are named in ``requires`` and imported where they are used.
"""

from sucre_bench.plugins.plugin import (
    KINDS as KINDS,
    NEEDS as NEEDS,
    Better as Better,
    Broken as Broken,
    Dataset as Dataset,
    Kind as Kind,
    Method as Method,
    Metric as Metric,
    PairMetric as PairMetric,
    Plugin as Plugin,
    dataset as dataset,
    method as method,
    metric as metric,
    missing_needs as missing_needs,
    plugin_of as plugin_of,
    snake_case as snake_case,
)
from sucre_bench.plugins.registry import (
    Registry as Registry,
    current as current,
    discover as discover,
    find as find,
    get as get,
    is_loaded as is_loaded,
    load_file as load_file,
    unknown as unknown,
    usable as usable,
    using as using,
)
