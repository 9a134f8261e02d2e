//! A procedural town and countryside, as a map and as a drone sees it, with exact truth.
