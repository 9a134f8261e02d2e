#!/usr/bin/env python3
"""Fuzzes for hours, target after target in turns, one process a job, and keeps count.

    .ci/fuzz.py --log DIR                  until Ctrl-C
    .ci/fuzz.py --log DIR --minutes 60     for an hour
    .ci/fuzz.py --log DIR --jobs 2         two targets at a time
    .ci/fuzz.py --log DIR --summary        processor time, inputs and findings of each target so far

The targets are the tests of grimnet-fuzz (proptest, inputs with right checksums) and, if cargo-fuzz and a nightly toolchain are
installed, those in fuzz/ (libFuzzer, guided by coverage; its corpus grows in DIR/corpus). Each turn has a new seed. DIR/runs.tsv has a line
for each turn, so that time adds up over runs; DIR/findings has what failed, with the seed or the input that repeats it.
"""

import argparse
import collections
import datetime
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
FIRST_CASES = 200
# What a libFuzzer process may take; an input that takes longer or more is a finding.
RSS_LIMIT_MIB = 2048
TIMEOUT_S = 25
# Its exit status after a signal. It has printed its counts by then.
LIBFUZZER_INTERRUPTED = 72


def proptest_targets(executables):
    """(name, command) of each random test: those that are listed by executables that grimnet-fuzz configures."""
    if executables is None:
        build = ["cargo", "test", "--release", "--workspace", "--locked", "--no-run", "--message-format=json-render-diagnostics"]
        build += [word for name in ("fuzz", "fuzz_sources") for word in ("--test", name)]
        text = subprocess.run(build, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
        executables = []
        for line in text.splitlines():
            message = json.loads(line)
            if message.get("executable") and "test" in message["target"]["kind"]:
                crate = pathlib.Path(message["target"]["src_path"]).parents[1].name
                executables.append((crate, message["executable"]))
    for crate, executable in executables:
        listed = subprocess.run([executable, "--list"], check=True, stdout=subprocess.PIPE, text=True).stdout
        for test in re.findall(r"^(\S+): test$", listed, re.M):
            # Tests of single inputs have names that are sentences.
            if test.count("_") < 4:
                yield f"{crate}/{test}", [executable, "--exact", test, "--test-threads=1"]


def libfuzzer_targets(log):
    """(name, command) of each target in fuzz/, built; nothing if cargo-fuzz is not there."""
    listed = subprocess.run(["cargo", "+nightly", "fuzz", "list"], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    if listed.returncode != 0:
        print("cargo-fuzz or a nightly toolchain is not installed: only the tests of grimnet-fuzz run", file=sys.stderr)
        return
    subprocess.run(["cargo", "+nightly", "fuzz", "build"], cwd=ROOT, check=True)
    host = re.search(r"^host: (\S+)", subprocess.run(["rustc", "-vV"], check=True, stdout=subprocess.PIPE, text=True).stdout, re.M)[1]
    for name in listed.stdout.split():
        corpus = log / "corpus" / name
        corpus.mkdir(parents=True, exist_ok=True)
        yield name, [
            str(ROOT / "fuzz/target" / host / "release" / name),
            str(corpus),
            str(ROOT / "fuzz/corpus" / name),
            f"-dict={ROOT}/fuzz/dictionaries/{name}.dict",
            f"-rss_limit_mb={RSS_LIMIT_MIB}",
            f"-timeout={TIMEOUT_S}",
            # The threads of a service hold memory between inputs, so that each would be followed by a search for leaks.
            "-detect_leaks=0",
            f"-artifact_prefix={log}/findings/{name}-",
            "-print_final_stats=1",
        ]


class Log:
    """The turns so far. Jobs share it."""

    def __init__(self, folder):
        self.folder = folder
        self.lock = threading.Lock()
        (folder / "findings").mkdir(parents=True, exist_ok=True)
        self.path = folder / "runs.tsv"
        self.rows = []
        if self.path.exists():
            self.rows = [line.split("\t") for line in self.path.read_text().splitlines()[1:]]
        else:
            self.path.write_text("ended\tengine\ttarget\tseed\tinputs\tprocessor_s\tresult\n")

    def of(self, engine, target):
        return [row for row in self.rows if row[1:3] == [engine, target]]

    def add(self, *row):
        row = [datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"), *map(str, row)]
        with self.lock, self.path.open("a") as file:
            self.rows.append(row)
            file.write("\t".join(row) + "\n")

    def summary(self):
        sums = collections.defaultdict(lambda: [0, 0, 0.0, 0])
        for _, engine, target, _, inputs, seconds, result in self.rows:
            entry = sums[engine, target]
            entry[0] += 1
            entry[1] += int(inputs)
            entry[2] += float(seconds)
            entry[3] += result != "passed"
        print(f"{'engine':<10}{'target':<34}{'turns':>7}{'inputs':>14}{'minutes':>10}{'findings':>10}")
        for (engine, target), (turns, inputs, seconds, findings) in sorted(sums.items()):
            print(f"{engine:<10}{target:<34}{turns:>7}{inputs:>14,}{seconds / 60:>10.1f}{findings:>10}")
        turns, inputs, seconds, findings = (sum(entry[i] for entry in sums.values()) for i in range(4))
        print(f"{'':<10}{'all':<34}{turns:>7}{inputs:>14,}{seconds / 60:>10.1f}{findings:>10}")


# Processes that run now.
running = set()


def run(command, environment):
    """Output, exit status and processor time of a process, at the lowest priority."""
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(
            ["nice", "-n", "19", *command], env={**os.environ, **environment}, stdout=output, stderr=subprocess.STDOUT
        )
        running.add(process)
        _, status, usage = os.wait4(process.pid, 0)
        running.discard(process)
        process.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        text = output.read().decode(errors="replace")
    return text, process.returncode, usage.ru_utime + usage.ru_stime


def turn(log, engine, target, command, seconds):
    """One turn of a target: as many inputs as fit into the time, by what earlier turns took."""
    earlier = log.of(engine, target)
    seed = 1 + max((int(row[3]) for row in earlier), default=0)
    if engine == "proptest":
        inputs, took = (sum(float(row[i]) for row in earlier) for i in (4, 5))
        # Ten times as many as ever before at most: the first turns are too short to tell the rate.
        most = 10 * max((int(row[4]) for row in earlier), default=FIRST_CASES // 10)
        cases = min(most, max(1, int(seconds * inputs / max(took, 1e-3)))) if earlier else FIRST_CASES
        environment = {"PROPTEST_CASES": str(cases), "PROPTEST_RNG_SEED": str(seed), "RAYON_NUM_THREADS": "1"}
        output, status, took = run(command, environment)
    else:
        output, status, took = run([*command, f"-seed={seed}", f"-max_total_time={seconds}"], {"RAYON_NUM_THREADS": "1"})
        found = re.search(r"stat::number_of_executed_units:\s*(\d+)", output)
        cases = int(found[1]) if found else 0
    if status in (-signal.SIGINT, -signal.SIGTERM, 130):
        return
    if status == LIBFUZZER_INTERRUPTED:
        status = 0
    if status != 0:
        (log.folder / "findings" / f"{target.replace('/', '-')}-seed{seed}.txt").write_text(output[-40000:])
    log.add(engine, target, seed, cases, f"{took:.1f}", "passed" if status == 0 else f"exit status {status}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--log", type=pathlib.Path, required=True, metavar="DIR", help="folder of the log, the findings and the corpus")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="end after so many minutes")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="targets at a time")
    parser.add_argument("--turn", type=int, default=120, metavar="S", help="seconds of a turn")
    parser.add_argument("--engine", choices=["proptest", "libfuzzer"], help="only this one")
    parser.add_argument("--executables", nargs="*", metavar="CRATE=FILE", help="built tests, instead of building them")
    parser.add_argument("--summary", action="store_true", help="print what was run so far")
    arguments = parser.parse_args()
    log = Log(arguments.log.resolve())
    if arguments.summary:
        log.summary()
        return
    targets = []
    if arguments.engine != "libfuzzer":
        given = arguments.executables and [text.split("=", 1) for text in arguments.executables]
        targets += [("proptest", *target) for target in proptest_targets(given)]
    if arguments.engine != "proptest" and shutil.which("cargo"):
        targets += [("libfuzzer", *target) for target in libfuzzer_targets(log.folder)]
    end = time.monotonic() + 60 * arguments.minutes
    waiting, lock, stopped = list(targets), threading.Lock(), threading.Event()

    def job():
        while not stopped.is_set() and time.monotonic() < end:
            with lock:
                # Of the targets that no other job runs, the one that had the least time.
                target = min(waiting, key=lambda t: sum(float(row[5]) for row in log.of(*t[:2])))
                waiting.remove(target)
            turn(log, *target, arguments.turn)
            with lock:
                waiting.append(target)

    jobs = [threading.Thread(target=job) for _ in range(min(arguments.jobs, len(targets)))]
    # The processes that are running end with this one.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    for thread in jobs:
        thread.start()
    try:
        for thread in jobs:
            thread.join()
    except KeyboardInterrupt:
        stopped.set()
        for process in set(running):
            os.kill(process.pid, signal.SIGTERM)
        for thread in jobs:
            thread.join()
    log.summary()


main()
