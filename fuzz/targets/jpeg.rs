//! JPEG: structure, pixels at full and reduced size, and the check of the compressed data, also with tables of another stream.
#![no_main]

use grimnet_jpeg::{Jpeg, JpegSegments, Reduction, check_scans};
use libfuzzer_sys::fuzz_target;

const MAX_PX: u64 = 1 << 20;

fuzz_target!(|bytes: &[u8]| {
    assert!(JpegSegments::new(bytes).count() <= bytes.len());
    let _ = check_scans(None, bytes);
    let (tables, stream) = bytes.split_at(bytes.len() / 2);
    let _ = check_scans(Some(tables), stream);
    let Ok(jpeg) = Jpeg::read(bytes) else { return };
    let (width, height) = jpeg.size_px();
    assert!(jpeg.memory_bytes_per_px() >= 3.0);
    if u64::from(width) * u64::from(height) > MAX_PX {
        return;
    }
    let whole = jpeg.decode();
    if let Ok(decoded) = &whole {
        assert_eq!(decoded.image.dimensions(), (width, height));
    }
    for reduction in [Reduction::Half, Reduction::Quarter, Reduction::Eighth] {
        let reduced = jpeg.decode_reduced(reduction);
        assert!(reduced.is_ok() || whole.is_err());
        if let (Ok(reduced), Ok(whole)) = (&reduced, &whole) {
            let is_reduced = reduced.image.dimensions() == reduction.size_px((width, height));
            assert!(is_reduced || reduced.image.dimensions() == (width, height));
            assert!(reduced.damage.is_none() || whole.damage.is_some());
        }
    }
});
