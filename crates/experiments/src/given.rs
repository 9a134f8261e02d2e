//! What a method is given beside the pixels.

/// What a method is given beside the pixels of a photo.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Given {
    /// Nothing, as in the paper: metadata are removed.
    Nothing,
    /// The heading alone: metadata are removed.
    Heading,
    /// The metadata and the ground width, without the heading.
    Scale,
    /// The metadata, the ground width and the heading.
    #[default]
    HeadingAndScale,
}

impl Given {
    /// It, in words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Nothing => "nothing given",
            Self::Heading => "heading given",
            Self::Scale => "scale given",
            Self::HeadingAndScale => "heading and scale given",
        }
    }
}
