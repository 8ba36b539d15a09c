"""What the site has beside docs/: pages that are files of the repository's root, with their links
turned to the site's pages (a link to a file that is no page becomes its text); the reference, a
page for each package of the library, made of its docstrings; and formulas as MathML, which
browsers draw by themselves."""

import re
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    "README.md": "readme.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
# Code, in which a dollar is a dollar; formulas in lines of their own, and in text.
PIECES = re.compile(r"(```.*?```|`[^`\n]*`)|\$\$(.+?)\$\$|\$(?=\S)([^$]+?)(?<=\S)\$", re.DOTALL)
LINK = re.compile(r"\[([^\]]+)\]\((?!https?:|#)([^)\s]+)\)")


LIBRARY = ROOT / "src" / "isogal"
NO_REFERENCE = ("isogal.cli", "isogal.paper")
"""Packages that only commands use."""


def on_config(config):
    """Add the pages of the reference to the navigation."""
    pages = [{name: f"api/{name}.md"} for name in packages()]
    next(entry["Reference"] for entry in config.nav if "Reference" in entry).extend(pages)
    return config


def packages():
    """Return the modules of each package of the library, by its name."""
    found = {}
    for init in sorted((LIBRARY / "isogal").rglob("__init__.py")):
        package = ".".join(init.parent.relative_to(LIBRARY).parts)
        modules = sorted(f"{package}.{path.stem}" for path in init.parent.glob("[a-z]*.py"))
        if not package.startswith(NO_REFERENCE):
            found[package] = modules
    return found


def on_files(files, config):
    """Add the pages."""
    for package, modules in packages().items():
        text = "".join(f"::: {name}\n\n" for name in modules)
        head = f"# {package}\n\n::: {package}\n    options: {{show_root_heading: false}}\n\n"
        files.append(File.generated(config, f"api/{package}.md", content=head + text))
    for source, name in PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=LINK.sub(_from_root, text)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Turn links of pages in docs/ to files of the root."""
    if page.file.src_uri.startswith("api/isogal"):
        return markdown
    if page.file.src_uri not in PAGES.values():
        above = "../" * (1 + page.file.src_uri.count("/"))  # the root, as the page has it
        markdown = LINK.sub(lambda found: _from_docs(found, above), markdown)
    return PIECES.sub(_formula, markdown)


def _formula(found):
    code, block, inline = found.groups()
    if code:
        return code
    latex = " ".join((block or inline).split())
    return convert(latex, display="block" if block else "inline")


def _from_root(found):
    text, target = found.groups()
    path, hash_, anchor = target.partition("#")
    if path.startswith("docs/"):
        return f"[{text}]({path.removeprefix('docs/')}{hash_}{anchor})"
    return f"[{text}]({PAGES[path]}{hash_}{anchor})" if path in PAGES else text


def _from_docs(found, above):
    text, target = found.groups()
    path, hash_, anchor = target.partition("#")
    if not path.startswith(above):
        return found[0]
    path = path.removeprefix(above)
    return f"[{text}]({PAGES[path]}{hash_}{anchor})" if path in PAGES else text
