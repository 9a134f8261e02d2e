//! Values of MISB ST 0601: integers that stand for a range.

/// An unsigned integer of up to 8 bytes, most significant first.
pub(super) fn unsigned(bytes: &[u8]) -> Option<u64> {
    if bytes.is_empty() || bytes.len() > 8 {
        return None;
    }
    Some(
        bytes
            .iter()
            .fold(0, |value, byte| value << 8 | u64::from(*byte)),
    )
}

/// An unsigned integer of `length` bytes that stands for `lowest` to `highest`.
pub(super) fn scaled_unsigned(
    bytes: &[u8],
    length: usize,
    lowest: f64,
    highest: f64,
) -> Option<f64> {
    if bytes.len() != length {
        return None;
    }
    let most = (1u128 << (8 * length)) - 1;
    Some(lowest + unsigned(bytes)? as f64 * (highest - lowest) / most as f64)
}

/// A signed integer of `length` bytes that stands for -`highest` to `highest`. The lowest one means out of range.
pub(super) fn scaled_signed(bytes: &[u8], length: usize, highest: f64) -> Option<f64> {
    if bytes.len() != length {
        return None;
    }
    let bits = 8 * u32::try_from(length).ok()?;
    let value = (unsigned(bytes)? << (64 - bits)) as i64 >> (64 - bits);
    let most = (1i64 << (bits - 1)) - 1;
    (value >= -most).then(|| value as f64 * highest / most as f64)
}

/// A length as BER has it, and what follows.
pub(super) fn ber_length(bytes: &[u8]) -> Option<(usize, &[u8])> {
    let (&first, rest) = bytes.split_first()?;
    if first < 0x80 {
        return Some((usize::from(first), rest));
    }
    let count = usize::from(first & 0x7f);
    let length = unsigned(rest.get(..count)?)?;
    Some((usize::try_from(length).ok()?, &rest[count..]))
}

/// A tag as BER-OID has it, and what follows.
pub(super) fn ber_oid(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let mut tag = 0u32;
    // ST 0601 has tags below 2^14.
    for (at, &byte) in bytes.iter().take(2).enumerate() {
        tag = tag << 7 | u32::from(byte & 0x7f);
        if byte < 0x80 {
            return Some((tag, &bytes[at + 1..]));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_those_of_the_standard() {
        // Examples of ST 0601.8: tags 5, 6, 15, 18, 19.
        let near = |value: Option<f64>, expected: f64| (value.unwrap() - expected).abs() < 1e-4;
        assert!(near(
            scaled_unsigned(&[0x71, 0xc2], 2, 0.0, 360.0),
            159.974_36
        ));
        assert!(near(scaled_signed(&[0xfd, 0x3d], 2, 20.0), -0.431_531_7));
        assert!(near(
            scaled_unsigned(&[0xc2, 0x21], 2, -900.0, 19_000.0),
            14_190.719_5
        ));
        assert!(near(
            scaled_unsigned(&[0x72, 0x4a, 0x0a, 0x20], 4, 0.0, 360.0),
            160.719_211
        ));
        assert!(near(
            scaled_signed(&[0x87, 0xf8, 0x4b, 0x86], 4, 180.0),
            -168.792_324
        ));
        assert_eq!(scaled_signed(&[0x80, 0x00], 2, 20.0), None);
        assert_eq!(scaled_unsigned(&[1], 2, 0.0, 1.0), None);
    }

    #[test]
    fn lengths_and_tags_are_read() {
        assert_eq!(ber_length(&[0x05, 9]), Some((5, &[9][..])));
        assert_eq!(ber_length(&[0x81, 0x90, 9]), Some((0x90, &[9][..])));
        assert_eq!(ber_length(&[0x82, 0x01, 0x00]), Some((256, &[][..])));
        for broken in [
            &[][..],
            &[0x80],
            &[0x81],
            &[0x89, 1, 2, 3, 4, 5, 6, 7, 8, 9],
        ] {
            assert_eq!(ber_length(broken), None, "{broken:?}");
        }
        assert_eq!(ber_oid(&[0x41, 7]), Some((0x41, &[7][..])));
        assert_eq!(ber_oid(&[0x81, 0x0f]), Some((143, &[][..])));
        assert_eq!(ber_oid(&[0x81, 0x81, 0x01]), None);
    }
}
