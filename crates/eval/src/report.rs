//! Reports of an evaluation: an HTML page with figures, curves and pictures, and the files that scripts read.

pub mod html;
pub mod map_picture;
mod page;
pub mod plot;
pub mod results;
pub mod track_page;
mod track_plan;

pub use page::{Picture, Report, Run};

/// A number with its noun, as in "1 place" and "5 places".
#[must_use]
pub fn counted(number: usize, noun: &str) -> String {
    let ending = if number == 1 { "" } else { "s" };
    format!("{number} {noun}{ending}")
}
