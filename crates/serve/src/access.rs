//! Who may ask.

use crate::token::Token;

/// Who may ask.
#[derive(Debug, Clone)]
pub enum Access {
    /// Programs on this machine.
    ThisMachine,
    /// Everybody who sends the token.
    WithToken(Token),
    /// Everybody who reaches the address.
    Everybody,
}
