"""Processes that are forked from one that has used the package, as `multiprocessing` does on Linux."""

import multiprocessing

import grimnet
import pytest

pytestmark = pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="this system cannot fork")

# Without threads of its own the forked process waits for ever.
PATIENCE_S = 120


def in_forked_process(work):
    """What `work` gives in a forked process."""
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=lambda: sender.send(work()))
    process.start()
    try:
        assert receiver.poll(PATIENCE_S), "the forked process hangs"
        return receiver.recv()
    finally:
        process.kill()
        process.join()


def test_a_forked_process_gives_the_same_answers(localizer, photos):
    def answers():
        pictures = [grimnet.read_photo(photo) for photo in photos[:2]]
        first, second = map(grimnet.features, pictures)
        matches = grimnet.match(first, second, max_ratio=0.95)
        fix = localizer.locate(photos[0], heading="unknown")
        return fix.lat_deg, fix.lon_deg, fix.radius95_m, matches.indices.tolist()

    expected = answers()
    assert in_forked_process(answers) == expected
    # One that is forked from a forked one, and this process after it.
    assert in_forked_process(lambda: (answers(), in_forked_process(answers))) == (expected, expected)
    assert answers() == expected


def test_a_build_in_a_forked_process_is_refused(localizer, photos, demo, tmp_path):
    assert localizer.locate(photos[0])

    def build():
        try:
            grimnet.build_pack(demo / "map.tif", tmp_path / "town.grim", gsd_m=0.6)
        except grimnet.GrimnetError as error:
            return str(error)

    assert "spawn" in in_forked_process(build)
    assert not (tmp_path / "town.grim").exists()
