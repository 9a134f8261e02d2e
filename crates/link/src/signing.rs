//! Signing of MAVLink 2 messages.

use std::{fs, path::Path};

use mavlink::SigningConfig;
use sha2::{Digest as _, Sha256};

use crate::error::LinkError;

/// A secret key that both ends of a link know (<https://mavlink.io/en/guide/message_signing.html>).
#[derive(Clone, PartialEq, Eq)]
pub struct SigningKey([u8; 32]);

impl SigningKey {
    /// The key itself.
    #[must_use]
    pub fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The SHA-256 of a passphrase, as Mission Planner, QGroundControl and MAVProxy make a key from one.
    #[must_use]
    pub fn from_passphrase(passphrase: &str) -> Self {
        Self(Sha256::digest(passphrase.as_bytes()).into())
    }

    /// Reads a file that holds 64 hexadecimal digits (the key) or any other line of text (a passphrase).
    ///
    /// # Errors
    /// [`LinkError::SigningKey`] if the file cannot be read, is empty, or holds more than one line.
    pub fn from_file(path: &Path) -> Result<Self, LinkError> {
        let wrong = |reason: String| LinkError::SigningKey {
            path: path.to_owned(),
            reason,
        };
        let text = fs::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
        let line = text.strip_suffix('\n').unwrap_or(&text);
        let line = line.strip_suffix('\r').unwrap_or(line);
        if line.is_empty() || line.contains('\n') {
            return Err(wrong("expected one line".to_owned()));
        }
        Ok(match key_from_hex(line) {
            Some(key) => Self(key),
            None => Self::from_passphrase(line),
        })
    }

    /// Signs all that is sent and takes in nothing that is not signed with the key.
    pub(crate) fn config(&self) -> SigningConfig {
        SigningConfig::new(self.0, 0, true, false)
    }
}

impl std::fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("SigningKey(..)")
    }
}

fn key_from_hex(text: &str) -> Option<[u8; 32]> {
    if text.len() != 64 || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    let mut key = [0; 32];
    for (byte, digits) in key.iter_mut().zip(text.as_bytes().chunks(2)) {
        let digits = std::str::from_utf8(digits).ok()?;
        *byte = u8::from_str_radix(digits, 16).ok()?;
    }
    Some(key)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_holds_a_key_or_a_passphrase() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        // SHA-256 of "abc", FIPS 180-2.
        let hex = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        fs::write(&path, "abc\n").unwrap();
        let from_passphrase = SigningKey::from_file(&path).unwrap();
        fs::write(&path, hex).unwrap();
        assert_eq!(SigningKey::from_file(&path).unwrap(), from_passphrase);
        for text in ["", "\n", "two\nlines\n"] {
            fs::write(&path, text).unwrap();
            assert!(SigningKey::from_file(&path).is_err(), "{text:?}");
        }
    }

    #[test]
    fn a_key_is_not_printed() {
        assert!(!format!("{:?}", SigningKey::from_bytes([7; 32])).contains('7'));
    }
}
