//! Videos, within 8 MiB: their index, and all their frames.
#![no_main]

use std::panic;
use std::sync::Once;

use grimnet_fuzz_targets::{assert_named, file_of};
use grimnet_photo::PhotoLimits;
use grimnet_video::Video;
use libfuzzer_sys::fuzz_target;

const MAX_MEMORY_BYTES: u64 = 8 << 20;

/// A panic of the decoders must only cost a frame: one that is not caught still ends the target. All others end it at once.
fn let_decoders_panic() {
    static SET: Once = Once::new();
    SET.call_once(|| {
        let all = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            let file = info.location().map_or("", |location| location.file());
            if !file.contains("rusty_h26") {
                all(info);
            }
        }));
    });
}

fuzz_target!(|bytes: &[u8]| {
    let_decoders_panic();
    let path = file_of(bytes, "flight_0042.mp4");
    let limits = PhotoLimits::of_memory(MAX_MEMORY_BYTES);
    let frames = match Video::open(&path, &limits).and_then(|video| video.at_rate(60.0)) {
        Ok(frames) => frames,
        Err(error) => return assert_named(&error, "flight_0042.mp4"),
    };
    let expected = frames.len();
    let mut found = 0;
    for frame in frames {
        found += 1;
        assert!(frame.time_s.is_finite());
        match frame.picture {
            Ok(picture) => assert!(picture.width() > 0 && picture.height() > 0),
            Err(error) => assert_named(&error, "flight_0042.mp4"),
        }
    }
    assert_eq!(found, expected);
});
