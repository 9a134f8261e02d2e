#!/usr/bin/env python3
"""Lists import circles between the files of each crate, parents and children included. Exits with 1 if there are any.

Two files are in one circle if each reaches the other over `use crate::...`, `use super::...` and `use self::...`
declarations outside unit tests: the strongly connected components of the import graph. What both sides need belongs into a
file below both.
Usage: .ci/import_circles.py (in the root of the workspace)
"""

import pathlib
import re
import sys


def module_of(source, folder):
    """The path of the module that a file holds, `()` for the root of the crate."""
    parts = list(source.relative_to(folder).with_suffix("").parts)
    if parts[-1] == "mod":
        parts.pop()
    return () if parts in (["lib"], ["main"]) else tuple(parts)


def without_tests_and_comments(text):
    text = re.sub(r"//[^\n]*", "", text)
    return re.split(r"#\[cfg\(test\)\]\s*mod\s+\w+\s*\{", text)[0]


def split_at_commas(text):
    """The parts of a list between braces, split at the commas outside inner braces."""
    depth, part = 0, ""
    for character in text + ",":
        if character == "," and depth == 0:
            if part.strip():
                yield part.strip()
            part = ""
        else:
            depth += {"{": 1, "}": -1}.get(character, 0)
            part += character


def paths_of(tree):
    """Each path in the tree of one `use` declaration, as a list of names."""
    head, brace, rest = tree.strip().partition("{")
    names = [name for name in re.sub(r"\bas\s+\w+", "", head).replace(" ", "").split("::") if name]
    if not brace:
        yield names
        return
    for part in split_at_commas(rest[: rest.rfind("}")]):
        for tail in paths_of(part):
            yield names + tail


def imports(module, text, modules):
    """The modules that a file imports from."""
    for tree in re.findall(r"\buse\s+((?:crate|super|self)\b[^;]*);", text):
        for path in paths_of(tree):
            target = [] if path[0] == "crate" else list(module)
            for position, name in enumerate(path):
                if name == "super":
                    target.pop()
                elif name not in ("crate", "self"):
                    target += path[position:]
                    break
            while target and tuple(target) not in modules:
                target.pop()
            # What the root of the crate re-exports is not an import of the root itself.
            if target and tuple(target) != module:
                yield tuple(target)


def components(graph):
    """Strongly connected components with more than one member, after Tarjan (1972), without recursion."""
    index, low, stack, found = {}, {}, [], []
    for start in graph:
        if start in index:
            continue
        index[start] = low[start] = len(index)
        stack.append(start)
        work = [(start, iter(sorted(graph[start])))]
        while work:
            node, edges = work[-1]
            for target in edges:
                if target not in index:
                    index[target] = low[target] = len(index)
                    stack.append(target)
                    work.append((target, iter(sorted(graph[target]))))
                    break
                if target in stack:
                    low[node] = min(low[node], index[target])
            else:
                work.pop()
                if work:
                    parent = work[-1][0]
                    low[parent] = min(low[parent], low[node])
                if low[node] == index[node]:
                    cut = stack.index(node)
                    if len(stack) - cut > 1:
                        found.append(stack[cut:])
                    del stack[cut:]
    return found


def main():
    count = 0
    for folder in sorted(pathlib.Path("crates").glob("*/src")):
        files = {module_of(path, folder): path.read_text() for path in folder.rglob("*.rs")}
        graph = {
            module: set(imports(module, without_tests_and_comments(text), files))
            for module, text in files.items()
            if module
        }
        for component in components(graph):
            names = sorted("/".join(module) for module in component)
            print(f"{folder.parent.name}: {' '.join(names)}")
            count += 1
    print(f"{count} import circles")
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
