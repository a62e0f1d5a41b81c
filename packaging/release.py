"""Fill in what only a release knows: the addresses of the project, and the archive that conda-forge builds from.

    python packaging/release.py addresses https://github.com/OWNER/NAME   before `make dist`
    python packaging/release.py recipe dist/*.tar.gz                      afterwards; writes recipe.yaml beside it

The addresses are those of the repository that the release workflow runs in, so that no owner stands in the sources.
"""

import hashlib
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
REPOSITORY = re.compile(r"https://[^/\s]+/([\w.-]+)/([\w.-]+)")
PYPI = "https://pypi.org/packages/source/e/echelon-robotics/{file}"


def write_addresses(address: str) -> None:
    """Put the addresses into the metadata of package, recipe and citation, which have none yet."""
    named = REPOSITORY.fullmatch(address)
    if not named:
        sys.exit(
            f"'{address}' is no address of a repository; it is like https://github.com/OWNER/NAME"
        )
    site = f"https://{named[1].lower()}.github.io/{named[2]}/"
    urls = {"Documentation": site, "Source": address, "Issues": f"{address}/issues"}
    urls["Changelog"] = f"{site}changelog.html"
    lines = "".join(f'{name} = "{url}"\n' for name, url in urls.items())
    _insert(
        ROOT / "pyproject.toml",
        f"[project.urls]\n{lines}\n",
        before="[project.scripts]",
    )
    _insert(
        ROOT / "CITATION.cff",
        f"repository-code: {address}\nurl: {site}\n",
        before="keywords:",
    )
    version = ROOT / "src/echelon/shared/version.py"
    text = version.read_text(encoding="utf-8")
    text = text.replace('DOCUMENTATION = ""', f'DOCUMENTATION = "{site}"')
    version.write_text(text, encoding="utf-8")
    _make_links_absolute(ROOT / "README.md", address)
    about = f"  homepage: {site}\n  repository: {address}\n"
    _insert(ROOT / "packaging/recipe.yaml", about, before="  license_file:")


def _make_links_absolute(file: Path, address: str) -> None:
    """Links between files of the repository work on the package index, too."""
    text = file.read_text(encoding="utf-8")
    text = text.replace(
        "git clone URL echelon && cd echelon                # URL: the address of this repository",
        f"git clone {address} echelon && cd echelon",
    )
    for kind, mark in (("raw", r"(?<=!)"), ("blob", r"(?<!!)")):
        link = re.compile(mark + r"(\[[^\]]*\])\((?!https?:|#)([^)\s]+)\)")
        text = link.sub(rf"\1({address}/{kind}/HEAD/\2)", text)
    file.write_text(text, encoding="utf-8")


def _insert(file: Path, text: str, before: str) -> None:
    found = file.read_text(encoding="utf-8")
    if text not in found:
        file.write_text(found.replace(before, text + before, 1), encoding="utf-8")


def write_recipe(archive: Path) -> None:
    """The recipe with the address and the digest that the source distribution has on the package index."""
    digest = hashlib.sha256(archive.read_bytes()).hexdigest()
    version = archive.name.removesuffix(".tar.gz").rpartition("-")[2]
    text = (ROOT / "packaging/recipe.yaml").read_text(encoding="utf-8")
    text = re.sub(r'(?<=^  version: )".*"', f'"{version}"', text, flags=re.MULTILINE)
    source = f"  url: {PYPI.format(file=archive.name)}\n  sha256: {digest}\n"
    text = re.sub(r"^  path: .*\n", source, text, flags=re.MULTILINE)
    archive.with_name("recipe.yaml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["addresses", address]:
            write_addresses(address)
        case ["recipe", archive]:
            write_recipe(Path(archive))
        case _:
            sys.exit(__doc__)
