//! The interface of a format of answers.

use crate::{Answer, error::Result, rounding::rounded_heading};

/// The text of one format, in pieces: opening, answers, closing.
pub trait AnswerFormat {
    /// What stands before the first answer.
    fn opening(&self) -> String {
        String::new()
    }

    /// One answer.
    ///
    /// # Errors
    /// The answer cannot be written in this format.
    fn answer(&mut self, answer: &Answer) -> Result<String>;

    /// What has to follow the last answer for the text to be well-formed; always the same.
    fn closing(&self) -> &'static str {
        ""
    }

    /// What is said at the end of a whole run.
    fn summary(&self) -> String {
        String::new()
    }
}

/// All answers as one text.
///
/// # Errors
/// An answer cannot be written in this format.
pub fn text_of<'a>(
    format: &mut dyn AnswerFormat,
    answers: impl IntoIterator<Item = &'a Answer>,
) -> Result<String> {
    let mut text = format.opening();
    for answer in answers {
        text += &format.answer(answer)?;
    }
    text += format.closing();
    text += &format.summary();
    Ok(text)
}

/// `12.3`, or a dash if there is no value.
pub fn or_dash(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.decimals$}"))
}

/// A heading with one decimal, below 360.0, or a dash if there is none.
pub fn heading_or_dash(heading_deg: Option<f64>) -> String {
    or_dash(heading_deg.map(|deg| rounded_heading(deg, 1)), 1)
}
