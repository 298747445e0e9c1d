"""Masks passwords in addresses before they are printed or stored."""

import re

_IN_ADDRESS = re.compile(r"(?<=://)([^\s/@:'\"]*):[^\s/'\"]*@")
_IN_QUERY = re.compile(r"([?&](?:password|passwd|pwd|token|secret|api_?key)=)[^\s&'\"]+", re.IGNORECASE)


def masked(text: str) -> str:
    """Return text with "***" for the password of every address in it.

    >>> masked("postgresql://me:secret@host/runs?token=abc")
    'postgresql://me:***@host/runs?token=***'
    """
    return _IN_QUERY.sub(r"\1***", _IN_ADDRESS.sub(r"\1:***@", text))
