//! Reports of an evaluation: an HTML page with figures, curves and pictures, and the files that scripts read.

pub mod html;
pub mod map_picture;
mod page;
pub mod plot;
pub mod results;
pub mod track_page;
mod track_plan;

pub use page::{Picture, Report, Run};
