#!/usr/bin/env python3
"""Packages every crate that is published, compiles them from the packages alone, and checks metadata, contents and size.

Cargo packages crates of one workspace that depend on each other in dependency order, as if the earlier ones were in the
registry already. Its own verification would build every dependency once for each crate; here all crates are checked together,
and those that users name, the program and the library, by themselves as well, with no more features than they ask for.
Exits with 1 if a package is incomplete or larger than the registry accepts.
Usage: .ci/package.py [--no-verify] (in the root of the workspace)
"""

import json
import pathlib
import re
import shutil
import subprocess
import sys
import tarfile

# The registry refuses larger files.
MAX_BYTES = 10 * 1024 * 1024
METADATA = ("description", "keywords", "categories", "license", "readme", "repository", "rust_version")
FILES = ("Cargo.toml", "README.md", "LICENSE-MIT", "LICENSE-APACHE")
# What users install and depend on.
CHECKED_ALONE = ("grimnet-cli", "grimnet")


def main():
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--no-deps"]
    metadata = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    # `publish = false` is an empty list of registries.
    published = [p for p in metadata["packages"] if p["publish"] != []]
    names = {package["name"] for package in published}
    findings = []
    for package in published:
        findings += [f"{package['name']}: no {key} in Cargo.toml" for key in METADATA if not package[key]]
        for dependency in package["dependencies"]:
            if "path" in dependency and dependency["kind"] != "dev" and dependency["name"] not in names:
                findings.append(f"{package['name']}: depends on {dependency['name']}, which is not published")
    if findings:
        print("\n".join(findings))
        return 1

    command = ["cargo", "package", "--workspace", "--locked", "--allow-dirty", "--no-verify"]
    for package in metadata["packages"]:
        if package["publish"] == []:
            command += ["--exclude", package["name"]]
    target = pathlib.Path(metadata["target_directory"])
    subprocess.run(command, check=True)
    if "--no-verify" not in sys.argv[1:]:
        check_from_packages(published, target)

    folder = target / "package"
    for package in sorted(published, key=lambda package: package["name"]):
        stem = f"{package['name']}-{package['version']}"
        path = folder / f"{stem}.crate"
        size = path.stat().st_size
        with tarfile.open(path) as archive:
            held = {member.name for member in archive if member.isfile()}
        findings += [f"{package['name']}: no {file} in the package" for file in FILES if f"{stem}/{file}" not in held]
        note = ""
        if size > MAX_BYTES:
            note = f"  larger than {MAX_BYTES // 1024} KiB"
            findings.append(f"{package['name']}: {size // 1024} KiB{note}")
        print(f"{package['name']:24} {size // 1024:7} KiB{note}")
    print("\n".join(findings) if findings else f"{len(published)} packages are complete")
    return 1 if findings else 0


def check_from_packages(published, target):
    """Compiles the packages in a workspace of the unpacked ones."""
    root = target / "package" / "unpacked"
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir(parents=True)
    stems = {package["name"]: f"{package['name']}-{package['version']}" for package in published}
    for stem in stems.values():
        with tarfile.open(target / "package" / f"{stem}.crate") as archive:
            archive.extractall(root, filter="data")
    # The profile of the repository: what the lints checked of other crates is used again.
    profile = re.search(r"^\[profile\.release\]\n[^\[]*", pathlib.Path("Cargo.toml").read_text(), re.M).group()
    manifest = ["[workspace]", 'resolver = "3"', f"members = {json.dumps(list(stems.values()))}", profile, "[patch.crates-io]"]
    manifest += [f'{name} = {{ path = "{stem}" }}' for name, stem in stems.items()]
    (root / "Cargo.toml").write_text("\n".join(manifest) + "\n")
    # The same versions; entries of crates that are not published go.
    shutil.copy("Cargo.lock", root)
    command = ["cargo", "check", "--release", "--offline", "--manifest-path", root / "Cargo.toml", "--target-dir", target]
    subprocess.run([*command, "--workspace"], check=True)
    for name in CHECKED_ALONE:
        subprocess.run([*command, "-p", name], check=True)


if __name__ == "__main__":
    sys.exit(main())
