//! What kind of place a picture shows, as data sets with one folder a class tell it.

use std::ops::Range;

/// A picture's class. Classes of all data sets are numbered through; a picture competes among those of its own data set
/// only, since another data set may have the same class under another name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scene {
    /// The class.
    pub class: usize,
    /// The classes of its data set.
    pub among: Range<usize>,
}
