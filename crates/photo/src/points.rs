//! Points in the pixel frames of a photo and of a query.
//!
//! Coordinates are continuous: (0, 0) is the outer corner of the top left pixel, the centre of pixel (i, j) is
//! (i + 0.5, j + 0.5).

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

/// A point of [`crate::Photo::image`], continuous pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PhotoPx {
    /// Columns from the left edge.
    pub x: f64,
    /// Rows from the top edge.
    pub y: f64,
}

/// A point of [`crate::Query::image`], continuous pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct QueryPx {
    /// Columns from the left edge.
    pub x: f64,
    /// Rows from the top edge.
    pub y: f64,
}

impl PhotoPx {
    /// The point `x` columns from the left edge and `y` rows from the top edge.
    pub const fn new(x: f64, y: f64) -> Self {
        Self { x, y }
    }
}

impl QueryPx {
    /// The point `x` columns from the left edge and `y` rows from the top edge.
    pub const fn new(x: f64, y: f64) -> Self {
        Self { x, y }
    }
}

impl From<Point2<f64>> for PhotoPx {
    fn from(point: Point2<f64>) -> Self {
        Self::new(point.x, point.y)
    }
}

impl From<PhotoPx> for Point2<f64> {
    fn from(point: PhotoPx) -> Self {
        Self::new(point.x, point.y)
    }
}

impl From<Point2<f64>> for QueryPx {
    fn from(point: Point2<f64>) -> Self {
        Self::new(point.x, point.y)
    }
}

impl From<QueryPx> for Point2<f64> {
    fn from(point: QueryPx) -> Self {
        Self::new(point.x, point.y)
    }
}
