#!/usr/bin/env python3
"""Writes a software bill of materials of the program `grim` (CycloneDX 1.6, JSON) to standard output.

It lists what a build links or runs, with licences, checksums of the registry's packages, and who depends on
whom. Two runs on one checkout give the same bytes.
Usage: .ci/sbom.py [--features train] [--target x86_64-unknown-linux-musl] > grim.cdx.json
"""

import argparse
import json
import re
import subprocess
import sys
import tomllib

PACKAGE = "grimnet-cli"


def run(*command):
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def host():
    return re.search(r"^host: (.*)$", run("rustc", "-vV"), re.M).group(1)


def dependency_graph(options):
    """(name, version) of each package -> those that it depends on, and the root."""
    text = run(
        "cargo", "tree", "--locked", "--package", PACKAGE, "--edges", "normal,build",
        "--prefix", "depth", "--format", " {p}", *options,
    )  # fmt: skip
    graph, path = {}, []
    for line in text.splitlines():
        depth, name, version = line.split()[:3]
        package = (name, version.removeprefix("v"))
        del path[int(depth) :]
        if path:
            graph[path[-1]].add(package)
        # Below a package that was listed before, nothing is listed again.
        graph.setdefault(package, set())
        path.append(package)
    return graph, next(iter(graph))


def purl(package):
    return "pkg:cargo/{}@{}".format(*package).replace("+", "%2B")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--target", default=host(), help="platform of the build (this machine's if not given)")
    parser.add_argument("--features", default="", help="features of the program")
    arguments = parser.parse_args()
    graph, root = dependency_graph(["--target", arguments.target, "--features", arguments.features])
    features = [f"{PACKAGE}/{feature}" for feature in arguments.features.replace(",", " ").split()]
    metadata = json.loads(
        run(
            "cargo", "metadata", "--format-version", "1", "--locked", "--features", " ".join(features),
            "--filter-platform", arguments.target, "--filter-platform", host(),
        )  # fmt: skip
    )
    described = {(package["name"], package["version"]): package for package in metadata["packages"]}
    with open("Cargo.lock", "rb") as file:
        locked = {(p["name"], p["version"]): p for p in tomllib.load(file)["package"]}

    def component(package):
        about = described[package]
        entry = {
            "type": "application" if package == root else "library",
            "bom-ref": purl(package),
            "name": package[0],
            "version": package[1],
            "description": " ".join((about["description"] or "").split()),
            "purl": purl(package),
        }
        if about["license"]:
            # Older packages write "/" for OR.
            entry["licenses"] = [{"expression": about["license"].replace("/", " OR ").replace("  ", " ")}]
        if "checksum" in locked[package]:
            entry["hashes"] = [{"alg": "SHA-256", "content": locked[package]["checksum"]}]
        if about["repository"]:
            entry["externalReferences"] = [{"type": "vcs", "url": about["repository"]}]
        return entry

    bill = {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": component(root)},
        "components": [component(package) for package in sorted(graph) if package != root],
        "dependencies": [
            {"ref": purl(package), "dependsOn": sorted(purl(other) for other in others)}
            for package, others in sorted(graph.items())
        ],
    }
    json.dump(bill, sys.stdout, indent=2, ensure_ascii=False)
    print()


if __name__ == "__main__":
    main()
