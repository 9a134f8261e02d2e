//! Scene classes of pictures, from data sets with one folder for each class.

use std::ops::Range;

/// A picture's class. Classes are numbered through all data sets. A picture is classified among the classes of its own data set
/// only, since another data set may have the same class under another name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scene {
    /// Number of the class.
    pub class: usize,
    /// Numbers of the classes of its data set.
    pub among: Range<usize>,
}
