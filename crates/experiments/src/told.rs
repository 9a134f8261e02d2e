//! What a method is told of the photos.

/// What a method is told of a photo beside its pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Told {
    /// Nothing, as in the paper: metadata are removed.
    Nothing,
    /// The metadata and the ground width, without the heading.
    Scale,
    /// The metadata, the ground width and the heading.
    #[default]
    HeadingAndScale,
}
