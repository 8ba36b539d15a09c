"""Runs the uv beside this interpreter with the package indexes that pip is configured to use.

uv reads neither pip's configuration files nor the variables PIP_*. What they say of indexes and
of the connection is passed on in uv's own variables; those that are set already stand.

    .venv/bin/python .ci/uv.py pip install --requirement requirements.lock
"""

import ast
import os
import subprocess
import sys
import sysconfig
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import unquote, urlsplit

TRUE = ("1", "true", "yes", "on")

# pip's option -> the variable that tells uv the same. Options of several words hold lists.
INDEX, MORE_INDEXES, FILES = "index-url", "extra-index-url", "find-links"
SAME = {
    "timeout": "UV_HTTP_TIMEOUT",
    "default-timeout": "UV_HTTP_TIMEOUT",
    "trusted-host": "UV_INSECURE_HOST",
    "cert": "SSL_CERT_FILE",
    "client-cert": "SSL_CLIENT_CERT",
    "proxy": "ALL_PROXY",
}


def pip_options(listing: str) -> dict[str, str]:
    """Return the options that hold for ``pip install``.

    Parameters
    ----------
    listing
        What ``pip config list`` prints: a line ``section.option='value'`` for each. ``global`` is
        for all commands, ``install`` overrides it, the variables PIP_* (``:env:``) override both.
    """
    sections: dict[str, dict[str, str]] = {"global": {}, "install": {}, ":env:": {}}
    for line in listing.splitlines():
        key, _, value = line.partition("=")
        section, _, option = key.rpartition(".")
        if section in sections:
            sections[section][option] = str(ast.literal_eval(value))
    return {key: value for section in sections.values() for key, value in section.items()}


def reachable(location: str) -> bool:
    """Tell whether this is no local folder, or one that exists: pip skips others, uv gives up."""
    parts = urlsplit(location)
    if parts.scheme not in ("", "file"):
        return True
    return Path(unquote(parts.path)).expanduser().exists()


def uv_variables(options: Mapping[str, str]) -> dict[str, str]:
    """Return the variables that make uv look for packages where pip with these options does.

    Raises
    ------
    ValueError
        If pip is told what uv has no variable for.
    """
    if options.get("no-index", "").lower() in TRUE:
        raise ValueError("pip's option no-index")
    # As pip does: the best version of any index, not only of the first that has the package.
    variables = {"UV_INDEX_STRATEGY": "unsafe-best-match"}
    lists = {
        option: [word for word in options.get(option, "").split() if reachable(word)]
        for option in (INDEX, MORE_INDEXES, FILES)
    }
    variables["UV_DEFAULT_INDEX"] = " ".join(lists[INDEX])
    variables["UV_INDEX"] = " ".join(lists[MORE_INDEXES])
    variables["UV_FIND_LINKS"] = ",".join(lists[FILES])
    variables["UV_NO_CACHE"] = "1" if options.get("no-cache-dir", "").lower() in TRUE else ""
    for option, name in SAME.items():
        variables[name] = " ".join(options.get(option, variables.get(name, "")).split())
    return {name: value for name, value in variables.items() if value}


def main() -> None:
    """Become uv, with the arguments of this program."""
    pip_config_list = [sys.executable, "-m", "pip", "config", "list"]
    listing = subprocess.run(pip_config_list, stdout=subprocess.PIPE, text=True, check=True)
    uv = str(Path(sysconfig.get_path("scripts")) / "uv")
    try:
        os.environ.update(uv_variables(pip_options(listing.stdout)) | os.environ)
        os.execv(uv, [uv, *sys.argv[1:]])
    except (ValueError, OSError) as error:
        sys.exit(f"isogal: no uv: {error}")


if __name__ == "__main__":
    main()
