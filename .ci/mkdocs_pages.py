"""Pages of the site that are files of the repository's root, with their links turned to the
site's pages (a link to a file that is no page becomes its text), and formulas as MathML, which
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


def on_files(files, config):
    """Add the pages."""
    for source, name in PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=LINK.sub(_from_root, text)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Turn links of pages in docs/ to files of the root."""
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
