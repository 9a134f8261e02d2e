#!/usr/bin/env python3
"""Lists dependencies that no source file names, and workspace dependencies that no crate takes.

A normal dependency must be named in src/ outside unit tests; a dev-dependency in unit tests, tests/, benches/, examples/ or a
documentation example; a build dependency in build.rs. Exits with 1 if there are any.
Usage: .ci/unused_dependencies.py (in the root of the workspace)
"""

import json
import pathlib
import re
import subprocess
import sys
import tomllib


def rust_files(folder):
    return sorted(folder.rglob("*.rs")) if folder.is_dir() else []


def without_comments(text):
    return re.sub(r"//.*", "", text)


def main():
    rustc = subprocess.run(["rustc", "-vV"], check=True, stdout=subprocess.PIPE, text=True).stdout
    host = re.search(r"^host: (.*)$", rustc, re.M).group(1)
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", host]
    metadata = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    # A library's name in code can differ from its package's: kamadak-exif is `exif`.
    library_names = {
        (package["name"]): target["name"].replace("-", "_")
        for package in metadata["packages"]
        for target in package["targets"]
        if {"lib", "rlib", "proc-macro"} & set(target["kind"])
    }
    members = [p for p in metadata["packages"] if p["id"] in metadata["workspace_members"]]
    findings, taken = [], set()
    for package in members:
        root = pathlib.Path(package["manifest_path"]).parent
        product, tests = "", ""
        for path in rust_files(root / "src"):
            text = path.read_text()
            code, _, unit_tests = text.partition("#[cfg(test)]\nmod ")
            product += without_comments(code)
            tests += unit_tests + "\n".join(re.findall(r"^\s*//[/!].*", code, re.M))
            if path.name.startswith("test_") or path.stem.endswith("tests"):
                tests += text
        for folder in ("tests", "benches", "examples"):
            tests += "".join(path.read_text() for path in rust_files(root / folder))
        for path in (root / "README.md",):
            tests += path.read_text() if path.exists() else ""
        build = (root / "build.rs").read_text() if (root / "build.rs").exists() else ""
        optional = {d["name"] for d in package["dependencies"] if d["optional"]}
        for dependency in package["dependencies"]:
            taken.add(dependency["name"])
            name = dependency["rename"] or library_names.get(dependency["name"], dependency["name"])
            name = name.replace("-", "_")
            where = {None: product, "dev": tests, "build": build}[dependency["kind"]]
            if dependency["kind"] == "dev" and dependency["name"] in optional:
                # Unit tests use modules that a feature adds for others.
                where += product
            if not re.search(rf"\b{re.escape(name)}\b", where):
                kind = dependency["kind"] or "normal"
                findings.append(f"{package['name']}: {dependency['name']} ({kind} dependency) is not used")
    workspace = tomllib.loads(pathlib.Path("Cargo.toml").read_text())["workspace"]
    for name, value in workspace.get("dependencies", {}).items():
        package_name = value.get("package", name) if isinstance(value, dict) else name
        if package_name not in taken and package_name not in {m["name"] for m in members}:
            findings.append(f"Cargo.toml: {name} is in workspace.dependencies, and no crate takes it")
    print("\n".join(findings) if findings else "every dependency is used")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
