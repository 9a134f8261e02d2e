//! The token that clients must send.

/// A secret that clients send as `Authorization: Bearer TOKEN`. Only its hash is kept.
#[derive(Clone)]
pub struct Token(blake3::Hash);

impl Token {
    /// Fewest characters of a token: 128 bits in base64.
    pub const MIN_CHARACTERS: usize = 22;

    /// The token `secret`, spaces and line ends around it left out; `None` if it is shorter than [`Token::MIN_CHARACTERS`] or
    /// holds characters that no header can carry.
    #[must_use]
    pub fn new(secret: &str) -> Option<Self> {
        let secret = secret.trim();
        let usable = secret.len() >= Self::MIN_CHARACTERS
            && secret.bytes().all(|byte| byte.is_ascii_graphic());
        usable.then(|| Self(blake3::hash(secret.as_bytes())))
    }

    /// Whether `given` is the token. The time that this takes does not depend on how much of it is right: hashes are compared,
    /// and those in constant time.
    pub(crate) fn is(&self, given: &str) -> bool {
        self.0 == blake3::hash(given.as_bytes())
    }
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(..)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_token_is_the_token() {
        let token = Token::new(" correct-horse-battery-staple\n").unwrap();
        assert!(token.is("correct-horse-battery-staple"));
        for other in [
            "",
            "correct-horse-battery-stapl",
            "correct-horse-battery-staple ",
        ] {
            assert!(!token.is(other), "{other:?}");
        }
        assert_eq!(format!("{token:?}"), "Token(..)");
    }

    #[test]
    fn weak_and_unsendable_tokens_are_refused() {
        for bad in [
            "",
            "short",
            "a secret with spaces in it",
            "päßwort-päßwort-päßwort",
        ] {
            assert!(Token::new(bad).is_none(), "{bad:?}");
        }
    }
}
