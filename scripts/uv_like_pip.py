"""Run `uv pip install ARGUMENTS...` with the user's settings of pip, into this Python's environment or --python's.

uv reads neither pip's configuration files nor PIP_* variables. This program translates the settings that decide where
packages come from and which may be taken. A UV_* variable that the user has set wins over pip's setting.
Sources: pip's page "Configuration", uv's pages "Environment variables" and "Compatibility with pip".
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

# pip's setting -> the variables that say the same to uv. None of them can hold more than one value ...
SINGLE = {
    "index-url": ("UV_DEFAULT_INDEX",),
    "keyring-provider": ("UV_KEYRING_PROVIDER",),
    "cert": ("SSL_CERT_FILE",),
    "client-cert": ("SSL_CLIENT_CERT",),
    "proxy": ("HTTP_PROXY", "HTTPS_PROXY"),
    "default-timeout": ("UV_HTTP_TIMEOUT",),
    "timeout": ("UV_HTTP_TIMEOUT",),
    "retries": ("UV_HTTP_RETRIES",),
}
# ... these hold several: the variable, and what uv wants between two values ...
SEVERAL = {
    "extra-index-url": ("UV_INDEX", " "),
    "find-links": ("UV_FIND_LINKS", ","),
    "trusted-host": ("UV_INSECURE_HOST", " "),
}
# ... and these are options, because uv has no variable, or forgets it when the same option is given.
REPEATED = {
    "constraint": "--constraints",
    "no-binary": "--no-binary",
    "only-binary": "--only-binary",
}
SWITCHES = {"no-index": "--no-index", "no-cache-dir": "--no-cache", "pre": "--prerelease=allow"}


def pip_settings() -> dict[str, str]:
    """The configuration of `pip install`, by name: the environment wins over [install], and that over [global]."""
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "config", "list"]
    sections: dict[str, dict[str, str]] = {"global": {}, "install": {}, ":env:": {}}
    for line in subprocess.run(
        pip, capture_output=True, text=True, check=True
    ).stdout.splitlines():
        key, _, value = line.partition("=")
        section, _, name = key.rpartition(".")
        if section in sections:
            sections[section][name] = ast.literal_eval(value)
    return sections["global"] | sections["install"] | sections[":env:"]


def environment(settings: Mapping[str, str], given: Mapping[str, str]) -> dict[str, str]:
    """The variables to run uv with: pip's settings, overridden by the user's variables (`given`)."""
    # pip takes the best version of all indexes. uv, left alone, looks no further than the first that has the package.
    translated = {"UV_INDEX_STRATEGY": "unsafe-best-match"}
    for name, variables in SINGLE.items():
        if name in settings:
            translated |= dict.fromkeys(variables, settings[name])
    for name, (variable, separator) in SEVERAL.items():
        if name in settings:
            translated[variable] = separator.join(settings[name].split())
    for bundle in ("REQUESTS_CA_BUNDLE", "CURL_CA_BUNDLE"):
        if given.get(bundle):
            translated.setdefault("SSL_CERT_FILE", given[bundle])
    return translated | dict(given)


def options(settings: Mapping[str, str]) -> Iterator[str]:
    """The options of `uv pip install` that pip's settings amount to."""
    for name, option in REPEATED.items():
        yield from (
            f"{option}={value}" for value in settings.get(name, "").replace(",", " ").split()
        )
    for name, option in SWITCHES.items():
        if settings.get(name, "").lower() not in ("", "0", "false", "no", "off", "n", "f"):
            yield option


def main() -> None:
    settings = pip_settings()
    if any(word.startswith("--torch-backend") for word in sys.argv) and settings.keys() & {
        "index-url",
        "no-index",
    }:
        sys.exit(
            "pip is configured to use one index alone, so PyTorch's own index is not asked"
        )
    uv = str(Path(sys.executable).with_name("uv"))
    install = [
        uv,
        "pip",
        "install",
        *([] if "--python" in sys.argv else ["--python", sys.executable]),
    ]
    os.execve(
        uv, [*install, *options(settings), *sys.argv[1:]], environment(settings, os.environ)
    )


if __name__ == "__main__":
    main()
