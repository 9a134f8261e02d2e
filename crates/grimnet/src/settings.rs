//! The types of the fields of [`Options`](crate::Options) and of [`BuildOptions`](crate::map::BuildOptions).

pub use grimnet_locate::{
    Adapt, Choice, Coordinates, DEFAULT_MAP_ERROR_M, GeometryModel, Index, MapVoteOptions, Mode,
    Ransac, Recount, Sampling, Score, VoteOptions,
};
