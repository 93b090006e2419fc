"""The arrows between the files of each Rust package: no circles, and no file imports what the
mod.rs of a folder above it defines (re-exports count as imports of the file that defines the
item)."""

import re
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = sorted(
    path.parent for path in [ROOT / "Cargo.toml", ROOT / "cli/Cargo.toml", *ROOT.glob("crates/*/Cargo.toml")]
)
DEFINITION = re.compile(
    r"^(?:pub +)?(?:default +|const +|async +|unsafe +|extern +\"C\" +)*"
    r"(?:fn|struct|enum|trait|union|const|static|type|macro_rules!) +(?:mut +)?(\w+)",
    re.M,
)
COMMENT_OR_STRING = re.compile(r'//[^\n]*|/\*.*?\*/|r(#*)".*?"\1|"(?:\\.|[^"\\])*"|\'(?:\\.|[^\'\\])\'', re.S)
VISIBILITY = re.compile(r"\bpub *\([^)]*\)")
TEST = re.compile(
    r"#\[cfg\((?:test|all\(test\b[^\]]*)\)\]\s*(?:#\[[^\]]*\]\s*)*(?:pub +)?(?:mod +\w+ *\{|mod +\w+;|use [^;]*;)"
)
INLINE_MODULE = re.compile(r"\bmod +\w+ *\{")

Name = tuple[str, ...]  # of a module, from the root of the package


def package_name(package: Path) -> str:
    return "liveview" if package == ROOT else package.name


@dataclass
class Module:
    """A file: its child modules, the items it defines, the names it imports, and the paths
    in its code."""

    path: Path
    children: set[str] = field(default_factory=set)
    defined: set[str] = field(default_factory=set)
    imported: dict[str, Name] = field(default_factory=dict)  # name -> path as written
    globs: list[Name] = field(default_factory=list)
    paths: list[Name] = field(default_factory=list)


def code_of(path: Path) -> str:
    """The source without comments, strings, visibilities and tests. `super` in an inline module is
    the file itself."""
    text = VISIBILITY.sub("pub", COMMENT_OR_STRING.sub('""', path.read_text()))
    while test := TEST.search(text):
        text = text[: test.start()] + text[end_of_block(text, test) :]
    for inline in INLINE_MODULE.finditer(text):
        start, end = inline.end(), end_of_block(text, inline)
        text = text[:start] + re.sub(r"\bsuper::", "self:: ", text[start:end]) + text[end:]
    return text


def end_of_block(text: str, start: re.Match) -> int:
    """The end of the block that the last brace of a match opens, or of the match without a
    brace."""
    at, depth = start.end(), int(start.group().endswith("{"))
    while depth:
        depth += {"{": 1, "}": -1}.get(text[at], 0)
        at += 1
    return at


def expanded(tree: str, prefix: Name = ()):
    """(path, name it is imported as, or None for a glob) of every leaf of a use tree."""
    tree = tree.strip()
    if "{" in tree:
        head, body = tree[: tree.index("{")], tree[tree.index("{") + 1 : tree.rindex("}")]
        prefix += tuple(part.strip() for part in head.split("::") if part.strip())
        depth, start = 0, 0
        for i, c in enumerate(body + ","):
            depth += {"{": 1, "}": -1}.get(c, 0)
            if c == "," and depth == 0:
                if body[start:i].strip():
                    yield from expanded(body[start:i], prefix)
                start = i + 1
        return
    path, _, name = (part.strip() for part in tree.partition(" as "))
    parts = prefix + tuple(part.strip() for part in path.split("::"))
    if parts[-1] == "*":
        yield parts[:-1], None
    elif parts[-1] == "self":
        yield parts[:-1], name or parts[-2]
    else:
        yield parts, name or parts[-1]


def read(path: Path) -> Module:
    module, text = Module(path), code_of(path)
    module.children = set(re.findall(r"^ *(?:pub +)?mod +(\w+);", text, re.M))
    module.defined = set(DEFINITION.findall(text))
    for tree in re.findall(r"\buse +([^;]+);", text):
        for parts, name in expanded(tree):
            module.paths.append(parts)
            if name is None:
                module.globs.append(parts)
            else:
                module.imported[name] = parts
    rest = re.sub(r"\buse +[^;]+;", "", text)
    module.paths += [tuple(found.split("::")) for found in re.findall(r"\b(?:crate|super)(?:::\w+)+", rest)]
    return module


