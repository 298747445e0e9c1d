"""Text with placeholders in braces, such as "{stem}_restored"; {{ and }} are braces themselves."""

import string
from collections.abc import Collection

from sucre_bench.errors import InputError, did_you_mean


def placeholders(template: str, known: Collection[str], option: str) -> frozenset[str]:
    """Return the names of the placeholders in a template, which `str.format` then fills.

    Raises InputError, naming the option, for one that is not known or not a plain name, and for a stray brace.
    """
    try:
        fields = [field for field in string.Formatter().parse(template) if field[1] is not None]
    except ValueError as fault:
        raise InputError(f"{option}: '{template}': {fault}; write {{{{ and }}}} for braces") from fault
    for _, name, form, conversion in fields:
        if name in known and (form or conversion):
            written = f"{{{name}{f'!{conversion}' if conversion else ''}{f':{form}' if form else ''}}}"
            raise InputError(f"{option}: '{written}': no format or conversion is allowed; write {{{name}}}")
        if name not in known:
            hint = did_you_mean(str(name), known)
            raise InputError(f"{option}: no placeholder '{{{name}}}'; {hint}; write {{{{ and }}}} for braces")
    return frozenset(str(name) for _, name, _, _ in fields)