def modules_of(package: Path) -> dict[Name, Module]:
    """Every file of a package that is a module of its library or program, without tests."""
    source = package / "src"
    root = next(path for path in (source / "lib.rs", source / "main.rs") if path.exists())
    found, queue = {}, [((), root, source)]
    while queue:
        name, path, folder = queue.pop()
        found[name] = read(path)
        for child in found[name].children:
            file, inner = folder / f"{child}.rs", folder / child
            queue.append(((*name, child), file if file.exists() else inner / "mod.rs", inner))
    return found


def resolved(modules: dict[Name, Module], here: Name, parts: Name, seen: frozenset = frozenset()) -> Name | None:
    """The module that defines what a path in the module `here` names; None outside the package."""
    if (here, parts) in seen:
        return None
    seen |= {(here, parts)}
    at, rest = here, list(parts)
    if rest[0] == "crate":
        at, rest = (), rest[1:]
    elif rest[0] in ("self", "super"):
        while rest and rest[0] in ("self", "super"):
            at, rest = (at[:-1] if rest[0] == "super" else at), rest[1:]
    elif rest[0] not in modules[here].children:
        return None
    for i, part in enumerate(rest):
        module = modules[at]
        if part in module.children:
            at = (*at, part)
        elif part in module.defined:
            return at
        elif part in module.imported:
            return resolved(modules, at, (*module.imported[part], *rest[i + 1 :]), seen)
        else:
            candidates = (resolved(modules, at, (*glob, *rest[i:]), seen) for glob in module.globs)
            return next((found for found in candidates if found is not None), None)
    return at


def edges_of(modules: dict[Name, Module]) -> dict[Name, set[Name]]:
    return {
        name: {found for parts in module.paths if (found := resolved(modules, name, parts)) not in (None, name)}
        for name, module in modules.items()
    }


def shown(modules: dict[Name, Module], names) -> str:
    return " -> ".join(str(modules[name].path.relative_to(ROOT)) for name in names)


@pytest.mark.parametrize("package", PACKAGES, ids=package_name)
def test_files_of_a_package_have_no_circles(package):
    modules = modules_of(package)
    # What a mod.rs re-exports is an arrow between the file that uses it and the one that defines
    # it.
    edges = {
        name: {other for other in others if not (modules[name].children and other[: len(name)] == name)}
        for name, others in edges_of(modules).items()
    }
    try:
        tuple(TopologicalSorter(edges).static_order())
    except CycleError as error:
        pytest.fail(f"circle: {shown(modules, reversed(error.args[1]))}")


@pytest.mark.parametrize("package", PACKAGES, ids=package_name)
def test_no_file_imports_what_a_mod_rs_above_it_defines(package):
    modules = modules_of(package)
    upward = [
        shown(modules, (name, other))
        for name, others in edges_of(modules).items()
        for other in others
        if len(other) < len(name) and name[: len(other)] == other
    ]
    assert not upward, "\n".join(sorted(upward))


def test_paths_are_resolved_to_the_files_that_define_them(tmp_path):
    source = tmp_path / "src"
    (source / "a").mkdir(parents=True)
    (source / "lib.rs").write_text("pub mod a;\nmod b;\npub use a::Deep;\nconst LIMIT: u32 = 1;\n")
    (source / "a" / "mod.rs").write_text("mod deep;\npub use deep::*;\npub fn own() {}\n")
    (source / "a" / "deep.rs").write_text(
        "use crate::b;\npub(in crate::a) struct Deep;\n// use super::own;\nconst OPEN: char = '{';\n"
        "#[cfg(test)]\nmod tests { use super::super::own; }\n"
        "#[cfg(all(test, unix))]\nmod more { fn f() { super::super::own(); } }\n"
        "mod inline { use super::Deep; }\n"
    )
    (source / "b.rs").write_text("use crate::{LIMIT, a::{self, own}, Deep as D};\nfn f() { a::own(); }\n")
    edges = edges_of(modules_of(tmp_path))
    assert edges["b",] == {(), ("a",), ("a", "deep")}
    assert edges["a", "deep"] == {("b",)}
